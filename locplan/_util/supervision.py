"""Ctrl-C within a second: a process that works, and one that outlives it and cleans up.

Python acts on a signal only between two of its own instructions. While a kernel runs or is
compiled, or a picture is drawn, that may take many seconds, and libraries lose an interrupt that
comes within their callbacks. So the first process does nothing but wait. It passes a signal on,
gives the second one a short time to end in good order, kills it otherwise, and removes its
temporary files.
"""

from __future__ import annotations

import os
import select
import signal
import sys
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from locplan._util.leftovers import Leftovers

INTERRUPTED = 128 + signal.SIGINT
"""Exit code after Ctrl-C."""
GRACE = 0.5
"""Time that a process has to end in good order after a signal [s]."""
PASSED_ON = [
    getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)
]
"""Signals that the first process passes on to the second."""
_DIE_WITH_PARENT = 1  # Linux's PR_SET_PDEATHSIG

_supervised = False


def supervised(work: Callable[[], None]) -> int:
    """Run `work` in a process of its own, and return its exit code.

    It does not return in the process that works, unless the system has no fork: there the only
    process works.
    """
    if not hasattr(os, "fork"):
        work()
        return 0
    from locplan._util.leftovers import Leftovers

    passed_on = {each for each in PASSED_ON if signal.getsignal(each) != signal.SIG_IGN}
    woken, wake = os.pipe()
    heard, said = os.pipe()
    os.set_blocking(wake, False)
    first = os.getpid()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, passed_on)
    process = os.fork()
    if not process:
        for descriptor in (woken, wake, heard):
            os.close(descriptor)
        _work(work, said, first, signal.SIGINT in passed_on, before)
    os.close(said)
    for each in (*passed_on, signal.SIGCHLD):
        signal.signal(each, _ignore)  # the pipe tells of it
    signal.set_wakeup_fd(wake, warn_on_full_buffer=False)
    signal.pthread_sigmask(signal.SIG_SETMASK, before)
    leftovers = Leftovers()
    asked, status = _watch(process, woken, heard, leftovers)
    for each in passed_on:
        signal.signal(each, signal.SIG_IGN)
    leftovers.remove()
    return _exit_code(asked, os.waitstatus_to_exitcode(status))


def end_if_supervised(code: int = INTERRUPTED) -> None:
    """End this process at once after an interrupt if another one cleans up and says so.

    The exit code is another one where an interrupt is the usual end.

    Threads that are within a kernel are not awaited.
    """
    if _supervised:
        os._exit(code)


def end_with_parent(parent: int) -> None:
    """Let the system end this process with its parent, even while it hangs (on Linux)."""
    if sys.platform == "linux":
        import ctypes

        ctypes.CDLL(None).prctl(_DIE_WITH_PARENT, signal.SIGKILL)
        if os.getppid() != parent:
            sys.exit()


def _work(
    work: Callable[[], None], said: int, parent: int, interruptible: bool, mask: set[Any]
) -> None:
    """Do the work in the second process, and end it."""
    from locplan._util import leftovers

    global _supervised
    _supervised = True
    try:
        leftovers.tell(said)
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


def _watch(process: int, woken: int, heard: int, leftovers: Leftovers) -> tuple[int | None, int]:
    """Wait for the process; return the signal passed on, and its status."""
    asked: int | None = None
    deadline: float | None = None
    pipes = [woken, heard]
    while True:
        left = None if deadline is None else max(0.0, deadline - time.monotonic())
        ready = select.select(pipes, [], [], left)[0]
        if heard in ready:
            said = os.read(heard, 1 << 16)
            leftovers.hear(said)
            if not said:
                pipes.remove(heard)
        if woken in ready:
            for number in set(os.read(woken, 1 << 10)) - {signal.SIGCHLD}:
                os.kill(process, number)
                if asked is None:
                    asked, deadline = number, time.monotonic() + GRACE
        ended, status = os.waitpid(process, os.WNOHANG)
        if ended:
            while heard in pipes and select.select([heard], [], [], 0)[0]:
                said = os.read(heard, 1 << 16)
                leftovers.hear(said)
                if not said:
                    break
            return asked, status
        if deadline is not None and time.monotonic() >= deadline:
            os.kill(process, signal.SIGKILL)
            deadline = None


def _exit_code(asked: int | None, code: int) -> int:
    """The exit code of the first process, after it has said in one line how the second ended."""
    if asked is not None and os.isatty(2):
        os.write(2, b"\r\x1b[2K\x1b[?25h")  # the bar goes, and the cursor that it hid comes back
    if code == -signal.SIGINT or (asked == signal.SIGINT and code):
        code = INTERRUPTED
    if code == INTERRUPTED:
        os.write(2, b"locplan: interrupted\n")
    elif asked is not None and code:
        code = 128 + asked
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
