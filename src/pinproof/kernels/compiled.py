"""The decorators that compile kernels: at the first call, with a cache on disk, without the GIL, with a log message.

Numba's cache detects changes of the file of a kernel, but not of the kernels that it calls. The folder of the cache
therefore carries a hash of all sources of this package: a change of any of them starts a new folder.
"""

from __future__ import annotations

import fcntl
import hashlib
import logging
import os
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numba
from numba.core import event
from numba.core.compiler_lock import global_compiler_lock

__all__ = ["cache_folder", "compiled", "inlined"]

logger = logging.getLogger("pinproof")


def _fingerprint() -> str:
    digest = hashlib.sha256()
    for source in sorted(Path(__file__).parent.glob("*.py")):
        digest.update(source.name.encode() + source.read_bytes())
    return digest.hexdigest()[:16]


def _writable(folder: Path) -> bool:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return True
    except OSError:
        return False


def cache_folder() -> Path | None:
    """The folder of the compiled kernels; None if no folder is writable.

    It is below ``NUMBA_CACHE_DIR`` if that is set, else in the user's cache, else in the temporary folder.
    """
    name = f"kernels-{_fingerprint()}"
    own = f"pinproof-{os.getuid() if hasattr(os, 'getuid') else 'user'}"
    places = [
        Path(os.environ.get("XDG_CACHE_HOME") or Path("~/.cache").expanduser()) / "pinproof",
        Path(tempfile.gettempdir()) / own,
    ]
    if os.environ.get("NUMBA_CACHE_DIR"):
        places.insert(0, Path(os.environ["NUMBA_CACHE_DIR"]) / "pinproof")
    return next((place / name for place in places if _writable(place / name)), None)


CACHE = cache_folder()


def compiled(function: Callable[..., Any]) -> Any:
    """Compile a kernel at its first call and store it in :func:`cache_folder`.

    It runs without the GIL. Products and sums may be fused, which only reduces rounding; no other rule of floating
    point is relaxed (NaN remains NaN).
    """
    return _compiled(function, forceinline=False)


def inlined(function: Callable[..., Any]) -> Any:
    """As :func:`compiled`, and inlined into its callers, for parts of one hot loop.

    A call between kernels passes every array as ten numbers on the stack, which is most of the cost of small parts.
    """
    return _compiled(function, forceinline=True)


def _compiled(function: Callable[..., Any], **options: bool) -> Any:
    before = numba.config.CACHE_DIR
    # Numba reads the setting while it decorates; it is restored so that the user's functions keep their own folder.
    numba.config.CACHE_DIR = str(CACHE or "")
    try:
        kernel = numba.njit(cache=CACHE is not None, nogil=True, error_model="numpy", fastmath={"contract"}, **options)(
            function
        )
    finally:
        numba.config.CACHE_DIR = before
    if CACHE is not None:
        kernel.compile = _by_one_process(kernel.compile, CACHE / f"{function.__module__}.{function.__name__}.lock")
    return kernel


def _by_one_process(compile_or_load: Callable[[Any], Any], lock: Path) -> Callable[[Any], Any]:
    """Let one process compile a kernel while the others wait for it and then load the result.

    A kernel locks itself before those that it calls, and no kernel calls itself, so that processes cannot deadlock;
    numba's own lock, which is taken first, serialises the threads of one process.
    """

    def by_one(signature: Any) -> Any:
        with global_compiler_lock, _held(lock):
            return compile_or_load(signature)

    return by_one


@contextmanager
def _held(lock: Path) -> Iterator[None]:
    """Hold a file lock, which is released if the process dies; continue without one if locks are not supported."""
    try:
        file = lock.open("a")
    except OSError:
        yield
        return
    with file:
        with suppress(OSError):
            fcntl.flock(file, fcntl.LOCK_EX)
        yield


class _Notice(event.Listener):  # type: ignore[misc]  # numba is untyped here
    """Logs which kernel is being compiled; if kernels call each other, the outermost."""

    def __init__(self) -> None:
        self._depth = 0

    def on_start(self, event: Any) -> None:
        function = event.data["dispatcher"].py_func
        if not function.__module__.startswith(__package__):
            return
        self._depth += 1
        if self._depth == 1:
            kept = "once" if CACHE is not None else "for this process only, as no cache folder can be written to"
            room = function.__module__.removeprefix(f"{__package__}.")
            logger.warning("pinproof: compiling %s.%s for this machine, %s ...", room, function.__name__, kept)

    def on_end(self, event: Any) -> None:
        if event.data["dispatcher"].py_func.__module__.startswith(__package__):
            self._depth -= 1


event.register("numba:compile", _Notice())
