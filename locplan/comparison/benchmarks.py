"""Maps and scenarios of MovingAI's benchmarks, and benchmark logs of OMPL."""

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
    PlannerRun,
    compute_median_costs,
    list_best_costs,
    query_key_from_run,
)
from locplan.errors import LocplanError, MapError
from locplan.maps.files import load_map
from locplan.maps.grid import OccupancyGrid
from locplan.maps.occupancy import FREE, OCCUPIED
from locplan.planning.queries import Query


def read_benchmark_map(file: Path) -> OccupancyGrid:
    """Read a map of map_server, or of MovingAI if the file's name ends in .map."""
    return read_movingai_map(file) if file.suffix == ".map" else load_map(file)


def read_movingai_map(path: str | os.PathLike[str], resolution: float = 1.0) -> OccupancyGrid:
    """Read a map of MovingAI's benchmarks: passable cells are free, the rest are walls.

    The first row of the file is the top of the map, at the greatest y.

    Parameters
    ----------
    path : path
        The .map file.
    resolution : float, default 1.0
        Edge of a cell [m].

    Raises
    ------
    LocplanError
        If the file cannot be read, or is not a MovingAI map.
    """
    path = check_file_path("a map file", path)
    lines = read_text(path).splitlines()
    if "map" not in lines or not lines[0].startswith("type"):
        raise MapError(f"{path}: is not a MovingAI map; its first line must be 'type octile'")
    rows = [row for row in lines[lines.index("map") + 1 :] if row]
    if len({len(row) for row in rows}) != 1:
        raise MapError(f"{path}: its rows must all have the same length; download it again")
    letters = np.frombuffer("".join(rows[::-1]).encode("latin-1", "replace"), np.uint8)
    passable = np.isin(letters, list(b".GS")).reshape(len(rows), -1)
    cells = np.where(passable, np.uint8(FREE), np.uint8(OCCUPIED))
    return OccupancyGrid(cells, resolution, name=path.stem)


def read_scenarios(
    path: str | os.PathLike[str], grid: OccupancyGrid, *, count: int | None = None
) -> list[Query]:
    """Read the scenarios of a MovingAI benchmark as queries between cell centres.

    The rows of a .scen file count from the top of the map.

    Parameters
    ----------
    path : path
        The .scen file.
    grid : OccupancyGrid
        The map that the scenarios are for.
    count : int, optional
        Maximum number of queries, spread evenly over the file, which is sorted by length; all by
        default.

    Raises
    ------
    LocplanError
        If the file cannot be read, or a scenario is not for this map.
    """
    path = check_file_path("a file of scenarios", path)
    lines = read_text(path).splitlines()
    if not lines or not lines[0].startswith("version"):
        raise LocplanError(
            f"{path}: is not a MovingAI scenario; its first line must be 'version 1'"
        )
    queries = [
        _parse_scenario(path, number, line, grid)
        for number, line in enumerate(lines[1:], 2)
        if line.strip()
    ]
    if count is None or count >= len(queries):
        return queries
    return [queries[n] for n in np.linspace(0, len(queries) - 1, count).round().astype(int)]


def _parse_scenario(path: Path, number: int, line: str, grid: OccupancyGrid) -> Query:
    fields = line.split()
    try:
        cols, rows, start_col, start_row, goal_col, goal_row = map(int, fields[-7:-1])
    except ValueError:
        raise LocplanError(f"{path}: line {number} is not a scenario: {short_repr(line)}") from None
    if (rows, cols) != grid.shape:
        raise LocplanError(
            f"{path}: line {number} is for a map of {short_repr(cols)} x {short_repr(rows)}"
            " cells, but"
            f" {grid.name or 'this one'} has {grid.shape[1]} x {grid.shape[0]}"
        )
    if not (grid.contains(start_row, start_col) and grid.contains(goal_row, goal_col)):
        raise LocplanError(
            f"{path}: line {number} begins or ends outside its map: {short_repr(line)}"
        )
    start = grid.position(rows - 1 - start_row, start_col)
    goal = grid.position(rows - 1 - goal_row, goal_col)
    return Query(f"scenario {number - 1}", start, goal)


STATUS_BY_OMPL_NAME: Mapping[str, str] = {
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
"""Statuses of runs by their names in logs, in the order of their numbers in logs.

The names up to "Infeasible" are OMPL's, so that its logs fit into the same database."""


def write_ompl_logs(
    runs: Iterable[PlannerRun],
    folder: str | os.PathLike[str],
    *,
    baseline: str | None = None,
    time_limit: float = math.nan,
    memory_limit: float = math.nan,
    started: datetime | None = None,
) -> list[Path]:
    """Write an OMPL log for every map, configuration, weight and query into a new folder.

    Each combination of map, configuration and weight is a problem of Planner Arena, since J differs
    between them. The query is a parameter of the problem, which box plots can aggregate or
    separate. The only query of a problem is no parameter, because Planner Arena's progress page
    fails on parameters with one value.

    ``ompl_benchmark_statistics -d arena.db FOLDER/*.log`` creates the database and replaces an
    existing `arena.db`.

    Parameters
    ----------
    runs : iterable of Run
        The runs, at least one.
    folder : path
        The folder, which must not exist.
    baseline : str, optional
        Label of the planner whose J of the same query is the unit of the relative cost.
    time_limit, memory_limit : float, default nan
        The limits of a run [s, MB]; NaN if unknown.
    started : datetime, optional
        Start time of the runs; now by default.

    Raises
    ------
    LocplanError
        If there are no runs.
    """
    ordered = sorted(runs, key=lambda run: run.task)
    if not ordered:
        raise LocplanError("there are no runs to write a log of")
    environment = load_templates("locplan.comparison")
    environment.filters |= {"line": _format_line, "word": _join_words, "number": _format_number}
    template, costs = environment.get_template("ompl.log"), compute_median_costs(ordered)
    queries = Counter(setting for setting, _ in {query_key_from_run(run) for run in ordered})
    logs: dict[str, str] = {}
    for (setting, query), group in groupby(ordered, query_key_from_run):
        problem_runs, task = list(group), "{}, {}, weight {:g}".format(*setting)
        reference = costs.get(((setting, query), baseline or ""), math.nan)
        logs[f"{len(logs):04d}.log"] = template.render(
            version=__version__,
            title=task,
            about=f"{task}, query {query}",
            parameters=[_format_parameter(query)] if queries[setting] > 1 else [],
            host=platform.node() or "UNKNOWN",
            machine=platform.machine(),
            moment=(started or datetime.now()).isoformat(" ", "seconds"),
            limits=(time_limit, memory_limit),
            spent=sum(run.wall_seconds for run in problem_runs),
            outcomes=STATUS_BY_OMPL_NAME,
            planners=[
                _summarize_planner_runs(label, list(runs), reference)
                for label, runs in groupby(problem_runs, lambda run: run.task.planner)
            ],
        )
    folder = Path(folder)
    folder.mkdir()
    for name, text in logs.items():
        (folder / name).write_text(text, "ascii", "backslashreplace", newline="\n")
    return [folder / name for name in logs]


def _summarize_planner_runs(
    label: str, runs: Sequence[PlannerRun], reference_cost: float
) -> dict[str, Any]:
    """Return a planner's runs for a log, with their best costs at equal time steps."""
    points = [list_best_costs(run) for run in runs]
    has_history = any(
        run.history and run_points for run, run_points in zip(runs, points, strict=True)
    )
    end = max((time for run_points in points for time, _ in run_points), default=0.0)
    moments = np.linspace(0.0, end, 101)[1:]
    courses = (
        [_sample_best_costs(run_points, moments, reference_cost) for run_points in points]
        if has_history
        else []
    )
    records = [_collect_run_values(run, reference_cost) for run in runs]
    return {"label": label, "records": records, "courses": courses}


def _collect_run_values(run: PlannerRun, reference_cost: float) -> dict[str, float]:
    """Return the values of a run by OMPL's names; Planner Arena needs time and solved."""
    values = {
        "time REAL": run.seconds,
        "solved BOOLEAN": int(run.status == "solved"),
        "status ENUM": list(STATUS_BY_OMPL_NAME.values()).index(run.status),
        "planner seed INTEGER": run.task.seed,
        "wall time REAL": run.wall_seconds,
        "relative cost REAL": run.measures.get("cost", math.nan) / (reference_cost or math.nan),
    }
    for measure in MEASURES.keys() - {"seconds"}:
        head = "solution length" if measure == "length" else measure.replace("_", " ")
        values[f"{head} REAL"] = run.measures.get(measure, math.nan)
    return dict(sorted(values.items()))


def _sample_best_costs(
    timed_costs: Sequence[tuple[float, float]], moments: Array, reference_cost: float
) -> list[tuple[float, float, float]]:
    """Return cost, relative cost and time of a run from its first path to its end."""
    if not timed_costs:
        return []
    times, best = np.array(timed_costs).T
    lasting = moments[moments >= times[0]]
    lasting = lasting[: 1 + int(np.sum(lasting < times[-1]))]
    costs = best[np.searchsorted(times, lasting, side="right") - 1]
    relative = costs / (reference_cost or math.nan)
    return list(zip(costs.tolist(), relative.tolist(), lasting.tolist(), strict=True))


def _format_number(value: float) -> str:
    """Return the text of a number, or an empty text (NULL) if it is not finite."""
    return repr(value) if math.isfinite(value) else ""


def _format_line(text: str) -> str:
    return " ".join(text.split()) or "unnamed"


def _join_words(text: str) -> str:
    """Return a text as one word, since the script reads only the last word of some names."""
    return "_".join(text.split()) or "unnamed"


def _format_parameter(text: str) -> str:
    """Return a text that the script reads as the value of a parameter: no number, no " = "."""
    label = _format_line(text).replace(" = ", "=")
    try:
        float(label)
    except ValueError:
        return label
    return f"query {label}"
