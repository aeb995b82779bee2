#!/usr/bin/env python3
"""Opens a scene's web page in headless Chromium and uses it: browser.py DASH RUN DATASET PLAYER OUT

Exports RUN, which was trained on DATASET, as a page and as one file into OUT, with the player that dash-view/web/build.sh left
in PLAYER. Fails where the browser's pictures are not those of `dash render` (45 dB, at three times and two cameras), where keys,
mouse or controls do not do what the page says, or where the browser's console has an error. Leaves a screenshot of each layer
in OUT, to look at, and says how many bytes and milliseconds the first picture took. A run that trains is looked at, too
(`dash train --serve`).

Needs Debian's package chromium; its software adapter stands in for a GPU.
"""

import base64
import functools
import gzip
import http.server
import json
import math
import os
import pathlib
import shutil
import socket
import struct
import subprocess
import sys
import tempfile
import threading
import time
import urllib.request
import zlib

if len(sys.argv) != 6:
    sys.exit(__doc__)
dash, run, data, player, out = sys.argv[1], *map(pathlib.Path, sys.argv[2:])
LEAST_DB = 45.0
TIMES = [0.0, 0.4, 1.0]
LAYERS = ["full", "static", "dynamic", "depth", "alpha", "speed", "ellipsoids"]


class Socket:
    """A WebSocket's text messages (RFC 6455), as a client."""

    def __init__(self, url):
        host, path = url.removeprefix("ws://").split("/", 1)
        name, port = host.split(":")
        self.stream = socket.create_connection((name, int(port)), timeout=60)
        key = base64.b64encode(os.urandom(16)).decode()
        self.stream.sendall(
            f"GET /{path} HTTP/1.1\r\nHost: {host}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
            f"Sec-WebSocket-Key: {key}\r\nSec-WebSocket-Version: 13\r\n\r\n".encode()
        )
        self.file = self.stream.makefile("rb")
        while self.file.readline() not in (b"\r\n", b""):
            pass

    def send(self, text):
        data, mask = text.encode(), os.urandom(4)
        n = len(data)
        length = bytes([0x80 | n]) if n < 126 else b"\xfe" + struct.pack(">H", n) if n < 65536 else b"\xff" + struct.pack(">Q", n)
        masked = bytes(b ^ mask[i % 4] for i, b in enumerate(data))
        self.stream.sendall(b"\x81" + length + mask + masked)

    def receive(self):
        text = b""
        while True:
            first, second = self.file.read(2)
            n = second & 127
            if n == 126:
                (n,) = struct.unpack(">H", self.file.read(2))
            elif n == 127:
                (n,) = struct.unpack(">Q", self.file.read(8))
            data = self.file.read(n)
            if first & 15 in (0, 1):
                text += data
            if first & 0x80 and first & 15 in (0, 1):
                return json.loads(text)


class Tab:
    """A page in the browser, driven by the DevTools protocol."""

    def __init__(self, port, before=""):
        request = urllib.request.Request(f"http://127.0.0.1:{port}/json/new?about:blank", method="PUT")
        self.socket = Socket(json.load(urllib.request.urlopen(request))["webSocketDebuggerUrl"])
        self.number, self.errors = 0, []
        for domain in ("Runtime", "Log", "Page"):
            self.call(f"{domain}.enable")
        if before:
            self.call("Page.addScriptToEvaluateOnNewDocument", source=before)

    def call(self, method, **params):
        self.number += 1
        self.socket.send(json.dumps({"id": self.number, "method": method, "params": params}))
        while True:
            message = self.socket.receive()
            self.note(message)
            if message.get("id") == self.number:
                if "error" in message:
                    sys.exit(f"{method}: {message['error']}")
                return message["result"]

    def note(self, message):
        params = message.get("params", {})
        match message.get("method"):
            case "Runtime.exceptionThrown":
                self.errors.append(json.dumps(params["exceptionDetails"])[:500])
            case "Runtime.consoleAPICalled" if params["type"] == "error":
                self.errors.append(json.dumps(params["args"])[:500])
            case "Log.entryAdded" if params["entry"]["level"] == "error" and "favicon" not in params["entry"].get("url", ""):
                self.errors.append(json.dumps(params["entry"])[:500])

    def value(self, expression):
        answer = self.call("Runtime.evaluate", expression=expression, awaitPromise=True, returnByValue=True)
        if "exceptionDetails" in answer:
            sys.exit(f"{expression}: {json.dumps(answer['exceptionDetails'])[:800]}")
        return answer["result"].get("value")

    def wait(self, expression, what, secs=240):
        end = time.time() + secs
        while time.time() < end:
            if self.value(expression):
                return
            time.sleep(0.1)
        said = self.value("document.getElementById('says')?.textContent")
        sys.exit(f"{what}: not after {secs} s; the page says {said!r}; errors: {self.errors[:2]}")

    def open(self, url):
        self.call("Page.navigate", url=url)

    def key(self, key, code=None):
        code = code or key
        text = {"text": key} if len(key) == 1 else {}
        for kind in ("keyDown", "keyUp"):
            self.call("Input.dispatchKeyEvent", type=kind, key=key, code=code, **(text if kind == "keyDown" else {}))

    def mouse(self, kind, x, y, **more):
        self.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, **more)

    def drag(self, start, end, button="left"):
        buttons = {"left": 1, "right": 2}[button]
        self.mouse("mousePressed", *start, button=button, buttons=buttons, clickCount=1)
        for step in range(1, 6):
            at = [a + (b - a) * step / 5 for a, b in zip(start, end)]
            self.mouse("mouseMoved", *at, button=button, buttons=buttons)
        self.mouse("mouseReleased", *end, button=button, buttons=0, clickCount=1)

    def screenshot(self, path):
        path.write_bytes(base64.b64decode(self.call("Page.captureScreenshot")["data"]))


def png(path):
    """The bytes of an 8-bit RGB PNG."""
    data, place, packed = path.read_bytes(), 8, b""
    while place < len(data):
        n, kind = struct.unpack(">I4s", data[place : place + 8])
        body = data[place + 8 : place + 8 + n]
        if kind == b"IHDR":
            width, height, depth, colour = struct.unpack(">IIBB", body[:10])
            assert (depth, colour) == (8, 2), path
        if kind == b"IDAT":
            packed += body
        place += n + 12
    lines, stride = zlib.decompress(packed), 3 * width
    rows, above = [], bytearray(stride)
    for y in range(height):
        kind, line = lines[y * (stride + 1)], bytearray(lines[y * (stride + 1) + 1 : (y + 1) * (stride + 1)])
        for x in range(stride):
            a, b = (line[x - 3] if x >= 3 else 0), above[x]
            c = above[x - 3] if x >= 3 else 0
            p = a + b - c
            nearest = min((abs(p - a), 0, a), (abs(p - b), 1, b), (abs(p - c), 2, c))[2]
            line[x] = (line[x] + [0, a, b, (a + b) // 2, nearest][kind]) & 255
        rows.append(bytes(line))
        above = line
    return b"".join(rows)


def db(a, b):
    assert len(a) == len(b), (len(a), len(b))
    mse = sum((x - y) ** 2 for x, y in zip(a, b)) / len(a)
    return 99.0 if mse == 0 else 10 * math.log10(255**2 / mse)


def check(holds, what):
    print(f"{'ok' if holds else 'FAILED'}  {what}", flush=True)
    if not holds:
        sys.exit(f"{what}: does not hold")


def drawn_from(tab, camera, at):
    """The colours that the page draws from a camera of it, at a time."""
    text = tab.value(
        f"(async () => {{ const p = window.dash.player; p.seek({at}); const rgba = await p.draw_camera({camera});"
        " let text = ''; for (let i = 0; i < rgba.length; i += 4096) text += String.fromCharCode(...rgba.subarray(i, i + 4096));"
        " return btoa(text); })()")
    return bytes(v for i, v in enumerate(base64.b64decode(text)) if i % 4 < 3)


def program(*args):
    done = subprocess.run([dash, *map(str, args)], capture_output=True, text=True)
    if done.returncode != 0:
        sys.exit(f"dash {' '.join(map(str, args))}: {done.stderr}")
    return done.stdout


shutil.rmtree(out, ignore_errors=True)
out.mkdir(parents=True)
print(program("export", run, "--web", out / "page", "--player", player).strip())
print(program("export", run, "--web", out / "page.html", "--single-file", "--player", player).strip())
about = json.loads(gzip.decompress((out / "page/about.json.gz").read_bytes()))
# The same clip in windows of time.
program("train", data, "--window", "5", "--overlap", "2", "--room", "yes", "--preset", "quick", "--iterations", "60", "--device", "flex", "--out", out / "windows")
print(program("export", out / "windows", "--web", out / "page/windows", "--player", player).strip())

profile = tempfile.mkdtemp(prefix="browser-")
browser = subprocess.Popen(
    ["chromium", "--headless=new", "--no-sandbox", "--disable-gpu-sandbox", "--enable-unsafe-webgpu",
     "--use-webgpu-adapter=swiftshader", "--enable-features=Vulkan", "--window-size=1000,700",
     "--remote-debugging-port=0", f"--user-data-dir={profile}", "about:blank"],
    stdout=subprocess.DEVNULL, stderr=(out / "chromium.log").open("w"))
try:
    port_file = pathlib.Path(profile) / "DevToolsActivePort"
    for _ in range(300):
        if port_file.exists() and port_file.read_text().strip():
            break
        time.sleep(0.1)
    port = int(port_file.read_text().split()[0])

    handler = functools.partial(http.server.SimpleHTTPRequestHandler, directory=out / "page")
    handler.log_message = lambda *_: None
    http.server.SimpleHTTPRequestHandler.log_message = lambda *_: None
    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    url = f"http://127.0.0.1:{server.server_port}/"

    # As many buffers a kernel as every browser offers, and no more.
    tab = Tab(port, "const ask = GPUAdapter.prototype.requestDevice; GPUAdapter.prototype.requestDevice = function (d = {}) {"
              " d.requiredLimits = { ...d.requiredLimits, maxStorageBuffersPerShaderStage: 8 }; return ask.call(this, d); };")
    tab.open(url + "?autoplay=0&time=0")
    tab.wait("window.dash?.complete === true && window.dash.firstMs > 0", "the scene in the page")
    taken = tab.value(
        "performance.getEntriesByType('resource').filter((r) => r.responseEnd <= window.dash.firstMs)"
        ".reduce((sum, r) => sum + r.encodedBodySize, 0)")
    print(f"    first picture: {taken} bytes of files, {tab.value('Math.round(window.dash.firstMs)')} ms", flush=True)
    counts = tab.value("[...window.dash.player.counts()]")
    print(f"    Gaussians: {counts}")

    # Pictures of two cameras at three times.
    chosen = [0, len(about["cameras"]) - 1]
    entries = []
    for index in chosen:
        c = about["cameras"][index]
        r, t = c["rotation"], c["translation"]
        for at in TIMES:
            entries.append(dict(
                id=len(entries), img_name=f"{len(entries)}", width=c["width"], height=c["height"],
                position=[-sum(r[k][axis] * t[k] for k in range(3)) for axis in range(3)],
                rotation=[[r[k][axis] for k in range(3)] for axis in range(3)],
                fx=c["focal"][0], fy=c["focal"][1], cx=c["principal"][0], cy=c["principal"][1], time=at))
    (out / "cameras.json").write_text(json.dumps(entries))
    program("render", run, "--cameras", out / "cameras.json", "--out", out / "expected")
    expected = sorted((out / "expected/full").glob("*.png"))
    check(len(expected) == len(entries), f"dash render drew {len(entries)} pictures")
    for entry, path in zip(entries, expected):
        index, at = chosen[entry["id"] // len(TIMES)], entry["time"]
        found = db(drawn_from(tab, index, at), png(path))
        check(found >= LEAST_DB, f"camera {index} at {at}: {found:.1f} dB from dash render")

    # Keys, mouse, controls.
    state = lambda name: tab.value(f"window.dash.player.{name}")
    n = about["n_frames"]
    tab.value("document.getElementById('view').focus()")
    tab.key("Home")
    tab.key("ArrowRight")
    check(state("frame") == 1, "right goes one frame on")
    tab.key("ArrowLeft")
    check(state("frame") == 0, "left goes one frame back")
    tab.key("End")
    check(state("frame") == n - 1, "end goes to the end")
    for number, layer in enumerate(LAYERS, 1):
        tab.key(str(number), f"Digit{number}")
        check(state("layer") == layer, f"{number} shows {layer}")
        tab.wait("window.dash.atRest()", f"a picture of {layer}", 60)
        tab.screenshot(out / f"layer_{layer}.png")
    tab.key("1", "Digit1")
    tab.key("]", "BracketRight")
    check(tab.value("document.getElementById('camera').value") == "1", "] looks through the next camera")
    tab.key(".", "Period")
    check(state("speed") == 2, ". is faster")
    tab.key(",", "Comma")
    tab.key("?", "Slash")
    check(not tab.value("document.getElementById('keys').hidden"), "? shows the keys")
    tab.screenshot(out / "keys.png")
    tab.key("?", "Slash")
    tab.key("Home")
    before = tab.value("window.dash.pictures")
    tab.key(" ", "Space")
    check(state("playing"), "space plays")
    start = time.time()
    tab.wait(f"window.dash.pictures >= {before + 2} && window.dash.player.time > 0", "it plays")
    drawn = tab.value("window.dash.pictures") - before
    print(f"it plays: {drawn / (time.time() - start):.1f} pictures a second")
    tab.key(" ", "Space")
    check(not state("playing"), "space stops")
    box = tab.value("(({ x, y, width, height }) => [x, y, width, height])(document.getElementById('time').getBoundingClientRect())")
    tab.drag([box[0] + 0.2 * box[2], box[1] + box[3] / 2], [box[0] + 0.75 * box[2], box[1] + box[3] / 2])
    check(abs(state("time") - 0.75) < 0.05, f"the time line scrubs to {state('time'):.2f}")
    shot = "(async () => { const p = window.dash.player; return [...(await p.draw(64, 48))].join(); })()"
    tab.key("r", "KeyR")
    first = tab.value(shot)
    for what, act in [
        ("a drag orbits", lambda: tab.drag([300, 300], [380, 320])),
        ("a right drag moves", lambda: tab.drag([300, 300], [380, 320], "right")),
        ("the wheel zooms", lambda: tab.mouse("mouseWheel", 300, 300, deltaX=0, deltaY=-240)),
    ]:
        tab.key("r", "KeyR")
        act()
        check(tab.value(shot) != first, what)
    tab.key("r", "KeyR")
    check(tab.value(shot) == first, "R goes back to the first view")
    tab.wait("window.dash.atRest()", "a picture at rest", 60)
    before = tab.value("window.dash.pictures")
    time.sleep(2)
    check(tab.value("window.dash.pictures") == before, "at rest nothing is drawn")
    check(not tab.errors, f"no error on the console {tab.errors[:2]}")

    asked = Tab(port)
    asked.open(url + "?time=0.5&speed=0.5&layer=depth&camera=1&autoplay=0&controls=0&background=ff8000")
    asked.wait("window.dash?.complete === true", "the page with options")
    of = asked.value("(({ time, speed, layer, playing }) => [time, speed, layer, playing])(window.dash.player)")
    check(of == [0.5, 0.5, "depth", False], f"the address sets time, speed, layer, play: {of}")
    check(asked.value("document.getElementById('bar').hidden"), "the address hides the controls")
    check(not asked.errors, f"no error on the console {asked.errors[:2]}")

    single = Tab(port)
    single.open((out / "page.html").resolve().as_uri() + "?autoplay=0")
    single.wait("window.dash?.complete === true && window.dash.firstMs > 0", "the page in one file, from disk")
    check(single.value("[...window.dash.player.counts()]") == counts, "one file, from disk, has the same scene")
    check(not single.errors, f"no error on the console {single.errors[:2]}")

    # Windows of time: only those that a picture needs come.
    windows = Tab(port)
    windows.open(url + "windows/?autoplay=0&time=0")
    windows.wait("window.dash?.complete === true && window.dash.firstMs > 0", "a page of windows")
    brought = lambda: windows.value("performance.getEntriesByType('resource').map((r) => r.name.split('/').pop())")
    files = brought()
    about_windows = json.loads(gzip.decompress((out / "page/windows/about.json.gz").read_bytes()))
    n_windows = len(about_windows["parts"])
    check(about_windows["room"]["parts"] > 0, "windows share a room")
    check(not any(name.startswith(f"window{n_windows - 1}_") for name in files), f"the last of {n_windows} windows does not come yet")
    jump = windows.value(
        "(async () => { const p = window.dash.player, start = performance.now();"
        " const bytes = () => performance.getEntriesByType('resource').reduce((sum, r) => sum + r.encodedBodySize, 0);"
        " const before = bytes(); p.seek(1); while (!p.ready()) await new Promise(requestAnimationFrame);"
        " const there = bytes(); await p.draw_camera(0); return [there - before, Math.round(performance.now() - start)]; })()")
    print(f"    a jump to the end of windows: {jump[0]} bytes of files, {jump[1]} ms", flush=True)
    # The second time is in the middle of what two windows show.
    (_, end), (begin, _) = about_windows["times"][:2]
    times = [0.0, (begin + end) / 2, 1.0]
    for entry in entries:
        entry["time"] = times[entry["id"] % len(times)]
    (out / "cameras_windows.json").write_text(json.dumps(entries))
    program("render", out / "windows", "--cameras", out / "cameras_windows.json", "--out", out / "expected_windows")
    expected = sorted((out / "expected_windows/full").glob("*.png"))
    for entry, path in zip(entries, expected):
        index, at = chosen[entry["id"] // len(times)], entry["time"]
        windows.value(f"window.dash.player.seek({at})")
        windows.wait("window.dash.player.ready() && window.dash.complete", f"the windows of {at}", 60)
        found = db(drawn_from(windows, index, at), png(path))
        check(found >= LEAST_DB, f"windows: camera {index} at {at:.3f}: {found:.1f} dB from dash render")
    for layer in LAYERS:
        windows.value(f"window.dash.player.layer = '{layer}'")
        drawn_from(windows, 0, times[-1])
    check(not windows.errors, f"no error on the console {windows.errors[:2]}")

    # A run while it trains.
    live_url = "http://127.0.0.1:8731/"
    training = subprocess.Popen(
        [dash, "train", data, "--out", out / "run", "--preset", "quick", "--iterations", "4000", "--threads", "1", "--device", "flex", "-q",
         "--curve", "20", "--serve", "127.0.0.1:8731", "--player", player], stderr=(out / "train.log").open("w"))
    try:
        for _ in range(100):
            try:
                urllib.request.urlopen(live_url + "state.json")
                break
            except OSError:
                time.sleep(0.2)
        live = Tab(port)
        live.open(live_url + "?autoplay=0")
        live.wait("window.dash?.version >= 1 && window.dash.firstMs > 0", "the scene of a run", 120)
        first = live.value("window.dash.version")
        live.wait(f"window.dash.version > {first}", "a newer scene of the run", 120)
        live.screenshot(out / "live.png")
        told = live.value("document.getElementById('numbers').textContent")
        check("of 4000" in told and "Gaussians" in told, f"a run tells its page: {told}")
        step = lambda: live.value("state().then((told) => told.step)")
        live.value("document.getElementById('pause').click()")
        live.wait("state().then((told) => told.paused && told.waits)", "pause")
        paused = step()
        check(paused > 0, f"paused, the run waits at step {paused}")
        # The page hears of it when it asks the next time.
        live.wait("document.getElementById('pause').textContent === 'go on'", "the button says what it does")
        live.value("document.getElementById('pause').click()")
        live.wait(f"state().then((told) => !told.waits && told.step > {paused})", "the run goes on")
        check(not live.errors, f"no error on the console {live.errors[:2]}")
    finally:
        training.terminate()
        check(training.wait() == 143, "a signal stops the run, page or not")

    without = Tab(port, "Object.defineProperty(Navigator.prototype, 'gpu', { get: () => undefined });")
    without.open(url)
    without.wait("document.getElementById('says')?.textContent.includes('WebGPU')", "a browser without WebGPU is told")
    without.wait("document.querySelector('#says img')?.naturalWidth > 0", "and gets the poster")
    without.screenshot(out / "without_webgpu.png")
    check(not without.errors, f"a browser without WebGPU is told, and gets the poster {without.errors[:2]}")
finally:
    browser.terminate()
    browser.wait()
    shutil.rmtree(profile, ignore_errors=True)
print("the page holds")
