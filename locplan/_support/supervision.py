"""Fast reaction to Ctrl-C and SIGTERM: a second process works, the first one cleans up.

Why not a thread that waits on `signal.set_wakeup_fd`: it needs the interpreter, which numba holds
for 0.3 s of CPU at a time while it compiles. On a busy machine the thread waited 3.3 s. In OMPL it
waited at most 0.8 s, since the termination condition is in Python. Foreign code of a user's planner
may hold the interpreter for any time.

So the first process only waits. It passes a signal on, gives the second one a short time to end in
good order, kills it otherwise, and clears its temporary folders. If both are killed, the next
process that writes to the same place does so, see `locplan._support.output`.
"""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Callable
from contextlib import suppress
from typing import Any

_listener: tuple[int, int] | None = None
"""Both ends of the pipe that names temporary folders to the process that outlives this one."""
_temporary_folders: set[str] = set()
"""The temporary folders of this process."""


def announce_folder(folder: str, *, is_gone: bool = False) -> None:
    """Announce a temporary folder to the first process, which clears it at the end."""
    if is_gone:
        _temporary_folders.discard(folder)
        return
    _temporary_folders.add(folder)
    if _listener is not None:
        _announce_folders(*_listener, folder)


def _announce_folders(read_end: int, write_end: int, *folders: str) -> None:
    """Send names of temporary folders to the first process."""
    try:
        os.write(write_end, b"".join(os.fsencode(folder) + b"\0" for folder in folders))
    except BlockingIOError:  # names are read at the end: it is full of folders that are long gone
        with suppress(BlockingIOError):
            os.read(read_end, 1 << 20)
        _announce_folders(read_end, write_end, *_temporary_folders)


def find_existing_folders(packed_names: bytes) -> list[str]:
    """Return the existing folders of a null-separated list."""
    return [
        folder
        for folder in map(os.fsdecode, packed_names.split(b"\0")[:-1])
        if os.path.isdir(folder)
    ]


INTERRUPTED = 128 + signal.SIGINT
"""Exit code after Ctrl-C."""
TERMINATED = 128 + signal.SIGTERM
"""Exit code after SIGTERM."""
FORWARDED_SIGNALS = [
    getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)
]
"""Signals that the first process passes on to the second."""
WORDS: dict[int, str] = {signal.SIGINT: "interrupted", signal.SIGTERM: "terminated"}
"""What the first process reports after a signal; after others nobody is there to read it."""


def run_supervised(work: Callable[[], None], clear: Callable[[str], None]) -> int:
    """Run `work` in a second process, clear its temporary folders, and return its exit code.

    It does not return in the process that works, unless the system has no fork: there the only
    process works.
    """
    if not hasattr(os, "fork"):
        work()
        return 0

    forwarded = {
        signal_number
        for signal_number in FORWARDED_SIGNALS
        if signal.getsignal(signal_number) != signal.SIG_IGN
    }
    read_end, write_end = os.pipe()
    for end in (read_end, write_end):  # it tells of what is left; nobody waits for that
        os.set_blocking(end, False)
    first = os.getpid()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, forwarded)
    process = os.fork()
    if not process:
        _run_second_process(work, (read_end, write_end), first, forwarded & set(WORDS), before)
    os.close(write_end)
    received_signals: list[int] = []

    def send(number: int) -> None:
        with suppress(ProcessLookupError):  # it has just ended
            os.kill(process, number)

    def forward_signal(number: int, _: object) -> None:
        if not received_signals:
            # Time that a process has to end in good order after a signal [s].
            signal.setitimer(signal.ITIMER_REAL, 0.5)
        received_signals.append(number)
        send(number)

    signal.signal(signal.SIGALRM, lambda *_: send(signal.SIGKILL))
    for signal_number in forwarded:
        signal.signal(signal_number, forward_signal)
    signal.pthread_sigmask(signal.SIG_SETMASK, before)
    _, status = os.waitpid(process, 0)
    signal.setitimer(signal.ITIMER_REAL, 0)
    for signal_number in forwarded:
        signal.signal(signal_number, signal.SIG_IGN)
    with suppress(BlockingIOError):  # there is nothing to hear
        for folder in find_existing_folders(os.read(read_end, 1 << 20)):
            clear(folder)
    return _report_exit_code(received_signals, os.waitstatus_to_exitcode(status))


def end_if_supervised(code: int = INTERRUPTED) -> None:
    """End this process at once if the first process cleans up and reports."""
    if _listener is not None:
        os._exit(code)


def end_with_parent(parent: int) -> None:
    """Let the system end this process with its parent, even while it hangs (on Linux)."""
    if sys.platform == "linux":
        import ctypes

        ctypes.CDLL(None).prctl(1, signal.SIGKILL)  # PR_SET_PDEATHSIG
        if os.getppid() != parent:
            sys.exit()


def _run_second_process(
    work: Callable[[], None],
    pipe: tuple[int, int],
    parent: int,
    interrupts: set[int],
    mask: set[Any],
) -> None:
    """Do the work in the second process, and end it."""
    global _listener
    _listener = pipe
    try:
        for number in interrupts:
            signal.signal(number, _handle_interrupt)
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        end_with_parent(parent)
        work()
        sys.exit()
    except KeyboardInterrupt:
        end_if_supervised()
    finally:
        for number in interrupts:  # all is done, and only the interpreter's own end is left
            signal.signal(number, signal.SIG_IGN)


def _report_exit_code(received_signals: list[int], code: int) -> int:
    """Report the end of the second process in one line, and return the exit code."""
    if received_signals and os.isatty(2):
        os.write(2, b"\r\x1b[2K\x1b[?25h")  # the bar goes, and the cursor that it hid comes back
    if not received_signals and -code in FORWARDED_SIGNALS:
        received_signals = [-code]  # the terminal sent it to both, and this process had it later
    elif not received_signals and code == INTERRUPTED:
        received_signals = [signal.SIGINT]
    if received_signals and code:
        if word := WORDS.get(received_signals[0]):
            os.write(2, f"locplan: {word}\n".encode())
        return 128 + received_signals[0]
    if code < 0:
        name = signal.Signals(-code).name
        os.write(2, f"locplan: error: its process was ended by {name}\n".encode())
        return 128 - code
    return code


def _handle_interrupt(*_: object) -> None:
    for number in WORDS:
        signal.signal(
            number, _ignore_signal
        )  # a second one must not disturb what ends in good order
    os.dup2(os.open(os.devnull, os.O_WRONLY), 2)  # libraries wrap and report it in many ways
    raise KeyboardInterrupt


def _ignore_signal(*_: object) -> None:
    pass
