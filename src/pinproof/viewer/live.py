"""The live view: the page served on the loopback interface, and updated while it is open."""

from __future__ import annotations

import json
import logging
import queue
import threading
from dataclasses import dataclass, field, replace
from html import escape
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from types import TracebackType
from typing import TYPE_CHECKING, Any
from uuid import uuid4

import numpy.typing as npt

from pinproof.collision import Certificate, CheckResult, Scene
from pinproof.errors import ViewerError
from pinproof.ik import SelfMotion, SelfMotionCurve
from pinproof.model import JointGroup
from pinproof.motion import Trajectory
from pinproof.viewer.page import Page, render_page
from pinproof.viewer.picture import Picture, PictureContent
from pinproof.viewer.wire import node_path, transform_command

if TYPE_CHECKING:
    from typing_extensions import Unpack

LOOPBACK = "127.0.0.1"
"""Only this machine can open the page. The server of meshcat listens on every interface."""

HEARTBEAT = 10.0
"""Seconds between messages that keep the connection to a page alive and detect that the page was closed."""

RETRY = 1000.0
"""Milliseconds after which a page that lost the connection tries to reconnect."""

FRAME_HEIGHT = 480
"""Height of the page in a notebook, in pixels."""

CLOSE_TIMEOUT = 2.0
"""Seconds that :meth:`LiveView.close` waits for the server thread."""

log = logging.getLogger(__name__)

Event = tuple[str, str]


def show(
    arm: JointGroup,
    scene: Scene | None = None,
    trajectory: Trajectory | None = None,
    *,
    port: int = 0,
    open_browser: bool = False,
    **content: Unpack[PictureContent],
) -> LiveView:
    """Show an arm live in the browser; the function returns immediately.

    An open page follows the changes made through the returned object. A page that loses the connection reconnects as
    soon as a view is served at the same address again. In a Jupyter notebook, the returned object as the last
    expression of a cell displays the page inside the notebook.

    Parameters
    ----------
    arm, scene, trajectory, **content
        As in :func:`pinproof.write_html`.
    port
        The port on 127.0.0.1; 0 selects a free port.
    open_browser
        Whether to open the page in the default browser.

    Returns
    -------
    LiveView
        Has the address of the page as ``url``, and ends with ``close()`` or with the program.
    """
    view = LiveView(Picture(arm, scene, trajectory, **content), port=port)
    if open_browser:
        import webbrowser

        webbrowser.open(view.url)
    return view


class LiveView:
    """A page served on 127.0.0.1 by a background thread. Created by :func:`show`; also a context manager."""

    def __init__(self, picture: Picture, *, port: int = 0) -> None:
        self._page_id, self._page = _new_page(picture)
        self._picture = picture
        self._last_move: Event | None = None
        self._listeners: set[queue.SimpleQueue[Event]] = set()
        self._lock = threading.Lock()
        self._closed = threading.Event()
        # The server starts at once, so that a port that is in use is an error of the caller
        try:
            self._server = _Server((LOOPBACK, port), self)
        except (OSError, OverflowError) as error:
            raise ViewerError(
                f"port {port} of {LOOPBACK} cannot be used: {error}; port=0 selects a free one"
            ) from error
        serve = self._server.serve_forever
        self._thread = threading.Thread(target=serve, args=(0.1,), name="pinproof view", daemon=True)
        self._thread.start()

    @property
    def url(self) -> str:
        """The address of the page."""
        return f"http://{LOOPBACK}:{self._server.server_address[1]}/"

    def move_to(self, q: npt.ArrayLike) -> None:
        """Show the arm at the configuration q (n,). A motion or a collision check shown before is removed."""
        configuration = self._picture.arm.configuration(q)
        # A page of a motion or a check would contradict the new configuration, so it is replaced
        if self._page.shown.moving or self._picture.check is not None:
            self._show(
                replace(self._picture, trajectory=None, certificate=None, check=None, q=configuration, elbow=None)
            )
            return
        stage, frames = self._page.shown.stage, self._page.shown.frames
        names = [node_path("robot", link.name) for link in stage.links]
        names += [node_path("frames", name) for name in frames]
        placed = [*stage.link_poses(configuration), *stage.frame_poses(configuration, frames)]
        commands = [transform_command(name, pose) for name, pose in zip(names, placed, strict=True)]
        with self._lock:
            self._last_move = ("message", json.dumps(commands))
            self._send(self._last_move)

    def replace(
        self,
        scene: Scene | None,
        trajectory: Trajectory | None = None,
        *,
        certificate: Certificate | None = None,
        q: npt.ArrayLike | None = None,
        ghosts: npt.ArrayLike | None = None,
        check: CheckResult | None = None,
        elbow: SelfMotion | SelfMotionCurve | None = None,
    ) -> None:
        """Show another scene, motion or self-motion of the same arm; open pages reload automatically."""
        picture = replace(self._picture, scene=scene, trajectory=trajectory, certificate=certificate, elbow=elbow)
        self._show(replace(picture, q=q, ghosts=ghosts, check=check))

    def snapshot(self) -> PageSnapshot:
        """The present page as a value that a notebook displays and saves; it needs no server and no connection."""
        return PageSnapshot(render_page(self._picture).text)

    def wait(self, timeout: float | None = None) -> bool:
        """Wait until another thread closes the view, or for ``timeout`` seconds; return whether it is closed."""
        return self._closed.wait(timeout)

    def close(self) -> None:
        """Stop the server and free the port. Open pages keep their picture. Further calls have no effect."""
        if self._closed.is_set():
            return
        self._closed.set()
        with self._lock:
            self._send(("closed", ""))
        self._server.shutdown()
        self._server.server_close()
        self._thread.join(CLOSE_TIMEOUT)

    def __enter__(self) -> LiveView:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def __repr__(self) -> str:
        return f"LiveView({self.url}{', closed' if self._closed.is_set() else ''})"

    def _repr_html_(self) -> str:
        if self._closed.is_set():
            return f"<p>The live view at {self.url} is closed.</p>"
        remark = "The browser must run on the machine of the kernel; otherwise display view.snapshot()."
        link = f'<a href="{self.url}" target="_blank">{self.url}</a>'
        return f"{_frame('src', self.url)}<p>Live view at {link}. {remark}</p>"

    def _show(self, picture: Picture) -> None:
        page_id, page = _new_page(picture)
        with self._lock:
            self._page_id, self._page, self._picture, self._last_move = page_id, page, picture, None
            self._send(("page", page_id))

    def _send(self, event: Event) -> None:
        for listener in self._listeners:
            listener.put(event)

    def _subscribe(self) -> queue.SimpleQueue[Event]:
        listener: queue.SimpleQueue[Event] = queue.SimpleQueue()
        with self._lock:
            listener.put(("page", self._page_id))
            if self._closed.is_set():
                listener.put(("closed", ""))
            elif self._last_move is not None:
                listener.put(self._last_move)
            self._listeners.add(listener)
        return listener

    def _unsubscribe(self, listener: queue.SimpleQueue[Event]) -> None:
        with self._lock:
            self._listeners.discard(listener)


@dataclass(frozen=True)
class PageSnapshot:
    """A page that a Jupyter notebook displays and saves in its output; ``text`` is its complete HTML."""

    text: str = field(repr=False)

    def _repr_html_(self) -> str:
        return _frame("srcdoc", self.text)


def _frame(source: str, value: str) -> str:
    style = f"width:100%;height:{FRAME_HEIGHT}px;border:0"
    return f'<iframe title="pinproof" style="{style}" {source}="{escape(value)}"></iframe>'


def _new_page(picture: Picture) -> tuple[str, Page]:
    """A page and its unique identifier. A page that reconnects compares identifiers and reloads if they differ."""
    page_id = uuid4().hex
    return page_id, render_page(picture, live=page_id)


class _Server(ThreadingHTTPServer):
    daemon_threads = True

    def __init__(self, address: tuple[str, int], view: LiveView) -> None:
        self.view = view
        super().__init__(address, _Handler)

    def handle_error(self, request: Any, client_address: Any) -> None:  # noqa: ARG002
        """Log a failed request; the standard library would print it."""
        log.debug("request of %s failed", client_address, exc_info=True)


class _Handler(BaseHTTPRequestHandler):
    server: _Server

    def do_GET(self) -> None:
        """Send the page, or the stream of events."""
        # A foreign site may resolve its own name to 127.0.0.1 (DNS rebinding); the Host header still states that name.
        if self.headers.get("Host", "").rsplit(":", 1)[0] not in (LOOPBACK, "localhost"):
            self.send_error(HTTPStatus.FORBIDDEN)
        elif self.path == "/":
            self._answer("text/html; charset=utf-8", self.server.view._page.text.encode("utf-8"))
        elif self.path == "/events":
            self._events()
        else:
            self.send_error(HTTPStatus.NOT_FOUND)

    def log_message(self, format: str, *args: Any) -> None:  # noqa: A002 (the standard library's name)
        """Log a request; the standard library would print it."""
        log.debug(format, *args)

    def _answer(self, kind: str, body: bytes | None) -> None:
        self.send_response(HTTPStatus.OK)
        self.send_header("Content-Type", kind)
        self.send_header("Cache-Control", "no-store")
        self.send_header("X-Content-Type-Options", "nosniff")
        if body is not None:
            self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        if body is not None:
            self.wfile.write(body)

    def _events(self) -> None:
        """Send server-sent events until the page or the view is closed."""
        view = self.server.view
        listener = view._subscribe()
        try:
            self._answer("text/event-stream", None)
            self.wfile.write(f"retry: {RETRY:.0f}\n\n".encode())
            name = ""
            while name != "closed":
                try:
                    name, data = listener.get(timeout=HEARTBEAT)
                    self.wfile.write(f"event: {name}\ndata: {data}\n\n".encode())
                except queue.Empty:
                    self.wfile.write(b": heartbeat\n\n")
        except OSError:
            log.debug("a page was closed")
        finally:
            view._unsubscribe(listener)
