"""Reports of simulations, queries, evaluations and calibrations: tables for people, and files."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable
from pathlib import Path

from locplan._util.files import check_target, replacing
from locplan._util.intervals import digits_of, plain, short
from locplan._util.reading import parsed_json, read_text
from locplan._util.results import ResultFolder, digest_of
from locplan._util.tables import REPORT_WIDTH, table, write_json
from locplan.errors import LocplanError
from locplan.field import save_config
from locplan.robots import Robot
from locplan.simulation._calibration import Calibration
from locplan.simulation._evaluation import KIND_LABELS, KINDS, SIZES, Evaluation
from locplan.simulation._routes import Routes, RoutesOnMaps
from locplan.simulation._simulate import Simulation


def simulation_report(simulation: Simulation) -> str:
    """Table of the errors along each path, side by side."""
    head, *rows = simulation.table().turned()
    if len(head) == 2:  # one path has no ratio
        del rows[-1]
    count = len(next(iter(simulation.drives.values())).errors)
    return (
        f"{table(head, rows)}\nerrors of the position, of {count} drives each"
        f" [95 % intervals]\nwith {simulation.robot.title}"
    )


def routes_report(every: Iterable[Routes]) -> str:
    """Table of both paths of many queries, one row per map."""
    rows = [
        [
            routes.grid.name,
            f"{100 * (routes.length_ratio.value - 1):+.1f} %",
            _joined(" -> ", routes.median),
            "{:.0%} -> {:.0%}".format(*routes.lost),
            _joined(" -> ", routes.kept_rmse),
            _joined("", routes.rmse[:1]),
            short(routes.rmse_ratio),
            routes.verdict,
        ]
        for routes in every
    ]
    columns = ["map", "length", "median", "lost", "RMSE, kept", "RMSE", "ratio", "aware paths"]
    counts = sorted({len(routes.routes) for routes in every})
    queries = " to ".join(str(count) for count in {counts[0]: 0, counts[-1]: 0})
    return (
        f"{table(columns, rows)}\nshortest -> aware paths of {queries} queries, geometric means;"
        " errors of the\nposition [m]; lost: of the drives, > 1 m at any time; kept: those not"
        " lost; RMSE: of all drives\nalong the shortest; ratio: of the RMSE, aware over shortest"
        " [95 %]"
    )


def _joined(between: str, errors: Iterable[float]) -> str:
    """Some errors [m] in one cell of a table."""
    return between.join(plain(each, digits_of(each)) for each in errors)


def evaluation_report(evaluation: Evaluation) -> str:
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
            rows.append([name, short(found.spearman), *within, short(found.auc)])
        parts += [f"{KIND_LABELS[kind]}:", table(columns, rows)]
    parts += [
        "Spearman's correlation of e and the deviations with the RMSE of the position (*: of the",
        "heading) [95 %]; AUC: of finding the worst fifth of the places, by chance 0.5",
        _sizes(evaluation),
        f"{sum(len(each.points) for each in evaluation.places)} places, {evaluation.drives} drives"
        f" to each, {evaluation.scans} scans there;"
        f" with {evaluation.robot.title}",
        "",
        textwrap.fill(" ".join(evaluation.conclusion), REPORT_WIDTH),
    ]
    return "\n".join(parts)


def _sizes(evaluation: Evaluation) -> str:
    """Table of the errors' sizes, one row per map."""
    columns = ["map", "median", "lost", "RMSE,\nkept", "RMSE", "scan\nmedian", "scan\nRMSE"]
    rows = []
    for n, places in enumerate(evaluation.places):
        cells = {size: _joined("/", evaluation.quantiles(n, size)[1:]) for size in SIZES}
        cells["lost_rate"] = f"{evaluation.lost_rate(n):.0%}"
        rows.append([places.grid.name, *(cells[size] for size in SIZES)])
    return (
        f"{table(columns, rows)}\nerrors of the position, 50/90 % of the places [m]; lost:"
        " of the drives, > 1 m at any time;\nkept: those not lost"
    )


def write_routes(results: ResultFolder, every: RoutesOnMaps) -> list[Path]:
    """Write queries.json, queries.csv, and a picture of each map.

    Raises
    ------
    LocplanError
        If the folder cannot be made or written.
    """
    from locplan.plotting import save_figure
    from locplan.simulation import _figures

    pictures = every.pictures([routes.grid.name for routes in every])
    with results.writing() as folder:
        about, table_file = (folder / name for name in RoutesOnMaps.files.names)
        write_json(about, every.summary())
        every.table().write_csv(table_file)
        for name, routes in zip(pictures, every, strict=True):
            save_figure(_figures.queries_figure(routes), folder / name)
    return [results.folder / name for name in (*RoutesOnMaps.files.names, *pictures)]


def calibration_report(calibration: Calibration) -> str:
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
        else calibration.warning
    )
    return f"{table([], rows)}\n{verdict}"


def write_calibration(
    target: Path, calibration: Calibration, robot: Robot, *, force: bool = False
) -> list[Path]:
    """Write the calibrated settings as `locplan.save_config` does, and a picture beside them.

    The file says whether deviations are in metres, so that `locplan.load_config` can warn, and
    holds the robot that was simulated, for `Robot.load`.

    Raises
    ------
    LocplanError
        If a file cannot be written.
    """
    from locplan.plotting import save_figure
    from locplan.simulation import _figures

    picture = check_calibration(target, force=force)
    about = {**calibration.verdict, "robot": robot.summary()}
    about["calibration"] = calibration.summary()
    with replacing(picture) as drawn, replacing(target) as settings:
        try:
            save_figure(_figures.calibration_figure(calibration), drawn)
            save_config(settings, calibration.config, **about, picture=digest_of(drawn))
        except LocplanError as error:  # it names the files' last places
            text = str(error).replace(str(drawn), str(picture)).replace(str(settings), str(target))
            raise type(error)(text) from None
    return [target, picture]


def check_calibration(target: Path, *, force: bool = False) -> Path:
    """The picture beside a calibration, if both can be written; to be called before long work.

    Parameters
    ----------
    target : Path
        The file of the calibration, which ends in .json.
    force : bool, default False
        True lets files be replaced that are no calibration.

    Returns
    -------
    Path
        The picture.

    Raises
    ------
    LocplanError
        If one cannot be written, or is in the way, not as a calibration wrote it, without `force`.
    """
    check_target(target, ".json")
    picture = target.with_name(f"{target.stem}_calibration.png")
    check_target(picture, ".png")
    if force:
        return picture
    written = _picture_of(target) if target.exists() else None
    if target.exists() and not written:
        raise LocplanError(
            f"{target}: is there, and no calibration; name another file, or replace it with --force"
        )
    if picture.exists() and digest_of(picture) != written:
        raise LocplanError(
            f"{picture}: is in the way of the picture; move it, rename {target}, or replace it with"
            " --force"
        )
    return picture


def _picture_of(path: Path) -> str | None:
    """SHA-256 of the picture of a calibration, or None if the file is none."""
    try:
        content = parsed_json(read_text(path))
    except (LocplanError, ValueError):
        return None
    known = isinstance(content, dict) and {"config", "calibration"} <= set(content)
    return str(content.get("picture")) if known else None
