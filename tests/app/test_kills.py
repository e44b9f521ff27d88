"""Commands that are killed while they write: no file lost, no mixture, nothing left behind."""

import hashlib
import os
import random
import signal
import subprocess
import sys
from pathlib import Path

import pytest
import yaml
from support.maps import ascii_map

from locplan import save_map
from locplan._support.output import ResultOutput
from locplan.errors import LocplanError

pytestmark = [
    pytest.mark.long,
    pytest.mark.skipif(os.name != "posix", reason="Windows has no SIGKILL"),
]
ENDS = "--start", "1,3", "--goal", "4,3"
COMMANDS = {
    "plan": ("plan", "room.yaml", *ENDS, "--stride", "0.5", "-o", "out", "--weight"),
    "front": ("plan", "room.yaml", *ENDS, "--front", "-o", "out", "--stride"),
    "simulate": ("simulate", "room.yaml", *ENDS, "-o", "out", "--drives", "2", "--stride"),
    "mask": ("export", "room.yaml", "--to", "nav2-keepout", "-o", "out", "--stride"),
    "path": ("export", "room.yaml", "--to", "path", *ENDS, "-o", "path.csv", "--stride"),
    "field": ("field", "room.yaml", "-o", "field.npz", "--stride"),
    "picture": ("field", "room.yaml", "-o", "field.png", "--stride"),
    "pictures": ("field", "room.yaml", "other.yaml", "--picture", "e", "-o", "out", "--stride"),
    "info": ("info", "room.yaml", "-o", "info.png", "--set", "range=5", "--lidar"),
    "check": (
        *("check", "room.yaml", "--effort=quick", "--lidar", "turtlebot3", "--set", "range=6"),
        *("-o", "out", "--seed"),
    ),
}
"""Commands, each of which takes one of `VALUES` last."""
BY_STRIDE = [name for name, words in COMMANDS.items() if words[-1] == "--stride"]
VALUES = {"info": ("turtlebot3", "turtlebot4"), **dict.fromkeys(BY_STRIDE, ("0.4", "0.5"))}
RUN = """
import os, signal, sys
sys.path[:0] = {path!r}
sys.argv = ["locplan", *{arguments!r}]
steps, kill_at, home = 0, {kill_at}, os.getcwd()
ours = ("os.rename", "os.remove", "os.mkdir", "os.rmdir", "os.link", "open")
def count(event, arguments):
    global steps
    if event not in ours or not isinstance(arguments[0], (str, bytes, os.PathLike)):
        return
    path = os.path.abspath(os.fsdecode(arguments[0]))
    writes = event != "open" or (arguments[2] or 0) & (os.O_WRONLY | os.O_RDWR | os.O_CREAT)
    if writes and path.startswith(home):
        steps += 1
        if steps == kill_at:
            os.kill(os.getpid(), signal.SIGKILL)
sys.addaudithook(count)
import atexit
atexit.register(lambda: print(f"steps: {{steps}}", file=sys.stderr))
from locplan.app.cli import main
main()
"""


def run(home: Path, arguments: list[str], kill_at: int = 0) -> tuple[int, int]:
    """Run a command that is killed at its n-th step in a folder; return exit code and steps."""
    path = [entry for entry in sys.path if entry]
    code = RUN.format(path=path, arguments=arguments, kill_at=kill_at)
    done = subprocess.run([sys.executable, "-c", code], cwd=home, capture_output=True, text=True)
    steps = done.stderr.rpartition("steps: ")[2].split()
    return done.returncode, int(steps[0]) if done.returncode >= 0 else kill_at


def state(home: Path) -> dict[str, str]:
    """SHA-256 of all files by name."""
    files = (each for each in home.rglob("*") if each.is_file())
    return {str(e.relative_to(home)): hashlib.sha256(e.read_bytes()).hexdigest() for e in files}


def check_is_whole(home: Path, users: dict[str, str], values: tuple[str, ...]) -> str:
    """Check that the user's files and one run's files are there, and no others; return the run."""
    files = state(home)
    lost = {name for name, digest in users.items() if files.get(name) != digest}
    assert not lost, "user's files are lost or changed"
    (file,) = (name for name in files if name.endswith("run.yaml"))
    about = yaml.safe_load((home / file).read_text())
    folder = str(Path(file).parent)
    outputs = {str(Path(folder, name)): digest for name, digest in about["outputs"].items()}
    assert files == {**users, **outputs, file: files[file]}, "a mixture, or something left"
    typed = [value for value in about["settings"].values() if value in values]
    assert len(typed) == 1
    return str(typed[0])


def prepare(home: Path, name: str) -> int:
    """Let a folder have maps, notes, and results that replaced earlier ones; return the steps."""
    command, (first, second) = COMMANDS[name], VALUES.get(name, ("4", "5"))
    grid = ascii_map("##########", *["#........#"] * 6, "#...#    #", "##########", resolution=0.5)
    for each in ("room", "other"):
        save_map(grid, home / f"{each}.yaml")
    (home / "notes.txt").write_text("mine")
    for value in (first, second, first, second):  # the fields are in the cache at last
        code, steps = run(home, [*command, value])
        assert code == 0
    return steps


def kill(home: Path, name: str, step: int) -> str:
    """Kill a command in a prepared folder, and check what is there after the next run's start.

    Returns the value of the run whose results stayed: the earlier one's or the killed one's.
    """
    command, values = COMMANDS[name], VALUES.get(name, ("4", "5"))
    results = check_is_whole(home, state(home), values)
    assert results == values[1]
    about = next(home.rglob("*run.yaml"))
    listed = yaml.safe_load(about.read_text())["outputs"]
    ours = {about.relative_to(home), *(about.parent.relative_to(home) / each for each in listed)}
    users = {file: digest for file, digest in state(home).items() if Path(file) not in ours}
    assert {"room.yaml", "room.pgm", "notes.txt"} <= users.keys()
    assert run(home, [*command, values[0]], step)[0] == -signal.SIGKILL
    target = home / command[command.index("-o") + 1]
    with pytest.raises(LocplanError, match="results of another command"):
        ResultOutput(target, "other", is_file=target.suffix != "").check()
    return check_is_whole(home, users, values)


@pytest.mark.parametrize("seed", range(5))
def test_kill_leaves_old_or_new_results(tmp_path, seed):
    draw = random.Random(seed)
    name = draw.choice(sorted({*COMMANDS} - {"check"}))
    steps = prepare(tmp_path, name)
    last = draw.random() < 0.5  # when files move
    step = draw.randint(steps - steps // 8, steps) if last else draw.randint(1, steps)
    kill(tmp_path, name, step)
    value = VALUES.get(name, ("4", "5"))[1]
    assert run(tmp_path, [*COMMANDS[name], value])[0] == 0
    assert not list(tmp_path.rglob(".locplan-*"))
