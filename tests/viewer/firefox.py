"""A Firefox on a virtual screen, controlled by its own protocol for automation (Marionette): JSON over a local socket.

Without a screen Firefox has no WebGL, so that Xvfb provides one.
"""

from __future__ import annotations

import json
import os
import shutil
import socket
import subprocess
import time
from pathlib import Path
from typing import Any

PATIENCE = 240.0
"""Seconds after which a test stops waiting for the browser."""

PREFERENCES = {
    "marionette.port": 0,  # any free one, which Firefox writes to a file
    "webgl.force-enabled": True,
    "app.update.enabled": False,
    "browser.shell.checkDefaultBrowser": False,
    "datareporting.policy.dataSubmissionEnabled": False,
    "toolkit.telemetry.reportingpolicy.firstRun": False,
    "network.proxy.type": 1,  # a proxy that does not exist: no network
    "network.proxy.http": "127.0.0.1",
    "network.proxy.http_port": 9,
    "network.proxy.ssl": "127.0.0.1",
    "network.proxy.ssl_port": 9,
}


def find_firefox() -> str | None:
    """The program, if there is a virtual screen for it too."""
    return shutil.which("Xvfb") and next(filter(None, map(shutil.which, ("firefox-esr", "firefox"))), None)


class Firefox:
    def __init__(self, executable: str, profile: Path, width: int = 1000, height: int = 760) -> None:
        profile.mkdir()
        lines = (f"user_pref({json.dumps(name)}, {json.dumps(value)});" for name, value in PREFERENCES.items())
        (profile / "user.js").write_text("\n".join(lines), encoding="utf-8")
        # Xvfb writes the number of its screen to a pipe.
        self._programs: list[subprocess.Popen[bytes]] = []
        reader, writer = os.pipe()
        quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        screen = ["Xvfb", "-displayfd", str(writer), "-nolisten", "tcp", "-screen", "0", "1400x1000x24"]
        self._programs.append(subprocess.Popen(screen, pass_fds=[writer], **quiet))
        os.close(writer)
        with os.fdopen(reader, "rb") as file:
            number = file.readline().decode().strip()
        words = [executable, "--marionette", "--no-remote", "--profile", str(profile)]
        words += [f"--width={width}", f"--height={height}"]
        environment = {**os.environ, "DISPLAY": f":{number}", "LIBGL_ALWAYS_SOFTWARE": "1", "HOME": str(profile)}
        environment.pop("WAYLAND_DISPLAY", None)
        self._process = subprocess.Popen(words, env=environment, **quiet)
        self._programs.append(self._process)
        self._count, self._socket = 0, None
        end, port = time.monotonic() + PATIENCE, profile / "MarionetteActivePort"
        while not (port.exists() and port.read_text().strip()):
            if time.monotonic() > end or self._process.poll() is not None:
                self.close()
                raise TimeoutError("Firefox does not listen")
            time.sleep(0.05)
        self._socket = socket.create_connection(("127.0.0.1", int(port.read_text())), timeout=PATIENCE)
        self._file = self._socket.makefile("rb")
        self._message()  # its greeting
        self.send("WebDriver:NewSession", capabilities={"alwaysMatch": {"acceptInsecureCerts": True}})

    def _message(self) -> Any:
        size = b""
        while (byte := self._file.read(1)) not in (b":", b""):
            size += byte
        return json.loads(self._file.read(int(size)))

    def send(self, command: str, **parameters: Any) -> Any:
        self._count += 1
        payload = json.dumps([0, self._count, command, parameters]).encode()
        self._socket.sendall(b"%d:%s" % (len(payload), payload))
        _, number, error, result = self._message()
        assert number == self._count
        if error is not None:
            raise RuntimeError(f"{command}: {error['message']}")
        return result

    def open(self, url: str) -> None:
        self.send("WebDriver:Navigate", url=url)
        self.wait_for("window.pinproof?.ready")

    def evaluate(self, script: str) -> Any:
        return self.send("WebDriver:ExecuteScript", script=f"return ({script});", args=[], sandbox=None)["value"]

    def wait_for(self, condition: str, seconds: float = PATIENCE) -> None:
        end = time.monotonic() + seconds
        while not self.evaluate(f"Boolean({condition})"):
            if time.monotonic() > end:
                raise TimeoutError(f"{condition} did not come true")
            time.sleep(0.05)

    def drag(self, start: tuple[float, float], end: tuple[float, float], steps: int = 6) -> None:
        """Press the mouse at a place of the window, move it in steps, and release it."""
        (x, y), (to_x, to_y) = start, end
        places = [(x + (to_x - x) * k / steps, y + (to_y - y) * k / steps) for k in range(steps + 1)]
        moves = [{"type": "pointerMove", "x": round(x), "y": round(y), "duration": 20} for x, y in places]
        down, up = ({"type": kind, "button": 0} for kind in ("pointerDown", "pointerUp"))
        actions = [moves[0], down, *moves[1:], up]
        mouse = {"type": "pointer", "id": "mouse", "parameters": {"pointerType": "mouse"}, "actions": actions}
        self.send("WebDriver:PerformActions", actions=[mouse])

    def click(self, selector: str) -> None:
        """Click at the middle of an element."""
        one = f"document.querySelector({json.dumps(selector)})"
        self.evaluate(f"{one}.scrollIntoView({{block: 'nearest'}})")
        x, y, width, height = self.evaluate(f"((b) => [b.x, b.y, b.width, b.height])({one}.getBoundingClientRect())")
        self.drag((x + width / 2, y + height / 2), (x + width / 2, y + height / 2), 1)

    def keys(self, text: str) -> None:
        """Press and release keys; those without a character have the codes of WebDriver."""
        actions = [{"type": kind, "value": key} for key in text for kind in ("keyDown", "keyUp")]
        self.send("WebDriver:PerformActions", actions=[{"type": "key", "id": "keyboard", "actions": actions}])

    def close(self) -> None:
        if self._socket is not None:
            self._file.close()
            self._socket.close()
        for program in reversed(self._programs):
            program.terminate()
            try:
                program.wait(timeout=20)
            except subprocess.TimeoutExpired:
                program.kill()
                program.wait()
