"""A headless Chromium, controlled over a pair of pipes (the Chrome DevTools protocol).

One browser serves all tests. It cannot reach a network (every name but 127.0.0.1 resolves to nothing), and it records
its requests.
"""

from __future__ import annotations

import base64
import contextlib
import io
import itertools
import json
import os
import queue
import shutil
import subprocess
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

FLAGS = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--disable-dev-shm-usage",
    "--hide-scrollbars",
    "--host-resolver-rules=MAP * ~NOTFOUND , EXCLUDE 127.0.0.1",
)
PATIENCE = 1800.0
"""Seconds after which a test stops waiting for the browser; far longer than any answer takes on a busy machine."""


LITTLE_TO_DRAW = """{
  const next = window.requestAnimationFrame.bind(window);
  window.requestAnimationFrame = (draw) => setTimeout(() => next(draw), 80);
  const context = HTMLCanvasElement.prototype.getContext;
  HTMLCanvasElement.prototype.getContext = function (kind, wishes) {
    return context.call(this, kind, {...wishes, antialias: false});
  };
  for (const name of ["drawArrays", "drawElements", "drawArraysInstanced", "drawElementsInstanced"]) {
    const draw = WebGL2RenderingContext.prototype[name];
    WebGL2RenderingContext.prototype[name] = function (...wishes) {
      if (window.pixels) draw.apply(this, wishes);
    };
  }
}"""
"""A page prepares at most twelve frames a second, without smooth edges, because here the processor draws.

60 frames a second take most of its time, and smooth edges twice the time per frame. What a frame draws is drawn while
``window.pixels`` is true, which it is while a test takes a picture (``Page.pixels``).
"""


def find_browser() -> str | None:
    data = os.environ.get("CHROMIUM")
    return data or next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)


class Browser:
    def __init__(self, executable: str, profile: Path) -> None:
        to_read, self._write = os.pipe()
        self._read, to_write = os.pipe()
        ends = (to_read, to_write)

        def plumb() -> None:
            # Chromium reads commands from descriptor 3 and writes answers to 4
            low, high = (os.dup2(end, 40 + k) for k, end in enumerate(ends))
            os.dup2(low, 3)
            os.dup2(high, 4)

        self._process = subprocess.Popen(
            [executable, *FLAGS, "--remote-debugging-pipe", f"--user-data-dir={profile}", "about:blank"],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            close_fds=False,
            preexec_fn=plumb,
        )
        for end in ends:
            os.close(end)
        self._numbers = itertools.count(1)
        self._answers: dict[int, queue.SimpleQueue[dict[str, Any]]] = {}
        self._pages: dict[str, Page] = {}
        self._reader = threading.Thread(target=self._listen, daemon=True)
        self._reader.start()

    def send(self, method: str, session: str | None = None, /, **params: Any) -> dict[str, Any]:
        number = next(self._numbers)
        answer = self._answers[number] = queue.SimpleQueue()
        message: dict[str, Any] = {"id": number, "method": method, "params": params}
        if session is not None:
            message["sessionId"] = session
        payload = json.dumps(message).encode() + b"\0"
        while payload:
            payload = payload[os.write(self._write, payload) :]
        try:
            got = answer.get(timeout=PATIENCE)
        except queue.Empty:
            raise TimeoutError(f"the browser did not answer {method} within {PATIENCE} s") from None
        if "error" in got:
            raise RuntimeError(f"{method}: {got['error']}")
        result: dict[str, Any] = got["result"]
        return result

    def open(self, url: str, width: int = 960, height: int = 540, *, ready: str = "window.pinproof?.ready") -> Page:
        target = self.send("Target.createTarget", url="about:blank")["targetId"]
        session = self.send("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        page = self._pages[session] = Page(self, target, session)
        for domain in ("Runtime", "Log", "Network", "Page"):
            page.send(f"{domain}.enable")
        page.resize(width, height)
        page.send("Page.addScriptToEvaluateOnNewDocument", source=LITTLE_TO_DRAW)
        page.send("Page.navigate", url=url)
        page.wait_for(ready)
        return page

    def close(self) -> None:
        with contextlib.suppress(Exception):
            self.send("Browser.close")
        try:
            self._process.wait(timeout=10)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        os.close(self._write)
        self._reader.join(5)
        os.close(self._read)

    def _listen(self) -> None:
        rest = b""
        while chunk := os.read(self._read, 1 << 16):
            *messages, rest = (rest + chunk).split(b"\0")
            for raw in messages:
                message = json.loads(raw)
                if "id" in message:
                    self._answers.pop(message["id"]).put(message)
                elif message.get("sessionId") in self._pages:
                    self._pages[message["sessionId"]].note(message["method"], message["params"])


class Page:
    """A tab: its log, its requests and its content."""

    def __init__(self, browser: Browser, target: str, session: str) -> None:
        self._browser, self._target, self._session = browser, target, session
        self.complaints: list[str] = []
        self.requests: list[str] = []

    def send(self, method: str, **params: Any) -> dict[str, Any]:
        return self._browser.send(method, self._session, **params)

    def evaluate(self, script: str) -> Any:
        got = self.send("Runtime.evaluate", expression=script, returnByValue=True, awaitPromise=True)
        if "exceptionDetails" in got:
            raise RuntimeError(f"{script[:80]}: {got['exceptionDetails']}")
        return got["result"].get("value")

    def wait_for(self, condition: str, seconds: float = PATIENCE) -> None:
        end = time.monotonic() + seconds
        while not self._holds(condition):
            if time.monotonic() > end:
                raise TimeoutError(f"{condition} did not come true; the page says {self.complaints}")
            time.sleep(0.02)

    def _holds(self, condition: str) -> bool:
        try:
            return bool(self.evaluate(f"Boolean({condition})"))
        except RuntimeError as error:
            if "navigated" in str(error):  # the page is being loaded anew: not yet
                return False
            raise

    def text(self, selector: str) -> str:
        found: str = self.evaluate(f"document.querySelector({json.dumps(selector)}).innerText")
        return found

    def seek(self, time: float) -> None:
        """Show the motion at a time (s), paused."""
        self.evaluate(f"pinproof.seek({time})")

    def node(self, *path: str, attribute: str = "position.toArray()") -> Any:
        """An attribute of the object at a place of the tree, by default its position."""
        return self.evaluate(f"pinproof.viewer.scene_tree.find({json.dumps(path)}).object.{attribute}")

    def click(self, selector: str) -> None:
        self.evaluate(f"document.querySelector({json.dumps(selector)}).click()")

    def key(self, name: str) -> None:
        """Press and release a key."""
        for kind in ("keyDown", "keyUp"):
            self.send("Input.dispatchKeyEvent", type=kind, key=name, code=name)

    def drag(self, start: tuple[float, float], end: tuple[float, float], steps: int = 8, until: str = "") -> None:
        """Press the mouse at a place of the window, move it in steps, and release it once a condition is true."""
        for k, kind in enumerate(("mouseMoved", "mousePressed", *["mouseMoved"] * steps, "mouseReleased")):
            share = min(max(k - 1, 0) / steps, 1.0)
            x, y = (a + share * (b - a) for a, b in zip(start, end, strict=True))
            if kind == "mouseReleased" and until:
                self.wait_for(until, 60.0)
            self.send("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", buttons=1, clickCount=1)
        self.settle()  # Chromium delivers moves of the mouse with the next frame

    def resize(self, width: int, height: int) -> None:
        size = {"width": width, "height": height}
        self.send("Emulation.setDeviceMetricsOverride", **size, deviceScaleFactor=1, mobile=False)

    def texts(self, selector: str) -> list[str]:
        """The text of each element."""
        found: list[str] = self.evaluate(
            f"Array.from(document.querySelectorAll({json.dumps(selector)}), (one) => one.textContent)"
        )
        return found

    @contextlib.contextmanager
    def pixels(self) -> Iterator[None]:
        """Frames are drawn inside this block, which begins with the first one."""
        self.evaluate("window.pixels = true; pinproof.viewer.set_dirty()")
        self.settle()
        yield
        self.evaluate("window.pixels = false")

    def settle(self) -> None:
        """Wait until a frame is complete."""
        self.evaluate("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")

    def canvas(self) -> np.ndarray:
        """(height, width, 3) what the 3D view shows, without anything that lies over it."""
        take = "(() => { window.pixels = true; try { return pinproof.viewer.capture_image(); }"
        url: str = self.evaluate(take + " finally { window.pixels = false; } })()")
        return _pixels(base64.b64decode(url.split(",", 1)[1]))

    def screenshot(self, path: Path | None = None) -> np.ndarray:
        """(height, width, 3) the complete page."""
        with self.pixels():
            data = base64.b64decode(self.send("Page.captureScreenshot", format="png")["data"])
        if path is not None:
            path.write_bytes(data)
        return _pixels(data)

    def canvas_size(self) -> int:
        """Pixels of the canvas."""
        canvas = "pinproof.viewer.renderer.domElement"
        size: int = self.evaluate(f"{canvas}.width * {canvas}.height")
        return size

    def link_pixels(self) -> dict[str, int]:
        """Pixels of the canvas that belong to each link: one flat colour a link, everything else black, nothing lit."""
        names = self.evaluate(PAINT_LINKS)
        picture = self.canvas().astype(int)
        flat = picture[..., 0] * 65536 + picture[..., 1] * 256 + picture[..., 2]
        return {name: int((flat == (k + 1) * COLOUR_STEP).sum()) for k, name in enumerate(names)}

    def close(self) -> None:
        self._browser.send("Target.closeTarget", targetId=self._target)

    def note(self, method: str, params: dict[str, Any]) -> None:
        if method == "Runtime.consoleAPICalled" and params["type"] in ("error", "warning", "assert"):
            self.complaints.append(" ".join(str(a.get("value", a.get("description"))) for a in params["args"]))
        elif method == "Runtime.exceptionThrown":
            self.complaints.append(str(params["exceptionDetails"]))
        elif method == "Log.entryAdded" and params["entry"]["level"] in ("error", "warning"):
            if "GL Driver Message" not in params["entry"]["text"]:  # reading pixels stalls a GPU; tests read pixels
                self.complaints.append(params["entry"]["text"])
        elif method == "Network.requestWillBeSent":
            self.requests.append(params["request"]["url"])


COLOUR_STEP = 0x040302  # neighbours differ in every channel, and blends at edges hit no other link's colour by rule

PAINT_LINKS = f"""(() => {{
  const viewer = pinproof.viewer, THREE = MeshCat.THREE;
  viewer.animator.pause();
  viewer.renderer.shadowMap.enabled = false;
  const flat = (color) => new THREE.MeshBasicMaterial({{ color, side: THREE.DoubleSide, fog: false }});
  const black = flat(0);
  viewer.scene.background = new THREE.Color(0);
  viewer.scene.traverse((thing) => {{
    if (thing.isLineSegments) thing.visible = false;
    if (thing.isMesh) thing.material = black;
  }});
  const robot = viewer.scene_tree.find(["robot"]);
  const names = Object.keys(robot.children).filter((name) => robot.children[name].children.visual);
  names.forEach((name, k) => {{
    const paint = flat((k + 1) * {COLOUR_STEP});
    robot.children[name].object.traverse((thing) => {{ if (thing.isMesh) thing.material = paint; }});
  }});
  return names;
}})()"""


def _pixels(png: bytes) -> np.ndarray:
    from PIL import Image  # comes with meshcat

    return np.asarray(Image.open(io.BytesIO(png)).convert("RGB"))
