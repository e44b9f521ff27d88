"""Ctrl-C: whatever a command is doing, it ends with one line and leaves nothing behind."""

import itertools
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from support.cases import sample_cases
from support.machine import TIMEOUT
from support.maps import ascii_map

from locplan import save_map
from locplan._support.output import temporary_folder
from locplan._support.supervision import find_existing_folders

pytestmark = pytest.mark.skipif(os.name != "posix", reason="Windows has no fork and no groups")
BEGIN = """
import ctypes, os, signal, sys, threading
sys.path[:0] = {path!r}
signal.signal(signal.SIGHUP, signal.SIG_DFL)  # under nohup it is ignored
signal.signal(signal.SIGINT, signal.{disposition})  # in the background it is ignored
def stuck(*_, **__):
    "Hold the interpreter's lock in foreign code, as the compiler does."
    lock = ctypes.create_string_buffer(256)
    with_lock_held = ctypes.PyDLL(None)
    with_lock_held.pthread_mutex_init(lock, None)
    with_lock_held.pthread_mutex_lock(lock)
    signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])  # or it may come just before
    print("stuck", flush=True)
    with_lock_held.pthread_mutex_lock(lock)
"""
SUPERVISED = """
from locplan._support.supervision import run_supervised
def work():
    {work}
from locplan.__main__ import finish_and_remove_temporary_folder as clear
sys.exit(run_supervised(work, clear))
"""


def start(folder: Path, code: str, disposition: str = "default_int_handler") -> subprocess.Popen:
    """Start a process, and return it when its code prints that it is stuck."""
    for name in ("temporary", "cache"):
        (folder / name).mkdir()
    path = [entry for entry in sys.path if entry]
    process = subprocess.Popen(
        [sys.executable, "-c", BEGIN.format(path=path, disposition=disposition) + code],
        start_new_session=True,
        cwd=folder,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={
            **os.environ,
            "TMPDIR": str(folder / "temporary"),
            "LOCPLAN_CACHE": str(folder / "cache"),
        },
    )
    assert process.stdout.readline() == "stuck\n", process.communicate(timeout=TIMEOUT)[1]
    return process


def end_group(process: subprocess.Popen, number: signal.Signals = signal.SIGINT) -> tuple[int, str]:
    """Send a signal to a process group; return its exit code and standard error."""
    os.killpg(process.pid, number)
    _, err = process.communicate(timeout=TIMEOUT)
    with pytest.raises(ProcessLookupError):  # nobody of the group is left
        os.killpg(process.pid, 0)
    return process.returncode, err


def supervise(work: str) -> str:
    return SUPERVISED.format(work=work.replace("\n", "\n    "))


@pytest.mark.parametrize(
    "work",
    [
        "stuck()",
        "thread = threading.Thread(target=stuck)\nthread.start()\nthread.join()",
        "while True:\n    try: print('stuck', flush=True); signal.pause()\n"
        "    except BaseException: pass",
        "threading.Thread(target=print, args=['stuck'], kwargs={'flush': True}).start()\n"
        "signal.pause()",
        "class Late:\n    def __del__(self): print('stuck', flush=True); signal.pause()\n"
        "late = Late()\ndel late\nstuck()",
    ],
    ids=["in foreign code", "in a thread", "caught", "waiting", "in a finalizer"],
)
def test_interrupt_ends_unresponsive_code(tmp_path, work):
    assert end_group(start(tmp_path, supervise(work))) == (130, "locplan: interrupted\n")


def test_interrupt_removes_temporary_files(tmp_path):
    """The second process is killed and cannot clean up."""
    (tmp_path / "kept.txt").write_text("before")
    code = """
from locplan._support.output import replace_file, temporary_folder
with replace_file("kept.txt") as file, replace_file("new.txt"), temporary_folder() as folder:
    file.write_text("half")
    (folder / "part").write_text("half")
    stuck()
"""
    process = start(tmp_path, supervise(code))
    assert len(list(tmp_path.iterdir())) == 5
    assert list((tmp_path / "temporary").iterdir())
    assert end_group(process)[0] == 130
    assert sorted(each.name for each in tmp_path.iterdir()) == ["cache", "kept.txt", "temporary"]
    assert not list((tmp_path / "temporary").iterdir())
    assert (tmp_path / "kept.txt").read_text() == "before"


def test_interrupt_completes_started_moves(tmp_path):
    (tmp_path / "kept").mkdir()
    code = """
import os
from pathlib import Path
from locplan._support.output import ResultOutput
with ResultOutput(Path("kept"), "plan").writing() as folder:
    (folder / "a").write_text("1")
    (folder / "b").write_text("1")
    move = os.replace
    def move_and_stop(source, target):
        move(source, target)
        if Path(target).name == "a":
            stuck()
    os.replace = move_and_stop
"""
    process = start(tmp_path, supervise(code))
    assert not (tmp_path / "kept" / "b").exists()
    assert end_group(process)[0] == 130
    assert {each.name for each in (tmp_path / "kept").iterdir()} == {"a", "b", "run.yaml"}


@pytest.mark.long
def test_interrupt_removes_last_of_many_folders(tmp_path):
    """The names of all folders do not fit into the pipe."""
    code = """
from locplan._support.output import temporary_folder
with temporary_folder() as first:
    for _ in range(2 * 65536 // len(str(first))):  # a pipe takes 64 kB
        with temporary_folder():
            pass
    with temporary_folder():
        stuck()
"""
    process = start(tmp_path, supervise(code))
    assert len(list((tmp_path / "temporary").iterdir())) == 2
    assert end_group(process)[0] == 130
    assert not list((tmp_path / "temporary").iterdir())


def test_existing_folders_exclude_truncated_name(tmp_path):
    names = [tmp_path / name for name in ("a\nb", "c", os.fsdecode(b"\xff"), "cut off")]
    for name in (names[0], *names[2:]):  # the process has removed the second one itself
        name.mkdir()
    assert find_existing_folders(b"\0".join(map(os.fsencode, names))) == [
        str(names[0]),
        str(names[2]),
    ]


def test_next_run_removes_leftover_files(tmp_path):
    """After SIGKILL, no process is left to clean up."""
    code = """
from locplan._support.output import replace_file, temporary_folder
with replace_file("new.txt") as file, temporary_folder():
    file.write_text("half")
    stuck()
"""
    process = start(tmp_path, supervise(code))
    for folder in (tmp_path, tmp_path / "temporary"):
        with temporary_folder(folder) as own:
            assert len(list(folder.glob(".locplan-tmp-*"))) == 2  # the process lives
    process.kill()
    process.communicate(timeout=TIMEOUT)
    for folder in (tmp_path, tmp_path / "temporary"):
        with temporary_folder(folder) as own:
            assert list(folder.glob(".locplan-tmp-*")) == [own]


@pytest.mark.parametrize(
    ("number", "expected"),
    [(signal.SIGTERM, (143, "locplan: terminated\n")), (signal.SIGHUP, (129, ""))],
)
def test_terminate_and_hangup_end_command(tmp_path, number, expected):
    assert end_group(start(tmp_path, supervise("stuck()")), number) == expected


def test_supervisor_forwards_interrupt(tmp_path):
    process = start(tmp_path, supervise("stuck()"))
    process.send_signal(signal.SIGINT)
    assert process.communicate(timeout=TIMEOUT)[1] == "locplan: interrupted\n"
    assert process.returncode == 130


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux ends a process with its parent")
def test_worker_ends_with_supervisor(tmp_path):
    process = start(tmp_path, supervise("stuck()"))
    process.kill()
    # The worker holds the pipes: they close when it ends.
    assert process.communicate(timeout=TIMEOUT) == ("", "")


def test_supervisor_forwards_exit_code_and_crash(tmp_path):
    for n, (work, expected) in enumerate(
        [
            ("print('stuck', flush=True)", (0, "")),
            ("print('stuck', flush=True); sys.exit(3)", (3, "")),
            (
                "print('stuck', flush=True); os.kill(os.getpid(), signal.SIGKILL)",
                (137, "locplan: error: its process was ended by SIGKILL\n"),
            ),
        ]
    ):
        folder = tmp_path / str(n)
        folder.mkdir()
        process = start(folder, supervise(work))
        err = process.communicate(timeout=TIMEOUT)[1]
        assert (process.returncode, err) == expected


def test_ignored_interrupt_stays_ignored(tmp_path):
    """A shell may start background commands with SIGINT ignored."""
    work = "print('stuck', flush=True)\ninput()\nprint('done')"
    process = start(tmp_path, supervise(work), "SIG_IGN")
    os.killpg(process.pid, signal.SIGINT)
    assert process.communicate("\n", timeout=TIMEOUT) == ("done\n", "")
    assert process.returncode == 0


def test_early_interrupt_prints_one_line(tmp_path):
    """The interrupt comes before the second process exists."""
    code = """
import importlib.abc
class Stuck(importlib.abc.MetaPathFinder):
    def find_spec(self, name, *_):
        if name.endswith(".supervision"):
            print("stuck", flush=True)
            signal.pause()
import locplan.__main__
sys.meta_path.insert(0, Stuck())
sys.argv = ["locplan", "--version"]
locplan.__main__.main()
"""
    assert end_group(start(tmp_path, code)) == (130, "locplan: interrupted\n")


ENDS = "--start", "1,2", "--goal", "4,3.5"


def stops() -> list:
    """Where commands stand still, and their arguments."""
    each = [
        ("locplan.field.Sad.covariances", ("field", "-o", "out.npz")),
        (
            "locplan.comparison.workers.WorkerPool.perform_jobs",
            ("compare", "--min-distance", "2", "-o", "out"),
        ),
        ("locplan.field.files.write_field", ("field", "-o", "out.npz")),
        (
            "locplan.simulation.Simulator.arguments",
            ("plan", *ENDS, "--stride", "1", "--lidar", "rplidar-a1", "-o", "out"),
        ),
        ("matplotlib.figure.Figure.draw", ("field", "-o", "out.png")),
        ("locplan.field.Sad.prepare", ("export", "--to", "nav2-keepout", "-o", "out")),
        ("locplan.planning.Costmap.from_field", ("plan", *ENDS, "--front", "-o", "out")),
        ("locplan.planning.plans.plan_with_shortest", ("plan", *ENDS, "-o", "out")),
        ("locplan.simulation.Simulator.arguments", ("simulate", *ENDS, "-o", "out")),
    ]
    numbers = itertools.cycle((signal.SIGINT, signal.SIGTERM))
    signalled = [(*stop, number) for stop, number in zip(each, numbers, strict=False)]
    return sample_cases(signalled, 4)  # computing, worker processes, writing and driving


@pytest.mark.parametrize("stop", stops(), ids=lambda stop: "-".join([stop[1][0], stop[2].name]))
def test_interrupted_command_leaves_no_files(tmp_path, stop):
    where, arguments, number = stop
    grid = ascii_map("##########", *["#........#"] * 6, "#...#    #", "##########", resolution=0.5)
    save_map(grid, tmp_path / "room.yaml")
    before = sorted(each.name for each in tmp_path.iterdir())
    name, *options = arguments
    code = f"""
from pkgutil import resolve_name
from unittest import mock
sys.argv = {["locplan", name, "room.yaml", *options]!r}
owner, _, name = {where!r}.rpartition(".")
setattr(resolve_name(owner), name, property(stuck) if name == "arguments" else stuck)
from locplan._support import progress
progress.DISPLAY_DELAY = 3600.0
from locplan.__main__ import main
main()
"""
    word = "interrupted" if number == signal.SIGINT else "terminated"
    assert end_group(start(tmp_path, code), number) == (128 + number, f"locplan: {word}\n")
    left = {each.name for each in tmp_path.iterdir()} - {*before, "temporary", "cache"}
    assert left <= ({"out"} if name == "compare" else set())  # its journal
    assert not list((tmp_path / "temporary").iterdir())
    assert not list((tmp_path / "cache").glob(".*"))
