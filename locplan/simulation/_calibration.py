"""The fit of a field to errors: what was fitted and how well, for people and in files."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from locplan._kernels.arrays import Floats
from locplan._util.checks import file_path
from locplan._util.files import check_target, replacing
from locplan._util.intervals import Interval
from locplan._util.public import Pictured
from locplan._util.reading import parsed_json, read_text
from locplan._util.records import IN_FILES
from locplan._util.results import digest_of
from locplan._util.tables import finite, table
from locplan.errors import LocplanError
from locplan.field import FieldConfig, Sad, save_config
from locplan.robots import Robot
from locplan.simulation._places import ErrorKind


@dataclass(frozen=True, eq=False, repr=False)
class Calibration(Pictured):
    """Noise level (and tau) of a field that fit the errors best, and the quality of the fit.

    The quality is measured at the places to which they were fitted.
    """

    _drawn_by: ClassVar[str] = "locplan.simulation:calibration_figure"

    config: FieldConfig
    """Settings of the field, with the fitted `noise_level`, and with `tau` where it was fitted."""
    noise_level: Interval
    """Noise level k with the 95 % interval of a bootstrap over the places, at this tau."""
    fitted_tau: bool
    """True if tau was fitted, too."""
    factor: float
    """Factor, at least 1, by which a place's rms error typically differs from Sigma's: exp of the
    rms difference of their logarithms."""
    factor_before: float
    """Factor by which the errors differed from Sigma's before the calibration."""
    within_two: float
    """Share of the places whose rms error is within a factor 2 of Sigma's, 0..1."""
    r_squared: float
    """Share of the variance of the errors' logarithm that Sigma explains; below 0 it is worse than
    one value for all places."""
    spearman: float
    """Spearman's rank correlation of Sigma's deviation with the error, -1..1."""
    consistency: float
    """Mean of e' inv(Sigma) e / 2 over all position errors e; 1 where Sigma is neither too small
    nor too large."""
    floor_share: float
    """Share of the places whose errors are below Q alone, which no k can reach, 0..1."""
    predicted: Floats
    """Rms position deviation of each place by the calibrated Sigma, (n,) [m]."""
    measured: Floats
    """Rms position error that was measured at each place, (n,) [m]."""
    maps: Sequence[str]
    """Names of the maps of the places."""
    error: ErrorKind
    """Kind of error that was fitted: "tracking" of a filter, or "match" of single scans."""

    def __repr__(self) -> str:
        return (
            f"Calibration({self.config.estimator.name}, k {self.noise_level.value:.3g}, R²"
            f" {self.r_squared:.2f}, {len(self.measured)} places)"
        )

    @property
    def tau(self) -> float | None:
        """Fitted scale of the exponential weights [m^2]; None where it was not fitted."""
        estimator = self.config.estimator
        return estimator.tau if self.fitted_tau and isinstance(estimator, Sad) else None

    @property
    def in_metres(self) -> bool:
        """True if Sigma explains the errors better than one value for all places would.

        If it does not, the field ranks places at best, and its deviations are no metres.
        """
        return self.r_squared > 0

    @property
    def verdict(self) -> dict[str, object]:
        """Whether deviations are in metres, and if not the reason, fit for JSON."""
        why = "Σ follows these errors less than one value for all places would"
        return {"in_metres": True} if self.in_metres else {"in_metres": False, "why": why}

    @property
    def warning(self) -> str:
        """What people are warned of where deviations are not in metres; else empty."""
        return "" if self.in_metres else f"NOT IN METRES: {self.verdict['why']}"

    def report(self) -> str:
        """Table of what was fitted, and of how well it fits."""
        rows = [
            ["maps", ", ".join(self.maps)],
            ["places", str(len(self.measured))],
            ["error", f"{self.error}, RMSE of the position"],
            ["noise level k", "{:.3g} [{:.3g}, {:.3g}]".format(*self.noise_level)],
        ]
        if self.fitted_tau:
            rows.append(["tau", f"{self.tau:.3g} m²"])
        rows += [
            [
                "typically off by a factor",
                f"{self.factor:.2f}; as it was {self.factor_before:.2f}",
            ],
            ["within a factor 2", f"{self.within_two:.0%} of the places"],
            [
                "variance of ln error explained",
                f"{self.r_squared:.0%}" if self.in_metres else "none",
            ],
            ["rank correlation", f"{self.spearman:.2f}"],
            ["consistency, 1 if Σ fits", f"{self.consistency:.2f}"],
            ["errors below the steps' own, Q", f"{self.floor_share:.0%} of the places"],
        ]
        verdict = (
            "Σ follows the errors, within the factor above" if self.in_metres else self.warning
        )
        return f"{table([], rows)}\n{verdict}"

    def save(
        self, path: str | os.PathLike[str], robot: Robot, *, force: bool = False
    ) -> list[Path]:
        """Write the settings as `locplan.save_config` does, and a picture beside them.

        The file says whether deviations are in metres, so that `locplan.load_config` can warn, and
        holds the robot that was simulated, for `Robot.load`.

        Parameters
        ----------
        path : path
            The file, which ends in .json.
        robot : Robot
            The robot that was simulated.
        force : bool, default False
            True replaces files that are no calibration.

        Returns
        -------
        list of Path
            The file and its picture.

        Raises
        ------
        LocplanError
            If a file cannot be written, or is in the way.
        """
        about = {**self.verdict, "robot": robot.summary(), "calibration": self.summary()}
        target = file_path("a calibration's file", path)
        return write_calibration(target, self.config, self.figure(), about, force=force)

    def summary(self) -> dict[str, object]:
        """Results in numbers, fit for JSON."""
        numbers = ("factor", "factor_before", "within_two", "r_squared", "spearman")
        about: dict[str, object] = {
            **self.verdict,
            "error": self.error,
            "maps": list(self.maps),
            "places": len(self.measured),
            "noise_level": list(self.noise_level),
            "tau": self.tau,
            **{name: getattr(self, name) for name in (*numbers, "consistency", "floor_share")},
        }
        return finite(about)


def write_calibration(
    target: Path, config: FieldConfig, figure: Any, about: Mapping[str, Any], *, force: bool
) -> list[Path]:
    """Write calibrated settings of a field, and a picture of their fit beside them.

    Parameters
    ----------
    target : Path
        The file, which ends in .json.
    config : FieldConfig
        The settings.
    figure : Figure or None
        The picture; None without one.
    about : mapping by name
        What else the file says.
    force : bool
        True replaces files that are no calibration.

    Returns
    -------
    list of Path
        The file and its picture.

    Raises
    ------
    LocplanError
        If a file cannot be written, or is in the way.
    """
    picture = check_calibration(target, force=force)
    if figure is None:
        save_config(target, config, **about)
        return [target]
    # The settings name the picture's digest; where they cannot be written, neither is the picture.
    with replacing(picture) as drawn:
        figure.savefig(drawn, **IN_FILES)
        save_config(target, config, **about, picture=digest_of(drawn))
    return [target, picture]


def check_calibration(path: Path, *, force: bool = False) -> Path:
    """The picture beside a calibration, if both can be written; to be called before long work.

    Parameters
    ----------
    path : Path
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
    check_target(path, ".json")
    picture = path.with_name(f"{path.stem}_calibration.png")
    check_target(picture, ".png")
    if force:
        return picture
    written = None
    if path.exists():
        with suppress(LocplanError, ValueError):
            content = parsed_json(read_text(path))
            if isinstance(content, dict) and {"config", "calibration"} <= content.keys():
                written = str(content.get("picture"))
    if path.exists() and not written:
        raise LocplanError(
            f"{path}: is there, and no calibration; name another file, or replace it with --force"
        )
    if picture.exists() and digest_of(picture) != written:
        raise LocplanError(
            f"{picture}: is in the way of the picture; move it, rename {path}, or replace it with"
            " --force"
        )
    return picture
