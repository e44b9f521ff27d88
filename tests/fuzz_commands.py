"""A fuzzer of command lines: valid and hostile values of every option of every command.

Run: python tests/fuzz_commands.py [COUNT [SEED [COMMAND]]]

The options are those that the commands declare, so that a new one is fuzzed by itself. Each line
runs on maps of 12 x 8 cells, in surroundings of its own: variables, streams that are closed or
full, folders that cannot be written, limits. It runs as `python -m locplan` does, in a process
forked from one that has imported only what takes long and reads none of these. Equal seeds make
equal lines and surroundings; each failure is printed with both.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import logging
import os
import random
import re
import resource
import select
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any, get_args

from kernel_cache import keep_kernels

CODES = (0, 1, 2, 3, 4)
"""Exit codes that are documented; the line is an error in the second and the third."""
SECONDS = 60
"""Greatest processor time of a process, and in a second run if kernels were compiled [s]."""
WALL = 180.0
"""Time without an answer after which the process is ended: it waits for something [s]."""
MEMORY = 2 * 10**9
"""Greatest resident memory of a process [bytes]."""
ADDRESSES = 3 * 10**9
"""Address space that it may take [bytes]."""
LINES_EACH = 100
"""Number of lines that are run in one folder."""
SMALL = "64k"
"""Size of the disk that is full soon, where it can be mounted."""

NOWHERE = ("in/empty", "in/empty/x", "/proc/nowhere", "/sys/kernel/x", "", "\udcff")
"""Folders that cannot be made or written, even by root, and odd ones."""
VARIABLES = {
    "MPLBACKEND": ("module://matplotlib_inline.backend_inline", "nonsense", "", "tkagg", "pdf"),
    "COLUMNS": (*map(str, range(41)), "-1", "x", "1e9", "9" * 30),
    "LINES": ("0", "1", "-1", "x"),
    "TERM": ("dumb", "", "\udcff"),
    "LC_ALL": ("C", "POSIX", "nowhere"),
    "PYTHONIOENCODING": ("ascii", "latin-1:strict"),
    "HOME": (*NOWHERE, "small/home"),
    "TMPDIR": (*NOWHERE, "small/tmp"),
    "LOCPLAN_CACHE": (*NOWHERE, "small/cache"),
    "MPLCONFIGDIR": (*NOWHERE, "small/matplotlib"),
}
"""Values of variables of the environment."""
STREAMS = (("closed",), ("closed", "full", "broken"), ("closed", "full"))
"""What standard input, output and errors may be."""
OUT = ("in/empty", "/sys/kernel", "small/out")
"""What may stand in the place of the folder of results."""
TEMPORARY = re.compile(r"^\..*-[a-z0-9_]{8}|\.(partial|old)$")
"""Names of temporary files and folders beside those that they replace."""
FILE_SIZES = (0, 100, 5000, 100_000)
"""Greatest sizes of a file [bytes]."""

NUMBERS = (
    *("inf", "-inf", "nan", "1e308", "-1e308", "1e-308", "5e-324", "1e400", "-0", "0", "-1", "0.5"),
    *("1e12", "1e9", "1000000", "1000", "65536", "2147483648", "18446744073709551616", "1e-9"),
    *("12345678901234567890", "-12345678901234567890", "9" * 400, "0x10", "1_000", "1,5", "²"),
)
TEXTS = (
    *("", " ", "$", "$x$", "$\\frac{", "a_b^c{", "[red]", "[/red]", "b\udcff", "\x1b[1m", "%s {0}"),
    *("x" * 5000, "a\nb", "=", "name=", "=1", "[" * 5000, "{" * 900, "null", "[1]", '{"a": 1}'),
    *("~", ".", "..", "none", "NaN", "\U0001f600", "\u202e", "a:b=c", "a,b", ",", "1,", ",1"),
    *("--", "-", "\u0661", "--help", "-v"),
)
POSITIONS = (
    *("1e12,1e12", "-1e12,0", "1e308,-1e308", "nan,1", "inf,1", "1", "1,2,3", "1,2,3,4", "-0,-0"),
    *("1e400,1", "1e-320,1", "0,0", "0.1,0.1", "2,1", "1,2,1e308", "1,1,nan"),
)
PLANNERS = (
    *("grid", "any-angle:accuracy=high", "BITstar:time_limit=0.1", "RRT:iterations=20"),
    *("any-angle:accuracy=5", "grid:x=1", "RRTstar:range=1e308,iterations=20", "RRT:seed=1e308"),
    *("BITstar:time_limit=nan", "PRM:time_limit=1e308", "module:missing", "os:system", "RRT:a=[[["),
)
SETTINGS = (
    *("alpha1=0.1", "max_particles=1e9", "max_particles=1000000000000", "worlds=1000000000"),
    *("min_particles=1", "max_beams=2", "worlds=0", "sigma_hit=1e308", "sigma_hit=1e-308"),
    *("pf_err=1e-300", "alpha1=1e308", "boundary_noise=2", "laser_max_range=-5", "outliers=nan"),
    *("laser_model_type=beam", "heading_drift_deg=1e308", "start_sigma=1e12", "z_hit=0"),
    *("range=1.0", "goal_bias=2", "range=1e308", "samples_per_batch=10", "range=nan", "k=[[[[["),
    *("range=4", "field_of_view_deg=90", "margin=0", "footprint=0.1", "beams=0", "footprint=1e308"),
    *("footprint=[[0.1,0.1],[0.1,-0.1],[-0.1,0]]", "footprint=[[1]]", "turning_radius=1e308"),
    *("update_min_d=1e300", "resample_interval=1000000000000000000000", "nearest_k=true"),
)
USUAL = {
    "--accuracy": ("normal", "high"),
    "--at": ("2.5,1.5", "8,5.5"),
    "--baseline": ("grid", "any-angle"),
    "--budget": ("3", "0.5"),
    "--convergence": ("0.01",),
    "--criterion": ("e", "position_std", "heading_std", "entropy"),
    "--drives": ("2", "3"),
    "--disc": ("2", "4", "6"),
    "--figure": ("field", "e", "ellipses", "distribution", "models"),
    "--frame": ("map", "odom"),
    "--from-grid": (None,),
    "--goal": ("9.5,2.5",),
    "--headings": ("2", "4"),
    "--iterations": ("20", "60"),
    "--min-distance": ("0.5", "1"),
    "--limits": ("1e-4,1e-2",),
    "--magnify": ("1", "3"),
    "--max-e": ("0.5",),
    "--memory": ("1", "2"),
    "--name": ("hall", "two_corridors"),
    "--older-than": ("0", "30"),
    "--paths": ("5", "6"),
    "--path": ("in/path.csv", "in/far.csv"),
    "--patience": ("10",),
    "--places": ("2", "3"),
    "--planner": ("grid", "any-angle", "RRT", "BITstar", "smac2d", "smac-hybrid"),
    "--planner-param": ("1", "3"),
    "--queries": ("in/queries.csv",),
    "--random": ("2",),
    "--ranges": ("2,4", "3"),
    "--resolution": ("0.5", "1"),
    "--robot": ("in/params.yaml", "in/robot.yaml", "in/params.yaml:robot1"),
    "--scalar": ("e", "position_std", "ambiguity"),
    "--scans": ("1", "2"),
    "--scheduler": ("xyz", "tcp://127.0.0.1:9", "tcp://", "127.0.0.1", ":", "http://["),
    "--seeds": ("1",),
    "--set": SETTINGS,
    "--setting": SETTINGS,
    "--slowest": ("0.3",),
    "--spacing": ("0.5", "2"),
    "--start": ("1.5,1.5",),
    "--step": ("0.05", "0.5"),
    "--stride": ("0.2", "0.5", "1"),
    "--threads": ("1", "2"),
    "--time-limit": ("0.1", "0.2"),
    "--turning-radius": ("0.2",),
    "--via": ("3.5,4.5",),
    "--weight": ("0", "4"),
    "--workers": ("1",),
    "-o": ("out/result",),
    "--picture": ("out/picture.png", "out/pictures"),
}
"""Values of options that make sense on these maps; an option that is not here gets any."""
COSTLY = (
    *("--time-limit", "--iterations", "--drives", "--places", "--scans", "--random", "--seeds"),
    "--paths",
)
"""Options of which a large value is right, and takes its time."""
LARGE = ("1e12", "1e9", "1000000", "1000", "1_000", "65536")
QUICK = tuple(each for each in NUMBERS if each not in LARGE)
OWN_WARNINGS = (
    *("the field is not cached", "not simulated: ", "the cache ", "damaged", "add up to"),
    "does not follow a mask",
)
"""Words of the warnings that tell users something."""
FILES = (
    *("in/room.yaml", "in/room.pgm", "in", "in/broken.yaml", "in/absent", "in/empty"),
    *("in/path.csv", "in/far.csv", "in/noise.bin", "in/room.yaml/x", "", " ", "\udcff", "."),
    *("in/queries.csv", "in/params.yaml", "in/config.json", "in/journal", "/proc/nowhere/x", "~"),
    *("out", "out/x", "out/x.png", "out/" + "x" * 300),
    *("out/x.zarr", "out/x.json", "out/x.csv", "out/$x$.png", "out/\udcff.svg"),
)
MAPS = ("in/room.yaml", "in/r$x_^{.yaml", "in/r\\frac.yaml", "in/r\udcffm.yaml", "in/[red].yaml")
MAPS += ("in/$oom$.yaml", "in/big.yaml")
ASKED = {
    "check": (("--quick",),),
    "export": ((), ("--start", "--goal")),
    "simulate": (
        *(("--drives", "--path"), ("--drives", "--start", "--goal")),
        ("--drives", "--random", "--min-distance"),
    ),
    "tune": (("--paths", "--drives"),),
}
"""Options, one of these groups of them, without which a command does nothing or takes long."""
RARE = {"compare": 0.25, "cache": 0.5, "calibrate": 0.7, "tune": 0.5}
"""Commands that are run less often than others."""


@dataclass(frozen=True)
class Option:
    """An option of a command, or its argument."""

    name: str
    kinds: tuple[type, ...]
    choices: tuple[str, ...]
    required: bool
    positional: bool
    many: bool


def declared() -> dict[tuple[str, ...], list[Option]]:
    """All commands, with their subcommands, and what they declare to take."""
    from locplan.cli._application import COMMANDS, application

    found = {}
    for command in COMMANDS:
        app = application(command)[command]
        below = [name for name in app if not name.startswith("-")]
        apps = {(command, name): app[name] for name in below}
        if app.default_command:
            apps[command,] = app
        for names, each in apps.items():
            arguments = each.assemble_argument_collection()
            found[names] = [_option(one) for one in arguments if one.names != ("*",)]
    return found


def _option(argument: Any) -> Option:
    names = sorted(argument.names, key=len)
    name = names[0] if names[0].startswith("-o") else argument.name
    many = str(argument.hint).startswith(("tuple", "list"))
    inner = get_args(argument.hint) if many else (argument.hint,)
    kinds = tuple(
        kind
        for each in inner
        for kind in (get_args(each) or (each,))
        if isinstance(kind, type) and kind is not type(None)
    )
    positional = argument.index is not None
    if positional and name.startswith("--"):
        name = name[2:].upper()
    choices = tuple(argument.get_choices(force=True) or ())
    return Option(name, kinds or (str,), choices, argument.required, positional, many)


def line_of(chance: random.Random, commands: dict[tuple[str, ...], list[Option]]) -> list[str]:
    """A command line."""
    weights = [RARE.get(names[0], 1.0) for names in commands]
    names = chance.choices(list(commands), weights)[0]
    hostile = chance.choice((0.1, 0.3, 0.6))  # few hostile values let the others come far
    line = [] if chance.random() < 0.98 else [chance.choice(TEXTS)]
    line += list(names)
    asked = chance.choice(ASKED.get(names[0], ((),)))
    optional = []
    for option in commands[names]:
        if (option.required or option.name in asked) and chance.random() < 0.98:
            line += _words(chance, option, hostile / 2, names)
        else:
            optional.append(option)
    several = chance.choice((0, 1, 1, 2, 3, 5))
    for option in chance.sample(optional, min(several, len(optional))):
        line += _words(chance, option, hostile, names)
    if chance.random() < 0.03:
        line.insert(chance.randrange(len(line) + 1), chance.choice(TEXTS + NUMBERS))
    return [word.replace("\0", "") for word in line]


def surroundings_of(chance: random.Random) -> dict[str, Any]:
    """The surroundings of a line; a third have nothing odd."""
    share = chance.choice((0.0, 0.15, 0.4))
    odd: Any = lambda values: chance.choice(values) if chance.random() < share else None  # noqa: E731
    drawn = {name: odd(values) for name, values in VARIABLES.items()}
    return {
        "variables": {name: value for name, value in drawn.items() if value is not None},
        "streams": [odd(kinds) if chance.random() < 0.3 else None for kinds in STREAMS],
        "out": odd(OUT),
        "file_size": odd(FILE_SIZES) if chance.random() < 0.3 else None,
    }


def _words(
    chance: random.Random, option: Option, hostile: float, names: tuple[str, ...]
) -> list[str]:
    times = chance.choice((1, 1, 1, 2)) if option.many else 1
    words: list[str] = []
    for _ in range(times):
        value = _value(chance, option, hostile, names)
        if option.positional:
            words += [] if value is None else [value]
        elif value is None:
            words += [option.name]
        else:
            joined = chance.random() < 0.2 and not option.name.startswith("-o")
            words += [f"{option.name}={value}"] if joined else [option.name, value]
    return words


def _value(
    chance: random.Random, option: Option, hostile: float, names: tuple[str, ...]
) -> str | None:
    """A value of an option, or None for a flag."""
    bad = chance.random() < hostile
    if bool in option.kinds:
        return chance.choice(TEXTS) if bad and chance.random() < 0.1 else None
    if bad:
        numbers = QUICK if option.name in COSTLY else NUMBERS
        pool = [chance.choice(TEXTS), chance.choice(numbers)]
        if int in option.kinds or float in option.kinds:
            pool += chance.choices(numbers, k=5)
        elif Path in option.kinds:
            pool += chance.choices(FILES, k=4)
        elif option.name in USUAL and "," in str(USUAL[option.name][0]):
            pool += chance.choices(POSITIONS, k=5)
        return chance.choice(pool)
    if option.name == "MAP":
        return chance.choice(MAPS)
    if option.name == "-o":
        return _output(chance, names)
    if option.name == "--planner" and names == ("compare",):
        return chance.choice(PLANNERS)
    usual = USUAL.get(option.name)
    if option.choices:
        usual = tuple(set(usual or ()) & set(option.choices)) or option.choices
        return chance.choice(option.choices if chance.random() < 0.3 else sorted(usual))
    if usual:
        return chance.choice(usual)
    if Path in option.kinds:
        return chance.choice(FILES)
    return chance.choice(("1", "2", "3") if int in option.kinds else ("0.5", "1", "2"))


def _output(chance: random.Random, names: tuple[str, ...]) -> str:
    suffixes = {
        "field": (".zarr", ".npz", ".png", ".svg", ""),
        "calibrate": (".json",),
        "info": (".png", ".svg", ".pdf"),
        "export": ("", ".csv", ".json", ".yaml"),
    }
    stem = chance.choice(("out/result", "out/again", "out/[b]$_", "out/\udcff"))
    return stem + chance.choice(suffixes.get(names[0], ("",)))


def prepare(folder: Path) -> None:
    """Write the inputs of the lines into a folder."""
    import numpy as np

    from locplan.maps import load_map, save_map

    for name in ("in", "out", "home", "tmp"):
        (folder / name).mkdir()
    _empty_small(folder)
    inputs = folder / "in"
    rows = ("############", *["#..........#"] * 3, "#....#.....#", *["#..........#"] * 2, "#" * 12)
    levels = {"#": 0, ".": 254}
    pixels = np.array([[levels[each] for each in row] for row in rows], np.uint8)

    def write(name: str, pixels: Any, resolution: float) -> None:
        stem = os.fsencode(inputs) + b"/" + os.fsencode(name)
        height, width = pixels.shape
        with open(stem + b".pgm", "wb") as image:
            image.write(b"P5\n%d %d\n255\n" % (width, height) + pixels.tobytes())
        with open(stem + b".yaml", "wb") as about:
            about.write(
                b'image: "%s.pgm"\n' % b"room"
                + b"resolution: %r\norigin: [0.0, 0.0, 0.0]\nnegate: 0\n" % resolution
                + b"occupied_thresh: 0.65\nfree_thresh: 0.196\n"
            )

    for each in MAPS:
        if each != "in/big.yaml":
            write(each.removeprefix("in/").removesuffix(".yaml"), pixels, 1.0)
    save_map(load_map(inputs / "room.yaml"), inputs / "big.yaml")
    (inputs / "broken.yaml").write_text("image: nowhere.pgm\n")
    (inputs / "empty").write_bytes(b"")
    (inputs / "noise.bin").write_bytes(random.Random(0).randbytes(200))
    (inputs / "path.csv").write_text("x,y\n1.5,1.5\n9.5,2.5\n")
    (inputs / "far.csv").write_text("x,y\n1.5,1.5\n1e12,1.5\n")
    (inputs / "params.yaml").write_text("amcl:\n  ros__parameters:\n    alpha1: 0.1\n")
    (inputs / "robot.yaml").write_text("robot: {lidar: turtlebot4, footprint: 0.1, margin: 0.0}\n")
    (inputs / "config.json").write_text('{"config": {"stride": 0.4}}\n')
    (inputs / "queries.csv").write_text(
        "name,start_x,start_y,goal_x,goal_y\n$a_{,1.5,1.5,9.5,2.5\n"
    )


def _empty_small(folder: Path) -> None:
    """Make the small disk as it was: its folders, with nothing in them."""
    for name in ("home", "tmp", "out"):
        shutil.rmtree(folder / "small" / name, ignore_errors=True)
        (folder / "small" / name).mkdir(parents=True)


def contents(folder: Path) -> dict[str, str]:
    """A digest of each file below a folder by its name, and of each folder an empty one."""
    found = {}
    for where, folders, files in os.walk(folder):
        found |= dict.fromkeys((os.path.join(where, each) for each in folders), "")
        for file in files:
            path = os.path.join(where, file)
            # The field of a page that was served before may just be moved to its place.
            with contextlib.suppress(FileNotFoundError), open(path, "rb") as opened:
                found[path] = hashlib.blake2b(opened.read(), digest_size=8).hexdigest()
    return found


def _may_be_written(line: list[str]) -> list[str]:
    """Beginnings of the paths that a line names for its outputs, those by default included."""
    words = [part for word in line for part in ([word, word.partition("=")[2]])]
    given = [word for word in words if word.strip()]
    named = [os.path.abspath(each) for word in given for each in (word, os.path.expanduser(word))]
    stems = [os.path.splitext(each)[0] for each in named]
    own = ["calibrated", "tmp/cache", "tmp/matplotlib", "home/.cache", "home/.config"]
    own += ["small/cache", "small/matplotlib", "small/home"]
    own += [f"{Path(word).stem}-".replace("\udcff", "\ufffd") for word in (*words, *MAPS)]
    real = [os.path.realpath(each) for each in named]
    return named + stems + real + [os.path.join(os.getcwd(), name) for name in own]


def changes(before: dict[str, str], after: dict[str, str], may: list[str]) -> Iterator[str]:
    """What a line has left or changed in the folder here, and must not."""
    inputs = os.path.join(os.getcwd(), "in", "")
    for path in sorted(before.keys() | after.keys()):
        name = os.path.relpath(path)
        temporary = any(TEMPORARY.search(each) for each in Path(name).parts)
        if temporary and path in after and path not in before:
            yield f"left {name!r}"
        elif before.get(path) != after.get(path):
            named = any(path.startswith(each) or each.startswith(path + os.sep) for each in may)
            if not named or (path in before and path.startswith(inputs)):
                yield f"changed {name!r}"


def faults(
    code: object, out: str | None, err: str | None, logged: str, *, broken: bool = False
) -> Iterator[str]:
    """What is wrong with the outcome of a line; of streams that cannot be read, nothing is.

    Where the pipe that takes the output is broken, the line may end without a word.
    """
    if code not in CODES:
        yield f"exit code {code}"
    if "Traceback" in f"{out}{err}{logged}":
        yield "traceback"
    if "Warning: " in logged:
        yield "hidden warning"
    if err is None:
        return
    lines = []
    for each in err.splitlines():
        own = "locplan: warning: " in each and any(words in each for words in OWN_WARNINGS)
        own = own or "; Ctrl-C ends " in each  # where a page is served
        if not own and not each.startswith(("locplan.", "robot: ", "wrote ")):
            lines.append(each)
    if any("warning" in each.lower() for each in lines):
        yield "warning"
    failed = code == 2 and (out is None or "failed" in out or '"error"' in out)  # a map of several
    if broken and code == 1 and not lines:
        return
    if code in (1, 2) and not failed:
        given = lines and "is an image, not a map's YAML; save" in lines[0]  # six lines follow
        if len(lines) != (7 if given else 1) or not lines[0].startswith("locplan: error: "):
            yield "no single line"
        elif len(lines[0]) > 1050:
            yield "long line"
    elif lines and (code == 0 or (code == 3 and not lines[0].startswith("locplan: error: "))):
        yield "more on stderr"


def serve(folder: Path, answers: int) -> None:
    """Run the lines that come on standard input, and answer each with its faults."""
    os.chdir(folder)
    for name in ("cv2", "numba", "PIL.Image", "scipy.ndimage", "scipy.sparse.csgraph", "yaml"):
        import_module(name)
    import locplan
    from locplan.cli import _application
    from locplan.field import _compute as cluster

    _application.application()
    cluster.PATIENCE = 0.5
    locplan.Explorer.open, locplan.Explorer.wait = lambda _: None, _interrupt
    assert "matplotlib" not in sys.modules  # it reads the environment when it is imported
    for request in sys.stdin:
        line, around = json.loads(request)
        for _ in range(2):
            answer = _answer(folder, line, around)
            if answer["code"] != str(128 + signal.SIGXCPU):
                break
        os.write(answers, (json.dumps(answer) + "\n").encode())
        for name in set(os.listdir(folder)) - {"in", "out", "tmp", "small"}:
            path = folder / name
            shutil.rmtree(path) if path.is_dir() else path.unlink()
        if len(os.listdir(folder / "out")) > 20:
            shutil.rmtree(folder / "out")
        for name in ("out", "home"):
            (folder / name).mkdir(exist_ok=True)
        _empty_small(folder)


def _interrupt(_: object) -> None:
    """End a page that is served as Ctrl-C does, but at once."""
    raise KeyboardInterrupt


def _answer(folder: Path, line: list[str], around: dict[str, Any]) -> dict[str, Any]:
    """Run a line in a process of its own; return its faults and what it took."""
    if around["out"]:
        (folder / "out").rename(folder / "away")
        (folder / "out").symlink_to(around["out"])
    before = contents(folder)
    pipes = [os.pipe() for _ in ("output", "errors", "logged")]
    process = os.fork()
    if not process:
        _start(line, around, *(write for _, write in pipes))
    for _, write in pipes:
        os.close(write)
    if around["streams"][1] == "broken":
        os.close(pipes[0][0])
        pipes[0] = (os.open(os.devnull, os.O_RDONLY), 0)
    with ThreadPoolExecutor(3) as pool:
        texts = [each.decode(errors="replace") for each in pool.map(_all_of, [r for r, _ in pipes])]
    # The system's fc-list, which matplotlib asks for fonts, says this of an unknown LC_ALL.
    texts[1] = "".join(
        line for line in texts[1].splitlines(keepends=True) if not line.startswith("Fontconfig")
    )
    _, status, usage = os.wait4(process, 0)
    code = os.waitstatus_to_exitcode(status)
    seen = [None if odd else text for odd, text in zip(around["streams"][1:], texts, strict=False)]
    found = list(faults(code, *seen, texts[2], broken=around["streams"][1] == "broken"))
    places = {**around["variables"], "TMPDIR": ""}.values()  # what is temporary has to go
    found += changes(before, contents(folder), _may_be_written([*line, *places]))
    if around["out"]:
        (folder / "out").unlink()
        (folder / "away").rename(folder / "out")
    memory = usage.ru_maxrss * 1024
    if memory > MEMORY:
        found.append(f"memory {memory / 1e9:.1f} GB")
    stderr = (texts[1] + texts[2])[-3000:] if found else texts[1][:200]
    answer = {"code": str(code), "faults": found, "memory": memory, "stderr": stderr}
    return answer | {"seconds": usage.ru_utime + usage.ru_stime}


def _all_of(descriptor: int) -> bytes:
    with os.fdopen(descriptor, "rb") as stream:
        return stream.read()


def _start(line: list[str], around: dict[str, Any], out: int, err: int, logged: int) -> None:
    """Run a line in this process as if Python had been started in its surroundings."""
    os.environ.update(around["variables"])
    kinds = around["streams"]
    for number, (kind, pipe) in enumerate(zip(kinds, (None, out, err), strict=True)):
        source = "/dev/full" if kind == "full" else os.devnull
        os.dup2(os.open(source, os.O_RDWR) if pipe is None or kind == "full" else pipe, number)
    for number in range(3, 256):
        if number != logged:
            with contextlib.suppress(OSError):
                os.close(number)
    encoding, _, errors = os.environ.get("PYTHONIOENCODING", "utf-8").partition(":")
    lax = os.environ.get("LC_ALL") in ("C", "POSIX")
    errors = errors or ("surrogateescape" if lax else "strict")
    for number, (kind, name) in enumerate(zip(kinds, ("stdin", "stdout", "stderr"), strict=True)):
        how = {"encoding": encoding, "errors": "backslashreplace" if number == 2 else errors}
        stream = open(number, "w" if number else "r", closefd=False, **how)  # noqa: SIM115
        if kind == "closed":
            os.close(number)
            stream = None
        setattr(sys, name, stream)
        setattr(sys, f"__{name}__", stream)
    tempfile.tempdir = None
    # The warnings of libraries, which are not shown.
    logging.getLogger("locplan").addHandler(logging.StreamHandler(os.fdopen(logged, "w")))
    logging.getLogger("locplan.cli").setLevel(logging.DEBUG)
    resource.setrlimit(resource.RLIMIT_AS, (ADDRESSES, ADDRESSES))
    resource.setrlimit(resource.RLIMIT_CPU, (SECONDS, resource.RLIM_INFINITY))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    if around["file_size"] is not None:
        sys.dont_write_bytecode = True  # Python keeps modules that it could write only in part
        resource.setrlimit(resource.RLIMIT_FSIZE, (around["file_size"], resource.RLIM_INFINITY))
    sys.argv = ["locplan", *line]
    from locplan.__main__ import main

    main()


class Served:
    """A process that runs lines, in a folder of its own; it is ended with the block."""

    def __init__(self) -> None:
        self.folder = Path(tempfile.mkdtemp(prefix="fuzz-"))
        (self.folder / "small").mkdir()
        mount = ["mount", "-t", "tmpfs", "-o", f"size={SMALL}", "tmpfs", str(self.folder / "small")]
        with contextlib.suppress(OSError):  # elsewhere and by others it is no disk of its own
            subprocess.run(mount, stderr=subprocess.DEVNULL, check=False)
        prepare(self.folder)
        ours, theirs = os.pipe()
        self._answers = os.fdopen(ours, "r")
        here = Path(__file__).resolve()
        code = f"import fuzz_commands as f; f.serve(f.Path({str(self.folder)!r}), {theirs})"
        self._process = subprocess.Popen(
            [sys.executable, "-c", code],
            stdin=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            pass_fds=[theirs],
            start_new_session=True,
            env={
                **os.environ,
                "PYTHONPATH": os.pathsep.join([str(here.parent), *filter(None, sys.path)]),
                "HOME": str(self.folder / "home"),
                "TMPDIR": str(self.folder / "tmp"),
                "LOCPLAN_CACHE": str(self.folder / "tmp" / "cache"),
                "MPLCONFIGDIR": str(self.folder / "tmp" / "matplotlib"),
                "COLUMNS": "120",
                "MALLOC_ARENA_MAX": "2",  # each thread's own would take 64 MB of addresses
            },
        )
        os.close(theirs)

    def run(self, line: list[str], around: dict[str, Any]) -> dict[str, Any]:
        """The answer to a line; one with the key "ended" if the process is no more."""
        assert self._process.stdin
        try:
            self._process.stdin.write(json.dumps([line, around]) + "\n")
            self._process.stdin.flush()
        except BrokenPipeError:
            pass
        ready, _, _ = select.select([self._answers], [], [], WALL)
        text = self._answers.readline() if ready else ""
        if text:
            return json.loads(text)
        why = "ended" if ready else "no answer"
        stderr = self.close()
        code = self._process.returncode
        faults = [f"{why}: {code}"]
        return {"code": str(code), "faults": faults, "stderr": stderr, "ended": True, "memory": 0}

    def close(self) -> str:
        """End the process and remove its folder; return what it has said on standard error."""
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self._process.pid, signal.SIGKILL)
        self._process.wait()
        assert self._process.stderr
        said = self._process.stderr.read()[-3000:]
        for stream in (self._process.stdin, self._process.stderr, self._answers):
            with contextlib.suppress(OSError):
                stream.close()
        if os.path.ismount(self.folder / "small"):
            subprocess.run(["umount", "-l", str(self.folder / "small")], check=False)
        shutil.rmtree(self.folder, ignore_errors=True)
        return said


def fuzz(
    count: int,
    seed: int,
    command: str = "",
    *,
    first: int = 0,
    leave_out: tuple[str, ...] = (),
    told: Any = None,
) -> list[dict[str, Any]]:
    """Run so many lines, each made of the seed and its number, from the first one on; return the
    answers."""
    commands = {
        names: options
        for names, options in declared().items()
        if names[0] in (command or names[0],) and names[0] not in leave_out
    }
    served, answers = None, []
    try:
        for number in range(first, first + count):
            chance = random.Random(f"{seed} {number}")
            line, around = line_of(chance, commands), surroundings_of(chance)
            if served is None or number % LINES_EACH == 0:
                if served:
                    served.close()
                served = Served()
            answer = {"number": number, "line": line, "around": around, **served.run(line, around)}
            answers.append(answer)
            if answer.get("ended"):
                served = None
            if told:
                told(answer)
    finally:
        if served:
            served.close()
    return answers


def shown(answer: dict[str, Any]) -> str:
    """A failure in a few lines."""
    line = shlex.join(answer["line"])
    around = {name: value for name, value in answer["around"].items() if value}
    text = f"{answer['number']}: {'; '.join(answer['faults'])}\n  locplan {line[:600]!a} {around!a}"
    return text + "\n  " + answer["stderr"].encode("utf-8", "replace").decode().strip()[-1200:]


def run(count: int = 1000, seed: int = 1, command: str = "") -> int:
    """Run lines, print what fails, and how many of each kind there were."""

    def tell(answer: dict[str, Any]) -> None:
        if answer["faults"]:
            print(shown(answer), flush=True)
        if answer["number"] % 100 == 99:
            print(f"-- {answer['number'] + 1} of {count}", flush=True)

    answers = fuzz(count, seed, command, told=tell)
    failed = [each for each in answers if each["faults"]]
    codes = dict(Counter(each["code"] for each in answers))
    longest = max((each.get("seconds", 0.0) for each in answers), default=0.0)
    most = max((each["memory"] for each in answers), default=0) / 1e9
    print(f"{count} lines of seed {seed}: exit codes {codes}, {len(failed)} with faults,")
    print(f"at most {longest:.1f} s of the processor and {most:.2f} GB")
    return 1 if failed else 0


if __name__ == "__main__":
    keep_kernels()
    given = sys.argv[1:]
    sys.exit(run(*map(int, given[:2]), *given[2:]))
