"""Reports of calibrations: a table for people, the settings, and a picture."""

from __future__ import annotations

from pathlib import Path

from locplan._util.files import check_target, replacing
from locplan._util.reading import parsed_json, read_text
from locplan._util.results import digest_of
from locplan._util.tables import table
from locplan.errors import LocplanError
from locplan.field import save_config
from locplan.robots import Robot
from locplan.simulation._calibration import Calibration


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
