"""Reports of simulations, evaluations and calibrations: tables for people, and files."""

from __future__ import annotations

import csv
import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from locplan import __version__
from locplan._util.files import check_target, replacing
from locplan._util.intervals import Interval
from locplan._util.results import ResultFolder, Results, digest_of
from locplan._util.tables import table
from locplan.errors import LocplanError
from locplan.field import save_config
from locplan.field._config_files import picture_of_calibration
from locplan.simulation._calibration import NOT_IN_METRES, Calibration
from locplan.simulation._drives import PROFILE, contrasts
from locplan.simulation._evaluation import KIND_LABELS, KINDS, Evaluation, best
from locplan.simulation._predictors import CLEARANCE, Predictor
from locplan.simulation._routes import COLUMNS, Routes
from locplan.simulation._simulate import Simulation

SIMULATION = Results("simulation", ("simulation.png", "simulation.json", "errors.csv"))
QUERIES = Results("queries", ("queries.json", "queries.csv"))
EVALUATION = Results("evaluation", ("evaluation.png", "evaluation.json", "places.csv"))

FEW_PLACES = 20
"""Number of places below which predictors are not judged."""


def simulation_table(simulation: Simulation) -> str:
    """Table of the errors along each path, side by side."""
    drives, ratios = simulation.drives, contrasts(simulation.drives)
    rows = [
        ["length", *(f"{each.distance[-1]:.2f} m" for each in drives.values())],
        ["position RMSE", *(_formatted(each.rmse, "m") for each in drives.values())],
        ["at the goal", *(_formatted(each.final_rmse, "m") for each in drives.values())],
        [
            "heading RMSE",
            *(_formatted(_degrees(each.heading_rmse), "deg") for each in drives.values()),
        ],
        ["lost (> 1 m at any time)", *(_share(each.lost_rate) for each in drives.values())],
    ]
    if ratios:
        rows.append([f"RMSE over {next(iter(drives))}'s", "", *map(_formatted, ratios.values())])
    count = len(next(iter(drives.values())).errors)
    return (
        f"{table(['', *drives], rows)}\n{count} drives each, [95 % intervals];"
        f" {simulation.lidar.title}; AMCL of"
        f" {simulation.amcl.min_particles}-{simulation.amcl.max_particles} particles"
    )


def routes_table(every: Sequence[Routes]) -> str:
    """Table of both paths of many queries, one row per map."""
    rows = [
        [
            routes.grid.name,
            f"{100 * (routes.length_ratio.value - 1):+.1f} %",
            f"{routes.rmse[0]:.2f} m",
            _short(routes.rmse_ratio),
            f"{routes.lost[0]:.0%} -> {routes.lost[1]:.0%}",
            routes.verdict,
        ]
        for routes in every
    ]
    columns = ["map", "length", "RMSE", "RMSE ratio", "lost", "aware paths"]
    counts = sorted({len(routes.routes) for routes in every})
    queries = " to ".join(str(count) for count in {counts[0]: 0, counts[-1]: 0})
    return (
        f"{table(columns, rows)}\naware path over shortest, of {queries} queries: geometric means"
        " [95 %]; RMSE that of the shortest"
    )


def evaluation_table(evaluation: Evaluation) -> str:
    """Tables of how well each predictor ranks places, and of how large the errors were."""
    several = len(evaluation.places) > 1
    columns = ["predictor", "correlation", *(["in a map"] if several else []), "AUC"]
    parts = []
    for kind in KINDS:
        rows = []
        for predictor in evaluation.predictions[0]:
            found = evaluation.ranks[predictor, kind]
            within = [f"{found.within.value:.2f}"] if several else []
            name = f"{predictor}{' *' if predictor.of_heading else ''}"
            rows.append([name, _short(found.spearman), *within, _short(found.auc)])
        parts += [f"{KIND_LABELS[kind]}:", table(columns, rows)]
    parts += [
        "Spearman's correlation of e and the deviations with the RMSE of the position (*: of the",
        "heading) [95 %]; AUC: of finding the worst fifth of the places, by chance 0.5",
        *_verdicts(evaluation),
        table(
            ["map", "places", *(f"{kind} RMSE, 10/50/90 %" for kind in KINDS)], _sizes(evaluation)
        ),
    ]
    return "\n".join(parts)


def _verdicts(evaluation: Evaluation) -> list[str]:
    """One line per kind of error: if e ranks it better than chance, and the best predictor."""
    count = sum(len(each.points) for each in evaluation.places)
    if count < FEW_PLACES:
        return [f"{count} places are too few to tell: take at least {FEW_PLACES}"]
    lines = []
    for kind in KINDS:
        default, simple = Predictor("sad", "e"), Predictor(CLEARANCE, "")
        found = evaluation.ranks[default, kind].spearman
        verdict = "better than chance" if found.low > 0 else "no better than chance"
        if found.high < 0:
            verdict = "WRONG WAY ROUND"
        chosen, value = best(evaluation, kind)
        other = evaluation.ranks[simple, kind].spearman.value
        lines.append(
            f"{kind}: the default field's e {_plain(found.value)}, {verdict};"
            f" best {chosen} {_plain(value.value)}; {simple} {_plain(other)}"
        )
    return lines


def _sizes(evaluation: Evaluation) -> list[list[str]]:
    """One row per map: its name, number of places, and percentiles of the errors [m]."""
    return [
        [
            places.grid.name,
            str(len(places.points)),
            *(" / ".join(f"{v:.2f}" for v in evaluation.quantiles(n, k)) + " m" for k in KINDS),
        ]
        for n, places in enumerate(evaluation.places)
    ]


def calibration_table(calibration: Calibration) -> str:
    """Table of what was fitted, and of how well it fits."""
    rows = [
        ["maps", ", ".join(calibration.maps)],
        ["places", str(len(calibration.measured))],
        ["error", f"{calibration.error}, RMSE of the position"],
        ["noise level k", "{:.3g} [{:.3g}, {:.3g}]".format(*calibration.noise_level)],
    ]
    if calibration.fitted_tau:
        rows.append(["tau", f"{calibration.tau:.3g} m²"])
    rows += [
        [
            "typically off by a factor",
            f"{calibration.factor:.2f}; as it was {calibration.factor_before:.2f}",
        ],
        ["within a factor 2", f"{calibration.within_two:.0%} of the places"],
        [
            "variance of ln error explained",
            f"{calibration.r_squared:.0%}" if calibration.in_metres else "none",
        ],
        ["rank correlation", f"{calibration.spearman:.2f}"],
        ["consistency, 1 if Σ fits", f"{calibration.consistency:.2f}"],
        ["errors below the steps' own, Q", f"{calibration.floor_share:.0%} of the places"],
    ]
    verdict = (
        "Σ follows the errors, within the factor above"
        if calibration.in_metres
        else f"NOT IN METRES: {NOT_IN_METRES}"
    )
    return f"{table([], rows)}\n{verdict}"


def write_simulation(results: ResultFolder, simulation: Simulation) -> list[Path]:
    """Write simulation.json, simulation.png, and errors.csv with the error along each path.

    Raises
    ------
    LocplanError
        If the folder cannot be made or written.
    """
    from locplan.plotting import save_figure
    from locplan.simulation import _figures

    with results.writing() as folder:
        picture, about, errors = (folder / name for name in SIMULATION.names)
        save_figure(_figures.simulation_figure(simulation), picture)
        _write_json(about, simulation.summary())
        rows = ([name, *row] for name, each in simulation.drives.items() for row in each.profile())
        _write_rows(errors, ["path", *PROFILE], rows)
    return [results.folder / name for name in SIMULATION.names]


def write_routes(results: ResultFolder, every: Sequence[Routes]) -> list[Path]:
    """Write queries.json, queries.csv, and a picture of each map.

    Raises
    ------
    LocplanError
        If the folder cannot be made or written.
    """
    from locplan.plotting import save_figure
    from locplan.simulation import _figures

    pictures = picture_names([routes.grid.name for routes in every])
    with results.writing() as folder:
        about, table_file = (folder / name for name in QUERIES.names)
        _write_json(about, routes_summary(every))
        rows = ([routes.grid.name, *row] for routes in every for row in routes.rows())
        _write_rows(table_file, ["map", *COLUMNS], rows)
        for name, routes in zip(pictures, every, strict=True):
            save_figure(_figures.queries_figure(routes), folder / name)
    return [results.folder / name for name in (*QUERIES.names, *pictures)]


def picture_names(maps: Sequence[str]) -> list[str]:
    """Names of the pictures of queries on maps of these names."""
    return [f"{number:02}-{_file_name(name or 'map')}.png" for number, name in enumerate(maps, 1)]


def write_evaluation(results: ResultFolder, evaluation: Evaluation) -> list[Path]:
    """Write evaluation.json, evaluation.png, and places.csv with one row per place.

    Raises
    ------
    LocplanError
        If the folder cannot be made or written.
    """
    from locplan.plotting import save_figure
    from locplan.simulation import _figures

    with results.writing() as folder:
        picture, about, places = (folder / name for name in EVALUATION.names)
        save_figure(_figures.evaluation_figure(evaluation), picture)
        _write_json(about, evaluation.summary())
        rows = ([name, *row] for name, values in evaluation.rows() for row in values)
        _write_rows(places, ["map", *evaluation.columns], rows)
    return [results.folder / name for name in EVALUATION.names]


def write_calibration(target: Path, calibration: Calibration) -> list[Path]:
    """Write the calibrated settings as `locplan.save_config` does, and a picture beside them.

    The file says whether deviations are in metres, so that `locplan.load_config` can warn.

    Raises
    ------
    LocplanError
        If a file cannot be written.
    """
    from locplan.plotting import save_figure
    from locplan.simulation import _figures

    picture = check_calibration(target)
    about = {**calibration.verdict, "calibration": calibration.summary()}
    with replacing(picture) as drawn, replacing(target) as settings:
        try:
            save_figure(_figures.calibration_figure(calibration), drawn)
            save_config(settings, calibration.config, **about, picture=digest_of(drawn))
        except LocplanError as error:  # it names the files' last places
            text = str(error).replace(str(drawn), str(picture)).replace(str(settings), str(target))
            raise type(error)(text) from None
    return [target, picture]


def check_calibration(target: Path) -> Path:
    """The picture beside a calibration, if both can be written; to be called before long work.

    Raises
    ------
    LocplanError
        If one cannot be written, or if one is there that is not as a calibration wrote it.
    """
    check_target(target, ".json")
    picture = target.with_name(f"{target.stem}_calibration.png")
    check_target(picture, ".png")
    written = picture_of_calibration(target) if target.exists() else None
    if target.exists() and not written:
        raise LocplanError(f"{target}: is there, and no calibration; name another file")
    if picture.exists() and digest_of(picture) != written:
        raise LocplanError(f"{picture}: is in the way of the picture; move it, or rename {target}")
    return picture


def routes_summary(every: Sequence[Routes]) -> dict[str, Any]:
    """Summary of all maps' queries, fit for JSON."""
    return {"maps": [routes.summary() for routes in every]}


def _write_json(file: Path, about: Mapping[str, object]) -> None:
    with replacing(file) as temporary:
        text = json.dumps({"locplan": __version__, **about}, indent=2)
        temporary.write_text(text + "\n", encoding="utf-8")


def _write_rows(target: Path, columns: Sequence[str], rows: Iterable[Sequence[Any]]) -> None:
    """Write rows of names and numbers, as a whole or not at all."""
    with replacing(target) as temporary, temporary.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(columns)
        writer.writerows(
            [value if isinstance(value, str) else f"{value:.9g}" for value in row] for row in rows
        )


def _file_name(name: str) -> str:
    return "".join(c if c.isalnum() or c in "-_." else "-" for c in name)


def _degrees(interval: Interval) -> Interval:
    return Interval(*np.degrees(interval).tolist())


def _share(interval: Interval) -> str:
    return f"{interval.value:.0%} [{interval.low:.0%}, {interval.high:.0%}]"


def _plain(value: float) -> str:
    return f"{value:.2f}".replace("0.", ".", 1)


def _short(interval: Interval) -> str:
    value, low, high = map(_plain, interval)
    return value if np.isnan(interval.low) else f"{value} [{low}, {high}]"


def _formatted(interval: Interval, unit: str = "") -> str:
    value, low, high = interval
    ends = "" if np.isnan(low) else f" [{low:.2f}, {high:.2f}]"
    return f"{value:.2f}{' ' * bool(unit)}{unit}{ends}"
