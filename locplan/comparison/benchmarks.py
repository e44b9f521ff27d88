"""What others have: maps and scenarios of MovingAI's benchmarks, and the benchmark logs of OMPL."""

from __future__ import annotations

import math
import os
import platform
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from datetime import datetime
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np

from locplan import __version__
from locplan._support.checks import check_file_path, short_repr
from locplan._support.public import load_templates
from locplan._support.reading import read_text
from locplan.comparison.statistics import (
    MEASURES,
    Array,
    Run,
    best_so_far,
    compute_median_costs,
    query_from_run,
)
from locplan.errors import LocplanError, MapError
from locplan.maps.files import load_map
from locplan.maps.grid import OccupancyGrid
from locplan.maps.occupancy import FREE, OCCUPIED
from locplan.planning.queries import Query


def read_benchmark_map(file: Path) -> OccupancyGrid:
    """Read a map of map_server or, if its name ends in .map, of MovingAI."""
    return read_movingai_map(file) if file.suffix == ".map" else load_map(file)


def read_movingai_map(path: str | os.PathLike[str], resolution: float = 1.0) -> OccupancyGrid:
    """The map of a MovingAI benchmark: passable cells are free, all others are walls.

    The file's first row of cells is the map's top, which has the greatest y.

    Parameters
    ----------
    path : path
        The .map file.
    resolution : float, default 1.0
        Edge of a cell [m].

    Raises
    ------
    LocplanError
        If the file cannot be read, or is no such map.
    """
    path = check_file_path("a map file", path)
    lines = read_text(path).splitlines()
    if "map" not in lines or not lines[0].startswith("type"):
        raise MapError(f"{path}: is no MovingAI map; its first line must be 'type octile'")
    rows = [row for row in lines[lines.index("map") + 1 :] if row]
    if len({len(row) for row in rows}) != 1:
        raise MapError(f"{path}: its rows must all have one length; download it anew")
    letters = np.frombuffer("".join(rows[::-1]).encode("latin-1", "replace"), np.uint8)
    passable = np.isin(letters, list(b".GS")).reshape(len(rows), -1)
    cells = np.where(passable, np.uint8(FREE), np.uint8(OCCUPIED))
    return OccupancyGrid(cells, resolution, name=path.stem)


def read_scenarios(
    path: str | os.PathLike[str], grid: OccupancyGrid, *, count: int | None = None
) -> list[Query]:
    """The scenarios of a MovingAI benchmark as queries, from cell centre to cell centre.

    The rows of a .scen file count from the map's top.

    Parameters
    ----------
    path : path
        The .scen file.
    grid : OccupancyGrid
        The map that the scenarios are for.
    count : int, optional
        Maximum number of queries, taken evenly over the file, where they are sorted by length;
        all by default.

    Raises
    ------
    LocplanError
        If the file cannot be read, or a scenario is not for this map.
    """
    path = check_file_path("a file of scenarios", path)
    lines = read_text(path).splitlines()
    if not lines or not lines[0].startswith("version"):
        raise LocplanError(f"{path}: is no MovingAI scenario; its first line must be 'version 1'")
    queries = [
        _scenario(path, number, line, grid)
        for number, line in enumerate(lines[1:], 2)
        if line.strip()
    ]
    if count is None or count >= len(queries):
        return queries
    return [queries[n] for n in np.linspace(0, len(queries) - 1, count).round().astype(int)]


def _scenario(path: Path, number: int, line: str, grid: OccupancyGrid) -> Query:
    fields = line.split()
    try:
        cols, rows, start_col, start_row, goal_col, goal_row = map(int, fields[-7:-1])
    except ValueError:
        raise LocplanError(f"{path}: line {number}: is no scenario: {short_repr(line)}") from None
    if (rows, cols) != grid.shape:
        raise LocplanError(
            f"{path}: line {number}: is for a map of {short_repr(cols)} x {short_repr(rows)}"
            " cells, but"
            f" {grid.name or 'this one'} has {grid.shape[1]} x {grid.shape[0]}"
        )
    if not (grid.contains(start_row, start_col) and grid.contains(goal_row, goal_col)):
        raise LocplanError(
            f"{path}: line {number}: begins or ends outside its map: {short_repr(line)}"
        )
    start = grid.position(rows - 1 - start_row, start_col)
    goal = grid.position(rows - 1 - goal_row, goal_col)
    return Query(f"scenario {number - 1}", start, goal)


OUTCOMES: Mapping[str, str] = {
    **dict.fromkeys(("Unknown status", "Invalid start", "Invalid goal"), ""),
    "Unrecognized goal type": "",
    "Timeout": "timeout",
    "Approximate solution": "",
    "Exact solution": "solved",
    "Crash": "crashed",
    "Aborted": "",
    "Infeasible": "infeasible",
    **{status.capitalize(): status for status in ("unreachable", "error", "hung", "out of memory")},
    "Not found": "not found",
}
"""Statuses of runs by their names in logs, in the order of their numbers there; those up to
"Infeasible" are OMPL's own, so that its logs may join the database."""


def write_ompl_logs(
    runs: Iterable[Run],
    folder: str | os.PathLike[str],
    *,
    baseline: str | None = None,
    time_limit: float = math.nan,
    memory_limit: float = math.nan,
    started: datetime | None = None,
) -> list[Path]:
    """Write one log for every map, configuration, weight and query into a folder.

    J differs between maps, configurations and weights: each of their combinations is one of
    Planner Arena's problems. The query is a parameter of the problem, over which its box plots
    aggregate, or which they take apart. Where a problem has a single query it is no parameter:
    Planner Arena's progress page fails on parameters with one value.

    The folder is made for them. ``ompl_benchmark_statistics -d arena.db
    FOLDER/*.log`` makes the database, and replaces an `arena.db` that is there.

    Parameters
    ----------
    runs : iterable of Run
        The runs, at least one.
    folder : path
        The folder, which must not exist.
    baseline : str, optional
        Label of the planner by whose J of the same query the relative cost is divided.
    time_limit, memory_limit : float, default nan
        The limits of a run [s, MB]; NaN where they are not known.
    started : datetime, optional
        When the runs began; now by default.

    Raises
    ------
    LocplanError
        If there are no runs.
    """
    ordered = sorted(runs, key=lambda run: run.task)
    if not ordered:
        raise LocplanError("there are no runs to write a log of")
    environment = load_templates("locplan.comparison")
    environment.filters |= {"line": _line, "word": _word, "number": _number}
    template, costs = environment.get_template("ompl.log"), compute_median_costs(ordered)
    queries = Counter(setting for setting, _ in {query_from_run(run) for run in ordered})
    logs: dict[str, str] = {}
    for (setting, query), group in groupby(ordered, query_from_run):
        problem_runs, task = list(group), "{}, {}, weight {:g}".format(*setting)
        reference = costs.get(((setting, query), baseline or ""), math.nan)
        logs[f"{len(logs):04d}.log"] = template.render(
            version=__version__,
            title=task,
            about=f"{task}, query {query}",
            parameters=[_parameter(query)] if queries[setting] > 1 else [],
            host=platform.node() or "UNKNOWN",
            machine=platform.machine(),
            moment=(started or datetime.now()).isoformat(" ", "seconds"),
            limits=(time_limit, memory_limit),
            spent=sum(run.wall_seconds for run in problem_runs),
            outcomes=OUTCOMES,
            planners=[
                _planner(label, list(runs), reference)
                for label, runs in groupby(problem_runs, lambda run: run.task.planner)
            ],
        )
    folder = Path(folder)
    folder.mkdir()
    for name, text in logs.items():
        (folder / name).write_text(text, "ascii", "backslashreplace", newline="\n")
    return [folder / name for name in logs]


def _planner(label: str, runs: Sequence[Run], reference: float) -> dict[str, Any]:
    """The runs of a planner in a log, and their best cost at equal steps, as OMPL samples it."""
    points = [best_so_far(run) for run in runs]
    has_history = any(
        run.history and run_points for run, run_points in zip(runs, points, strict=True)
    )
    end = max((time for run_points in points for time, _ in run_points), default=0.0)
    moments = np.linspace(0.0, end, 101)[1:]
    courses = (
        [_samples(run_points, moments, reference) for run_points in points] if has_history else []
    )
    records = [_properties(run, reference) for run in runs]
    return {"label": label, "records": records, "courses": courses}


def _properties(run: Run, reference: float) -> dict[str, float]:
    """The values of a run; Planner Arena needs time and solved, and draws no enum but status."""
    values = {
        "time REAL": run.seconds,
        "solved BOOLEAN": int(run.status == "solved"),
        "status ENUM": list(OUTCOMES.values()).index(run.status),
        "planner seed INTEGER": run.task.seed,
        "wall time REAL": run.wall_seconds,
        "relative cost REAL": run.measures.get("cost", math.nan) / (reference or math.nan),
    }
    for measure in MEASURES.keys() - {"seconds"}:
        head = "solution length" if measure == "length" else measure.replace("_", " ")
        values[f"{head} REAL"] = run.measures.get(measure, math.nan)
    return dict(sorted(values.items()))


def _samples(
    points: Sequence[tuple[float, float]], moments: Array, reference: float
) -> list[tuple[float, float, float]]:
    """Cost, relative cost and time of a run from its first path to its end."""
    if not points:
        return []
    times, best = np.array(points).T
    lasting = moments[moments >= times[0]]
    lasting = lasting[: 1 + int(np.sum(lasting < times[-1]))]
    costs = best[np.searchsorted(times, lasting, side="right") - 1]
    relative = costs / (reference or math.nan)
    return list(zip(costs.tolist(), relative.tolist(), lasting.tolist(), strict=True))


def _number(value: float) -> str:
    """Text of a number; empty, which becomes NULL, if not finite: "-inf" would become a text."""
    return repr(value) if math.isfinite(value) else ""


def _line(text: str) -> str:
    return " ".join(text.split()) or "unnamed"


def _word(text: str) -> str:
    """The text as one word: of an experiment's or host's name the script takes the last word."""
    return "_".join(text.split()) or "unnamed"


def _parameter(text: str) -> str:
    """The text as Planner Arena can choose it, no number, and as the script reads it, no " = "."""
    label = _line(text).replace(" = ", "=")
    try:
        float(label)
    except ValueError:
        return label
    return f"query {label}"
