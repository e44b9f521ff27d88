"""Run all benchmarks, and write one table with peers, limits and the machine.

    python tests/benchmarks/table.py FOLDER [--compare LAST.json] [--worse 0.25] [-k planners]

The program runs every `bench_*.py` of this folder. The entries of `benchmark.extra_info` fill the
rows:

- `ratio_to_PEER`: the peer's time divided by ours, in the same run;
- `share_of_LIMIT`: our speed as a share of the limit's, at most 1;
- `no_peer`: the reason why there is no peer, such as a time limit;
- all others are figures next to the seconds.

Without the first three, the yardstick is NumPy's sort of a million numbers before and after the
benchmark. Larger ratios and shares are better. `--compare` names each that fell by more than
`--worse` (a share) since the last table, and ends with exit code 1.
"""

from __future__ import annotations

import argparse
import csv
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, fields
from importlib.metadata import version
from itertools import zip_longest
from pathlib import Path
from typing import Any

from locplan._support.files import check_writable_folder, translate_write_errors
from locplan._support.output import replace_file
from locplan.errors import LocplanError

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent.parent
NAME = "benchmarks"
YARDSTICK = "yardstick (NumPy sorts 10^6)"
PEER, LIMIT = "ratio_to_", "share_of_"
WORSE = 0.25
"""Share that a ratio may lose before it counts as worse; those of a shared machine vary by 0.1."""
LIBRARIES = ("locplan", "numpy", "scipy", "numba", "opencv-python-headless", "ompl")


@dataclass(frozen=True)
class Row:
    """One benchmark beside one peer and one limit."""

    benchmark: str
    """Name of the file and of the test, with its parameters."""
    seconds: float
    """Least time of a round [s]."""
    peer: str = ""
    """What does the same; empty where this row has none."""
    ratio: float | None = None
    """Time of the peer in times of ours: larger is better."""
    limit: str = ""
    """What binds; empty where it is not known."""
    share: float | None = None
    """How near the limit ours is, 1 at the limit: larger is better."""
    figures: str = ""
    """Further figures, or why there is no peer."""


def name_of(measured: dict[str, Any]) -> str:
    """Such as `planners: single objective [1000]`."""
    file, _, test = measured["fullname"].rpartition("::")
    test, bracket, parameters = test.partition("[")
    words = test.removeprefix("test_").replace("_", " ")
    return f"{Path(file).stem.removeprefix('bench_')}: {words}{' ' * bool(bracket)}" + (
        bracket + parameters
    )


def rows_of(measured: dict[str, Any]) -> list[Row]:
    """The rows of one benchmark in the JSON of pytest-benchmark."""
    name, seconds = name_of(measured), measured["stats"]["min"]
    left = dict(measured.get("extra_info", {}))
    yardstick, reason = left.pop("yardstick", None), left.pop("no_peer", None)
    peers, limits = taken(left, PEER), taken(left, LIMIT)
    if not peers and not limits and reason is None and yardstick is not None:
        peers = [(YARDSTICK, yardstick / seconds)]
    if not peers and reason is not None:
        peers = [("none", None)]
    told = [f"{key.replace('_', ' ')} {shown(value)}" for key, value in left.items()]
    figures = "; ".join(([reason] if reason else []) + told)
    pairs = list(zip_longest(peers, limits, fillvalue=("", None))) or [(("", None), ("", None))]
    return [
        Row(name, seconds, *peer, *limit, figures if n == 0 else "")
        for n, (peer, limit) in enumerate(pairs)
    ]


def taken(left: dict[str, Any], prefix: str) -> list[tuple[str, Any]]:
    """Remove what begins so, and give it back by the rest of its name."""
    keys = [key for key in left if key.startswith(prefix)]
    return [(key.removeprefix(prefix).replace("_", " "), left.pop(key)) for key in keys]


def shown(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:,.0f}" if abs(value) >= 1000 else f"{value:.3g}"
    return "" if value is None else str(value)


def machine_of(raw: dict[str, Any]) -> dict[str, str]:
    """What the figures depend on besides the code, and the code's commit."""
    machine, commit = raw["machine_info"], raw.get("commit_info", {})
    cpu = machine.get("cpu", {})
    return {
        "processor": f"{cpu.get('brand_raw', machine.get('machine', 'unknown'))}",
        "cores": str(os.cpu_count()),
        "system": f"{machine['system']} {machine['release']}",
        "python": machine["python_version"],
        **{name: version(name) for name in LIBRARIES},
        "commit": f"{commit.get('id') or 'unknown'}{' with changes' * bool(commit.get('dirty'))}",
        "date": raw["datetime"],
    }


def markdown(rows: Sequence[Row], machine: dict[str, str]) -> str:
    """The table for people."""
    heads = ("benchmark", "least seconds", "peer", "ratio", "limit", "share", "figures")
    cells = [[shown(getattr(row, field.name)) for field in fields(Row)] for row in rows]
    lines = [list(heads), ["---", "---:", "---", "---:", "---", "---:", "---"], *cells]
    table = "\n".join(f"| {' | '.join(c.replace('|', '/') for c in line)} |" for line in lines)
    return (
        "# Benchmarks\n\nRatio: the peer's time in times of ours; share: how near its limit ours"
        f" is. Larger is better.\n\n{table}\n\n"
        + "\n".join(f"- {key}: {value}" for key, value in machine.items())
        + "\n"
    )


def ratios(rows: Sequence[Row]) -> Iterator[tuple[tuple[str, str], float]]:
    """Each ratio and share that can be compared, by benchmark and by what it is beside."""
    for row in rows:
        for beside, value in ((row.peer, row.ratio), (row.limit and f"of {row.limit}", row.share)):
            if beside and value is not None:
                yield (row.benchmark, beside), value


def worse(now: Sequence[Row], last: Sequence[Row], share: float) -> list[str]:
    """A line for each ratio that fell by more than a share since the last table."""
    before = dict(ratios(last))
    return [
        f"{key[0]}, {key[1]}: {shown(value)}, and it was {shown(before[key])}"
        f" ({value / before[key] - 1:+.0%})"
        for key, value in ratios(now)
        if key in before and value < (1 - share) * before[key]
    ]


def missing(now: Sequence[Row], last: Sequence[Row]) -> list[str]:
    """What the last table compared and this one does not."""
    return [", ".join(key) for key in dict(ratios(last)).keys() - dict(ratios(now)).keys()]


def read(file: Path) -> list[Row]:
    """The rows of an earlier table."""
    try:
        return [Row(**row) for row in json.loads(file.read_text(encoding="utf-8"))["rows"]]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise LocplanError(
            f"{file}: is no table of benchmarks, such as FOLDER/{NAME}.json of an earlier run"
            f" ({error})"
        ) from None


def write(folder: Path, rows: Sequence[Row], machine: dict[str, str]) -> None:
    """The table as Markdown, CSV and JSON, each whole or not at all."""
    with translate_write_errors(folder):
        folder.mkdir(parents=True, exist_ok=True)
    plain = [asdict(row) for row in rows]
    with replace_file(folder / f"{NAME}.md") as file:
        file.write_text(markdown(rows, machine), encoding="utf-8")
    with (
        replace_file(folder / f"{NAME}.csv") as file,
        file.open("w", newline="", encoding="utf-8") as out,
    ):
        writer = csv.DictWriter(out, [field.name for field in fields(Row)])
        writer.writeheader()
        writer.writerows(plain)
    with replace_file(folder / f"{NAME}.json") as file:
        file.write_text(json.dumps({"machine": machine, "rows": plain}, indent=1) + "\n")


def measure(selected: Sequence[str]) -> tuple[dict[str, Any], bool]:
    """Run the benchmarks; the JSON of pytest-benchmark, and whether all of them ran."""
    with tempfile.TemporaryDirectory() as folder:
        raw = Path(folder, "raw.json")
        command = [sys.executable, "-m", "pytest", str(HERE), "-o", "python_files=bench_*.py", "-q"]
        command += ["--benchmark-only", f"--benchmark-json={raw}", "--benchmark-columns=min,rounds"]
        # Under pytest's own variables, those of xdist's workers, nothing would be measured.
        env = {name: each for name, each in os.environ.items() if not name.startswith("PYTEST_")}
        done = subprocess.run([*command, *selected], cwd=ROOT, env=env)
        if not raw.exists() or not raw.stat().st_size:
            raise LocplanError(
                f"no benchmark was measured, pytest ended with code {done.returncode}"
            )
        return json.loads(raw.read_text(encoding="utf-8")), done.returncode == 0


def main(given: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        description="Run the benchmarks and write one table of them.",
        epilog=f"What else is given goes to pytest, such as -k planners. The table is {NAME}.md,"
        f" {NAME}.csv and {NAME}.json in the folder.",
    )
    parser.add_argument("folder", type=Path, help="where the table is written")
    parser.add_argument("--compare", type=Path, metavar="LAST.json", help="an earlier table")
    parser.add_argument(
        "--worse",
        type=float,
        default=WORSE,
        metavar="SHARE",
        help="share that a ratio may lose (default: %(default)s)",
    )
    options, selected = parser.parse_known_args(given)
    if not 0 <= options.worse < 1:
        parser.error(f"--worse must be at least 0 and below 1, not {options.worse:g}")
    try:
        check_writable_folder(options.folder)
        last = read(options.compare) if options.compare else []
        raw, complete = measure(selected)
        rows = [row for measured in raw["benchmarks"] for row in rows_of(measured)]
        write(options.folder, rows, machine_of(raw))
    except LocplanError as error:
        parser.exit(2, f"{parser.prog}: error: {error}\n")
    print(f"\n{markdown(rows, machine_of(raw))}\nwrote {options.folder / NAME}.md, .csv and .json")
    fallen = worse(rows, last, options.worse)
    if not selected:
        for name in missing(rows, last):
            print(f"not measured any more: {name}")
    for line in fallen:
        print(f"worse by more than {options.worse:.0%}: {line}")
    if options.compare and not fallen:
        compared = len(dict(ratios(rows)).keys() & dict(ratios(last)).keys())
        print(f"{compared} ratios compared, none worse by more than {options.worse:.0%}")
    if not complete:
        print("some benchmarks failed, see above")
    return 0 if complete and not fallen else 1


if __name__ == "__main__":
    sys.exit(main())
