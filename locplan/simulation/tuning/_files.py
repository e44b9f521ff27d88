"""What people get of tuning: the report, and the parameter file of Nav2 with the settings."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from pathlib import Path
from string import ascii_uppercase

from locplan._util.intervals import Interval, two_digits
from locplan._util.reading import scalar_text
from locplan._util.tables import table
from locplan.errors import LocplanError
from locplan.robots import (
    Amcl,
    ParameterWarning,
    edited_parameters,
    file_and_robot,
    read_amcl,
    read_parameters,
)
from locplan.simulation.tuning._results import Judged, Tuning
from locplan.simulation.tuning._space import NAMES, Value, axes_of

OTHERS: dict[str, float | str | bool] = {
    "base_frame_id": "base_footprint",
    "beam_skip_distance": 0.5,
    "beam_skip_error_threshold": 0.9,
    "beam_skip_threshold": 0.3,
    "do_beamskip": False,
    "global_frame_id": "map",
    "lambda_short": 0.1,
    "odom_frame_id": "odom",
    "recovery_alpha_fast": 0.0,
    "recovery_alpha_slow": 0.0,
    "save_pose_rate": 0.5,
    "scan_topic": "scan",
    "tf_broadcast": True,
    "transform_tolerance": 1.0,
    "z_max": 0.05,
    "z_short": 0.05,
}
"""Parameters that are not simulated, with the values that Nav2 has for them."""


def check_tunable(params: Path | None) -> None:
    """Check that tuned settings can be written into a file's copy; to be called before long work.

    Parameters
    ----------
    params : Path or None
        The user's parameter file.

    Raises
    ------
    LocplanError
        If they cannot.
    """
    if params is not None:
        axes = axes_of(_read(params))
        trial: dict[str, Value] = {name: 0.123 for axis in axes for name in axis.fields}
        _edited(params, trial | {"laser_model_type": "likelihood_field_prob", "max_beams": 1234})


def write_tuned(folder: Path, tuning: Tuning, params: Path | None = None) -> None:
    """Write nav2_params.yaml with what gains into a folder.

    It is the user's own file with other values, or without one a section of amcl.

    Parameters
    ----------
    folder : Path
        The folder.
    tuning : Tuning
        What was found.
    params : path, optional
        The user's parameter file, whose copy has other values; it stays as it is.

    Raises
    ------
    LocplanError
        If the file cannot be written, or the values in `params` cannot be changed alone.
    """
    file, winner, robot = folder / "nav2_params.yaml", tuning.winner, None
    if params is None:
        file.write_bytes(_new_file(winner))
    else:
        before, robot = _read(params), file_and_robot(params)[1]
        changed = {name: getattr(winner, name) for name in differing_names(before, winner)}
        file.write_bytes(_edited(params, changed))
    if differing_names(_read(Path(f"{file}:{robot}") if robot else file), winner):
        raise LocplanError(f"{file}: could not be written as it was meant to be")


def differing_names(one: Amcl, other: Amcl) -> list[str]:
    """The parameters in Nav2's files of which two settings have different values."""
    return [name for name in NAMES if getattr(one, name) != getattr(other, name)]


def _edited(params: Path, values: Mapping[str, Value]) -> bytes:
    """A file with these values, and beams not skipped where they are from now on."""
    skips = read_parameters(params).of("amcl").get("do_beamskip")
    if skips and values.get("laser_model_type") == "likelihood_field_prob":
        # It had no effect with the other laser model, and was not simulated with this one.
        values = {**values, "do_beamskip": False}
    return edited_parameters(params, "amcl", values)


def _read(file: Path) -> Amcl:
    """The settings in a file, about which was warned before."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ParameterWarning)
        return read_amcl(file)


def _new_file(winner: Amcl) -> bytes:
    values = {name: getattr(winner, name) for name in (*NAMES, "robot_model_type")} | OTHERS
    lines = ["# Parameters of Nav2's AMCL; frames and topics are Nav2's defaults."]
    lines += ["amcl:", "  ros__parameters:"]
    for name, value in sorted(values.items()):
        default = getattr(Amcl(), name, value)
        note = "" if value == default else f"  # Nav2's default is {_quoted(default)}"
        lines.append(f"    {name}: {_quoted(value)}{note}")
    return ("\n".join(lines) + "\n").encode()


def _quoted(value: float | str | bool) -> str:
    return f'"{value}"' if isinstance(value, str) else scalar_text(value)


def tuning_report(tuning: Tuning) -> str:
    """Table of the settings that were judged, the warnings, and the conclusion."""
    head = ["", *(level.name for level in tuning.levels), "RMSE to A's", "ms/update", "ms/m"]
    rows, names = [], []
    for letter, each in zip(ascii_uppercase, tuning.judged, strict=False):
        rows.append(
            [
                letter,
                *(f"{at.rmse.value:.2g} m {at.lost.value:.0%}" for at in each.levels),
                "1" if each is tuning.judged[0] else _short(each.rmse_ratio),
                f"{1e3 * each.cpu_per_update:.2f}",
                f"{1e3 * each.cpu_per_metre:.2f}",
            ]
        )
        names.append(f"{letter}: {_name(tuning, each)}")
    lines = [
        table(head, rows),
        *names,
        _explained(tuning),
        *_gains(tuning),
        f"{tuning.robot.known_lidar.title}: {tuning.beams_left}",
        *(f"warning: {each}" for each in tuning.lints),
        tuning.conclusion,
    ]
    return "\n".join(lines)


def _explained(tuning: Tuning) -> str:
    """What the table's numbers are."""
    if tuning.drive:
        return (
            "RMSE of the position and share of lost replays (> 1 m at any time), against the"
            f" recorded poses,\non {tuning.paths} stretches of {tuning.drive},"
            f" {tuning.drives} replays each, on which nothing was chosen;\nRMSE to A's [95 % over"
            " the stretches]; ms: CPU time"
        )
    return (
        "RMSE of the position and share of lost drives (> 1 m at any time), with a third of, once\n"
        f"and three times odometry's errors, on {tuning.paths} random paths, {tuning.drives} drives"
        " each, on which nothing was\nchosen; RMSE to A's over all levels [95 %]; ms: CPU time,"
        " with that of the simulated scan"
    )


def _gains(tuning: Tuning) -> list[str]:
    """What each change of the best setting gains, and what was put back."""
    kept = [axis.name for axis in tuning.changed_axes()]
    gains = [
        f"{name} {100 * (ratio - 1):+.0f} %{'' if name in kept else ' (put back)'}"
        for name, ratio in sorted(tuning.contributions.items(), key=lambda each: -each[1])
    ]
    where = "" if tuning.drive else " at its worst level"
    return [f"RMSE{where} without a change: {', '.join(gains)}"] if gains else []


def _name(tuning: Tuning, judged: Judged) -> str:
    marks = ["to use"] if judged.amcl == tuning.winner and tuning.changes else []
    if judged.better_everywhere and not tuning.drive:
        marks.append("better at every level")
    return f"{judged.name} ({'; '.join(marks)})" if marks else judged.name


def _short(interval: Interval) -> str:
    """Text of an interval without its leading zeros."""
    return two_digits(interval).removeprefix("0").replace("[0", "[").replace(" 0", " ")
