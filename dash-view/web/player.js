// The page around the player. `wasm_bindgen` is what the player's module was bound to; FILES holds the page's files as
// base64 where everything is in one file, and is null where they lie beside it.
"use strict";

const SPEEDS = [0.1, 0.25, 0.5, 1, 2, 4, 8];
const LAYERS = ["full", "static", "dynamic", "depth", "alpha", "speed", "ellipsoids"];
const KEYS = [
  ["drag", "orbit"], ["shift or right drag, two fingers", "move"], ["wheel, pinch", "nearer, farther"],
  ["W A S D Q E", "fly; with shift faster"], ["space", "play or stop"], ["left, right", "one frame"],
  ["home, end", "start, end"], [", .", "slower, faster"], ["L", "loop"], ["1 to 7", "layers"],
  ["[ ]", "cameras"], ["R", "back to the first view"], ["F", "whole screen"], ["?", "these keys"],
];
const element = (id) => document.getElementById(id);
const view = element("view");
const asked = new URLSearchParams(location.search);

/** A file of the page, unpacked. */
async function file(name) {
  let packed;
  if (FILES) {
    packed = new Blob([Uint8Array.from(atob(FILES[name]), (c) => c.charCodeAt(0))]);
  } else {
    const answer = await fetch(name);
    if (!answer.ok) throw new Error(`${name}: the server says ${answer.status} ${answer.statusText}`);
    packed = await answer.blob();
  }
  const stream = packed.stream().pipeThrough(new DecompressionStream("gzip"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

/** Says why there is no player, and shows the poster. */
function refuse(why) {
  const says = element("says");
  says.hidden = false;
  says.textContent = why;
  const poster = new Image();
  poster.alt = document.title;
  poster.src = FILES ? `data:image/png;base64,${FILES["poster.png"]}` : "poster.png";
  says.append(poster);
}

let player;
/** Something changed since the last picture was asked for. */
let changed = true;
let drawing = false;
/** The time until which something counts as moving. */
let movingUntil = 0;
const held = new Set();

function touch() {
  changed = true;
  movingUntil = performance.now() + 200;
}

async function picture(promise, width, height) {
  const rgba = await promise;
  view.width = width;
  view.height = height;
  view.getContext("2d").putImageData(new ImageData(rgba, width, height), 0, 0);
  window.dash.pictures += 1;
  window.dash.firstMs ||= performance.now();
}

async function draw(now) {
  const ratio = Math.min(window.devicePixelRatio || 1, 2);
  const full = [Math.round(view.clientWidth * ratio), Math.round(view.clientHeight * ratio)];
  const moving = player.playing || held.size > 0 || now < movingUntil;
  const [width, height] = player.size(full[0], full[1], moving);
  drawing = true;
  changed = false;
  const start = performance.now();
  try {
    await picture(player.draw(width, height), width, height);
    player.saw(width, height, full[0], full[1], (performance.now() - start) / 1000);
    // What moved is drawn sharp once it rests.
    if (moving && !player.playing) setTimeout(() => { changed = true; }, Math.max(0, movingUntil - performance.now()));
  } catch (error) {
    refuse(`drawing failed: ${error.message ?? error}`);
    player = null;
  }
  drawing = false;
}

let last = performance.now();
function tick(now) {
  if (!player) return;
  const secs = Math.min((now - last) / 1000, 0.25);
  last = now;
  fly(secs);
  // The clip waits for a window that is still to come.
  if (player.playing && player.ready()) {
    player.advance(secs);
    changed = true;
  }
  if (changed && !drawing && player.ready()) draw(now);
  show();
  requestAnimationFrame(tick);
}

let shown = "";
/** Brings the controls, and the page that embeds this one, to the player's state. */
function show() {
  const state = { time: player.time, frame: player.frame, playing: player.playing, speed: player.speed, layer: player.layer };
  const text = JSON.stringify(state);
  if (text === shown) return;
  shown = text;
  element("play").innerHTML = player.playing ? "&#10074;&#10074;" : "&#9654;";
  element("time").value = player.time;
  element("frame").textContent = `${player.frame + 1} / ${player.n_frames}`;
  element("speed").value = player.speed;
  element("layer").value = player.layer;
  if (window.parent !== window) window.parent.postMessage({ dash: state }, "*");
}

function fly(secs) {
  const along = (less, more) => (held.has(more) ? 1 : 0) - (held.has(less) ? 1 : 0);
  const way = [along("KeyA", "KeyD"), along("KeyE", "KeyQ"), along("KeyS", "KeyW")];
  if (way.every((w) => w === 0)) return;
  const rate = secs * (held.has("ShiftLeft") || held.has("ShiftRight") ? 2 : 0.5);
  player.fly(way[0] * rate, way[1] * rate, way[2] * rate);
  touch();
}

let camera = 0;
function look(index) {
  const n = player.cameras().length;
  if (n === 0) return;
  camera = ((index % n) + n) % n;
  player.look_through(camera);
  element("camera").value = camera;
  touch();
}

/** Takes what a URL or an embedding page asks for. */
function take(wanted) {
  if (wanted.camera !== undefined) {
    const index = player.cameras().indexOf(String(wanted.camera));
    look(index >= 0 ? index : Number(wanted.camera) || 0);
  }
  if (wanted.time !== undefined) player.seek(Number(wanted.time));
  if (wanted.speed !== undefined) player.speed = Number(wanted.speed);
  if (wanted.loop !== undefined) player.looping = is(wanted.loop);
  if (wanted.layer !== undefined) player.layer = String(wanted.layer);
  if (wanted.playing !== undefined) player.playing = is(wanted.playing);
  if (wanted.autoplay !== undefined) player.playing = is(wanted.autoplay);
  const colour = /^#?([0-9a-f]{6})$/i.exec(wanted.background ?? "");
  if (colour) {
    const value = parseInt(colour[1], 16);
    player.set_background((value >> 16) / 255, ((value >> 8) & 255) / 255, (value & 255) / 255);
  }
  if (wanted.controls !== undefined) element("bar").hidden = !is(wanted.controls);
  touch();
}

const is = (value) => value !== false && !["0", "false", "no"].includes(String(value));

function listen() {
  const pointers = new Map();
  let spread = 0;
  view.addEventListener("pointerdown", (event) => {
    pointers.set(event.pointerId, event);
    view.setPointerCapture(event.pointerId);
    spread = 0;
    view.focus();
  });
  const lift = (event) => { pointers.delete(event.pointerId); spread = 0; };
  view.addEventListener("pointerup", lift);
  view.addEventListener("pointercancel", lift);
  view.addEventListener("pointermove", (event) => {
    const before = pointers.get(event.pointerId);
    if (!before || !player) return;
    pointers.set(event.pointerId, event);
    const n = pointers.size;
    const [right, down] = [(event.clientX - before.clientX) / n, (event.clientY - before.clientY) / n];
    if (n > 1 || event.shiftKey || event.buttons & 6) player.pan(right / view.clientHeight, down / view.clientHeight);
    else player.orbit(right * 0.008, down * 0.008);
    if (n === 2) {
      const [a, b] = [...pointers.values()];
      const now = Math.hypot(a.clientX - b.clientX, a.clientY - b.clientY);
      if (spread > 0 && now > 0) player.zoom(spread / now);
      spread = now;
    }
    touch();
  });
  view.addEventListener("contextmenu", (event) => event.preventDefault());
  view.addEventListener("wheel", (event) => {
    event.preventDefault();
    if (!player) return;
    const pixels = event.deltaY * (event.deltaMode === 1 ? 16 : 1);
    player.zoom(Math.exp(Math.max(-200, Math.min(200, pixels)) * 0.0015));
    touch();
  }, { passive: false });
  window.addEventListener("keyup", (event) => held.delete(event.code));
  window.addEventListener("blur", () => held.clear());
  window.addEventListener("keydown", (event) => {
    if (!player || event.ctrlKey || event.metaKey || event.altKey || event.target.tagName === "SELECT") return;
    if (!press(event)) return;
    event.preventDefault();
    touch();
  });
  window.addEventListener("resize", touch);
  window.addEventListener("message", (event) => {
    if (player && event.data?.dash && event.source === window.parent && event.source !== window) take(event.data.dash);
  });
  element("play").onclick = () => { player.toggle(); touch(); };
  element("time").oninput = (event) => { player.playing = false; player.seek(Number(event.target.value)); touch(); };
  element("speed").onchange = (event) => { player.speed = Number(event.target.value); };
  element("layer").onchange = (event) => { player.layer = event.target.value; touch(); };
  element("camera").onchange = (event) => look(Number(event.target.value));
  element("reset").onclick = () => { player.reset(); touch(); };
  element("help").onclick = () => { element("keys").hidden = !element("keys").hidden; };
}

/** Whether the key means something. */
function press(event) {
  if (/^Key[WASDQE]$|^Shift/.test(event.code)) {
    held.add(event.code);
    return event.code.startsWith("Key");
  }
  const faster = (by) => {
    const place = SPEEDS.findIndex((s) => s >= player.speed);
    player.speed = SPEEDS[Math.max(0, Math.min(SPEEDS.length - 1, place + by))];
  };
  const meanings = {
    " ": () => player.toggle(), ArrowLeft: () => player.step(-1), ArrowRight: () => player.step(1),
    Home: () => player.seek(0), End: () => player.seek(1), ",": () => faster(-1), ".": () => faster(1),
    l: () => { player.looping = !player.looping; }, r: () => player.reset(),
    "[": () => look(camera - 1), "]": () => look(camera + 1), "?": () => element("help").onclick(),
    f: () => (document.fullscreenElement ? document.exitFullscreen() : document.documentElement.requestFullscreen()),
  };
  const layer = LAYERS[Number(event.key) - 1];
  const meaning = layer ? () => { player.layer = layer; } : meanings[event.key] ?? meanings[event.key.toLowerCase()];
  meaning?.();
  return Boolean(meaning);
}

function choices(id, values, label) {
  for (const [index, value] of values.entries()) element(id).add(new Option(label(value), id === "camera" ? index : value));
}

async function start() {
  if (!navigator.gpu || !(await navigator.gpu.requestAdapter())) {
    refuse("This scene is drawn by WebGPU, which this browser does not offer. Chrome, Edge and Safari 26 do, on most machines.");
    return;
  }
  const [code, about] = await Promise.all([file("player.wasm.gz"), file("about.json.gz")]);
  await wasm_bindgen({ module_or_path: code });
  const text = new TextDecoder().decode(about);
  const { parts } = JSON.parse(text);
  const coming = await wasm_bindgen.Player.start(text);
  // A run that trains has its parts from time to time.
  if (parts.length === 0) return follow(coming);
  // The window of that time comes before the others.
  if (asked.has("time")) coming.seek(Number(asked.get("time")));
  feed(coming);
}

/** Brings what the player needs, one part after the other. */
async function feed(coming) {
  try {
    for (;;) {
      const name = coming.wanted();
      if (name === undefined) {
        window.dash.complete = true;
        await new Promise((done) => setTimeout(done, 50));
        continue;
      }
      window.dash.complete = false;
      const files = await Promise.all(["json", "bin"].map((kind) => file(`${name}.${kind}.gz`)));
      coming.add(name, ...files);
      if (!player && coming.ready()) begin(coming);
      changed = true;
    }
  } catch (error) {
    refuse(`The scene can't be shown: ${error.message ?? error}`);
  }
}

/** The first part is here. */
function begin(coming) {
  player = coming;
  choices("speed", SPEEDS, (speed) => `${speed}x`);
  choices("layer", LAYERS, (layer) => layer);
  choices("camera", player.cameras(), (name) => name);
  element("camera").hidden = player.cameras().length === 0;
  element("keys").innerHTML = KEYS.map(([key, what]) => `<tr><td>${key}</td><td>${what}</td></tr>`).join("");
  element("says").hidden = true;
  element("bar").hidden = false;
  listen();
  take(Object.fromEntries(asked));
  window.dash.player = player;
  requestAnimationFrame(tick);
}

window.dash = {
  complete: false,
  pictures: 0,
  firstMs: 0,
  /** Whether the newest picture is the one that was asked for. */
  atRest: () => !changed && !drawing && performance.now() > movingUntil + 50,
};
start().catch((error) => refuse(`The scene can't be shown: ${error.message ?? error}`));
