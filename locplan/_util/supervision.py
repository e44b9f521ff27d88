"""Ctrl-C within a second: a process that works, and one that outlives it and cleans up.

Python acts on a signal only between two of its own instructions. While a kernel runs or is
compiled, or a picture is drawn, that may take many seconds, and libraries lose an interrupt that
comes within their callbacks. So the first process does nothing but wait. It passes a signal on,
gives the second one a short time to end in good order, kills it otherwise, and removes its
temporary folders. Where nobody outlives a process that is killed, the next one that needs a
temporary folder in the same place removes them: it knows by their locks that nobody needs them.
"""

from __future__ import annotations

import os
import re
import shutil
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from tempfile import gettempdir, mkdtemp
from typing import Any

ASIDE = "aside"
"""Folder in a temporary one of what is moved aside; it returns to its place unless replaced."""
PREFIX = ".locplan-tmp-"
_NAME = re.compile(re.escape(PREFIX) + r"[a-z0-9_]{8}")
_listener: tuple[int, int] | None = None
"""Both ends of the pipe that names temporary folders to the process that outlives this one."""
_there: set[str] = set()
"""The temporary folders of this process."""


@contextmanager
def temporary_folder(folder: Path | None = None) -> Iterator[Path]:
    """Yield a new folder in `folder`, or where the system has such, that is removed at last.

    Those that killed processes have left there are removed first.
    """
    parent = os.path.abspath(folder or gettempdir())
    remove_abandoned(parent)
    made, lock = _made(parent)
    _there.add(made)
    if _listener is not None:
        _name(*_listener, made)
    try:
        yield Path(made)
    finally:
        remove(made)
        _there.discard(made)
        if lock is not None:
            os.close(lock)


def _name(heard: int, said: int, *folders: str) -> None:
    """Name temporary folders to the process that outlives this one."""
    try:
        os.write(said, b"".join(os.fsencode(each) + b"\0" for each in folders))
    except BlockingIOError:  # names are read at the end: it is full of folders that are long gone
        with suppress(BlockingIOError):
            os.read(heard, 1 << 20)
        _name(heard, said, *_there)


def remove_abandoned(folder: str | os.PathLike[str]) -> None:
    """Remove the temporary folders in a folder that killed processes have left."""
    with suppress(OSError):  # it cannot be listed, or is gone
        for name in filter(_NAME.fullmatch, os.listdir(folder)):
            path = os.path.join(folder, name)
            with suppress(OSError):  # a process holds it, or it is another user's
                lock = _lock(path, wait=False)
                if lock is not None:
                    remove(path)
                    os.close(lock)


def remove(temporary: str) -> None:
    """Remove a temporary folder, after what was moved aside has returned to its place."""
    aside = os.path.join(temporary, ASIDE)
    for name in os.listdir(aside) if os.path.isdir(aside) else ():
        place = os.path.join(os.path.dirname(temporary), name)
        if not os.path.lexists(place):
            os.rename(os.path.join(aside, name), place)
    shutil.rmtree(temporary, ignore_errors=True)


def remove_named(said: bytes) -> None:
    """Remove those temporary folders, named each with a null behind, that are still there."""
    for temporary in map(os.fsdecode, said.split(b"\0")[:-1]):
        with suppress(OSError):
            remove(temporary)


def _made(parent: str) -> tuple[str, int | None]:
    """A new folder, and the descriptor of its lock, None where there are no locks."""
    while True:
        made = mkdtemp(prefix=PREFIX, dir=parent)
        try:
            return made, _lock(made, wait=True)
        except FileNotFoundError:
            continue  # another process took it for abandoned before it was locked
        except OSError:
            return made, None


def _lock(folder: str, *, wait: bool) -> int | None:
    """Descriptor that holds the lock of a folder until it is closed; None on Windows.

    It is an OSError if another process holds it, or has removed the folder meanwhile.
    """
    try:
        import fcntl
    except ModuleNotFoundError:
        return None
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX if wait else fcntl.LOCK_EX | fcntl.LOCK_NB)
        os.stat(folder)
    except OSError:
        os.close(descriptor)
        raise
    return descriptor


INTERRUPTED = 128 + signal.SIGINT
"""Exit code after Ctrl-C."""
PASSED_ON = [
    getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)
]
"""Signals that the first process passes on to the second."""


def supervised(work: Callable[[], None]) -> int:
    """Run `work` in a process of its own, and return its exit code.

    It does not return in the process that works, unless the system has no fork: there the only
    process works.
    """
    if not hasattr(os, "fork"):
        work()
        return 0

    passed_on = {each for each in PASSED_ON if signal.getsignal(each) != signal.SIG_IGN}
    heard, said = os.pipe()
    for end in (heard, said):  # it tells of what is left; nobody waits for that
        os.set_blocking(end, False)
    first = os.getpid()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, passed_on)
    process = os.fork()
    if not process:
        _work(work, (heard, said), first, signal.SIGINT in passed_on, before)
    os.close(said)
    asked: list[int] = []

    def send(number: int) -> None:
        with suppress(ProcessLookupError):  # it has just ended
            os.kill(process, number)

    def pass_on(number: int, _: object) -> None:
        if not asked:
            # Time that a process has to end in good order after a signal [s].
            signal.setitimer(signal.ITIMER_REAL, 0.5)
        asked.append(number)
        send(number)

    signal.signal(signal.SIGALRM, lambda *_: send(signal.SIGKILL))
    for each in passed_on:
        signal.signal(each, pass_on)
    signal.pthread_sigmask(signal.SIG_SETMASK, before)
    _, status = os.waitpid(process, 0)
    signal.setitimer(signal.ITIMER_REAL, 0)
    for each in passed_on:
        signal.signal(each, signal.SIG_IGN)
    with suppress(BlockingIOError):  # there is nothing to hear
        remove_named(os.read(heard, 1 << 20))
    return _exit_code(asked, os.waitstatus_to_exitcode(status))


def end_if_supervised(code: int = INTERRUPTED) -> None:
    """End this process at once after an interrupt if another one cleans up and says so.

    The exit code is another one where an interrupt is the usual end.

    Threads that are within a kernel are not awaited.
    """
    if _listener is not None:
        os._exit(code)


def end_with_parent(parent: int) -> None:
    """Let the system end this process with its parent, even while it hangs (on Linux)."""
    if sys.platform == "linux":
        import ctypes

        ctypes.CDLL(None).prctl(1, signal.SIGKILL)  # PR_SET_PDEATHSIG
        if os.getppid() != parent:
            sys.exit()


def _work(
    work: Callable[[], None],
    pipe: tuple[int, int],
    parent: int,
    interruptible: bool,
    mask: set[Any],
) -> None:
    """Do the work in the second process, and end it."""
    global _listener
    _listener = pipe
    try:
        if interruptible:
            signal.signal(signal.SIGINT, _interrupt)
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        end_with_parent(parent)
        work()
        sys.exit()
    except KeyboardInterrupt:
        end_if_supervised()
    finally:
        if interruptible:  # all is done, and nothing but the interpreter's own end is left
            signal.signal(signal.SIGINT, signal.SIG_IGN)


def _exit_code(asked: list[int], code: int) -> int:
    """The exit code of the first process, after it has said in one line how the second ended."""
    if asked and os.isatty(2):
        os.write(2, b"\r\x1b[2K\x1b[?25h")  # the bar goes, and the cursor that it hid comes back
    if code == -signal.SIGINT or (asked[:1] == [signal.SIGINT] and code):
        code = INTERRUPTED
    if code == INTERRUPTED:
        os.write(2, b"locplan: interrupted\n")
    elif asked and code:
        code = 128 + asked[0]
    elif -code in PASSED_ON:  # the terminal sent it to both, and this process had it later
        code = 128 - code
    elif code < 0:
        name = signal.Signals(-code).name
        os.write(2, f"locplan: error: its process was ended by {name}\n".encode())
        code = 128 - code
    return code


def _interrupt(*_: object) -> None:
    signal.signal(signal.SIGINT, _ignore)  # a second one must not disturb what ends in good order
    os.dup2(os.open(os.devnull, os.O_WRONLY), 2)  # libraries wrap and report it in many ways
    raise KeyboardInterrupt


def _ignore(*_: object) -> None:
    pass
