// The page of a run that trains: its scene is replaced as training goes on. Stands behind player.js.
"use strict";

const panel = document.createElement("div");
panel.id = "run";
panel.innerHTML = `<style>
#run { position: fixed; left: 12px; top: 12px; width: 260px; background: #000a; padding: 8px 12px; border-radius: 6px; font-size: 12px; }
#run canvas { width: 100%; height: 90px; display: block; margin: 6px 0; }
</style><div id="numbers"></div><canvas id="curves" width="520" height="180"></canvas><button id="pause">pause</button>`;
document.body.append(panel);

/** What the run says; throws where it can't be asked. */
async function state() {
  const answer = await fetch("state.json");
  if (!answer.ok) throw new Error(await answer.text());
  return answer.json();
}

let paused = false;
element("pause").onclick = async () => {
  await fetch(paused ? "resume" : "pause", { method: "POST", headers: { "x-dash": "1" } });
};

/** A line through points [x, y], between the least and the largest y. */
function curve(points, most, colour) {
  if (points.length < 2) return;
  const canvas = element("curves");
  const pen = canvas.getContext("2d");
  const values = points.map(([, y]) => y);
  const [low, high] = [Math.min(...values), Math.max(...values)];
  pen.strokeStyle = pen.fillStyle = colour;
  pen.lineWidth = 2;
  pen.beginPath();
  for (const [x, y] of points) {
    pen.lineTo((x / most) * canvas.width, canvas.height - 4 - ((y - low) / (high - low || 1)) * (canvas.height - 28));
  }
  pen.stroke();
}

function tell(told) {
  paused = told.paused;
  element("pause").textContent = paused ? "go on" : "pause";
  const [, , psnr] = told.curve.at(-1) ?? [0, 0, NaN];
  const [, heldOut] = told.held_out.at(-1) ?? [0, NaN];
  const rows = [
    `step ${told.step} of ${told.iterations}, ${told.stage}${paused ? ", paused" : ""}`,
    `${Math.round(told.secs)} s, ${told.n_static} static and ${told.n_dynamic} dynamic Gaussians`,
    `PSNR of training views ${psnr.toFixed(1)} dB (orange)`,
  ];
  if (told.held_out.length) rows.push(`of test views ${heldOut.toFixed(1)} dB (blue)`);
  rows.push("loss (gray)");
  element("numbers").replaceChildren(...rows.flatMap((row) => [row, document.createElement("br")]));
  const canvas = element("curves");
  canvas.getContext("2d").clearRect(0, 0, canvas.width, canvas.height);
  const most = Math.max(told.iterations, 1);
  curve(told.curve.map(([step, loss]) => [step, Math.log(Math.max(loss, 1e-9))]), most, "#888");
  curve(told.curve.map(([step, , psnr]) => [step, psnr]), most, "#f90");
  curve(told.held_out, most, "#6af");
}

/** Follows the run: its numbers every second, its scene when there is a newer one. */
async function follow(coming) {
  let version = 0;
  for (;;) {
    // A page that nobody sees asks for nothing.
    while (document.hidden) await new Promise((done) => document.addEventListener("visibilitychange", done, { once: true }));
    try {
      const told = await state();
      tell(told);
      if (told.version > version) {
        for (let part = 0; part < told.parts; part += 1) {
          const name = `v${told.version}/part${part}`;
          coming.add_to_next(await file(`${name}.json.gz`), await file(`${name}.bin.gz`));
        }
        coming.change();
        if (version === 0) begin(coming);
        version = told.version;
        window.dash.version = version;
        changed = true;
      }
    } catch (error) {
      element("numbers").textContent = `the run does not answer: it has ended, or the connection is cut (${error.message ?? error})`;
    }
    await new Promise((done) => setTimeout(done, 1000));
  }
}
