"""Results of tuning: the settings to use, next to the user's, and the drives that chose them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from locplan._util.intervals import in_metres
from locplan._util.output import Results
from locplan._util.records import Result, Table
from locplan._util.tables import finite
from locplan.maps import OccupancyGrid
from locplan.robots import Amcl, Robot
from locplan.simulation._worlds import about_filter
from locplan.simulation.tuning._choose_preset import OWN, CaseResult, PresetChoice, choice_values
from locplan.simulation.tuning._parameters import BeamsLeft, differing_names, write_tuned


@dataclass(frozen=True, eq=False, repr=False)
class Tuning(Result):
    """The best settings of AMCL for a map or a recording: a preset or the user's, with evidence."""

    _reported_by: ClassVar[str] = "locplan.simulation.tuning._report:tuning_report"
    _drawn_by: ClassVar[str] = "locplan.simulation:tuning_figure"
    files: ClassVar[Results] = Results("tuning", ("tuning.json", "tuning.png", "nav2_params.yaml"))

    grids: tuple[OccupancyGrid, ...]
    """The maps."""
    robot: Robot
    """The robot with the user's settings of AMCL."""
    choice: PresetChoice
    """The settings to use, and the drives that chose them."""
    beams_left: BeamsLeft
    """Number of the compared beams that return."""
    warnings: tuple[str, ...]
    """Warnings of the user's settings."""
    paths: int
    """Number of simulated paths on each map."""
    drives: int
    """Number of drives along each of them at the usual level."""
    seed: int
    """Seed of all random numbers."""
    recording: str = ""
    """Names of the recordings; empty for simulated drives."""
    filter_map: OccupancyGrid | None = None
    """The filter's map, if it is not that of `grids`."""
    notes: tuple[str, ...] = ()
    """Limits of the result, in sentences without a full stop."""

    def __repr__(self) -> str:
        return f"Tuning({self.where}, {self.choice.name})"

    @property
    def where(self) -> str:
        """Names of the maps."""
        return ", ".join(grid.name or "map" for grid in self.grids)

    @property
    def winner(self) -> Amcl:
        """The settings to use: those of a preset, or the user's."""
        return self.choice.settings

    @property
    def changes(self) -> dict[str, float | str]:
        """Parameters to change, by their names; empty if no preset is to be used."""
        user_settings, winner = self.robot.amcl, self.winner
        return {name: getattr(winner, name) for name in differing_names(user_settings, winner)}

    @property
    def conclusion(self) -> str:
        """The result in one sentence, without a full stop."""
        choice = self.choice
        if not choice.is_preset:
            reasons = "; ".join(choice.objections.values()) or "they are those of the presets"
            return f"Keep {OWN}: {reasons}"
        if choice.recordings:
            before, after = (
                self._first_result(name, choice.recordings) for name in (OWN, choice.name)
            )
            errors = (
                f"{in_metres(after.error.value)} on {after.case}, {in_metres(before.error.value)}"
            )
            return f"Use {choice.title}: an error of {errors} with {OWN}"
        less = 100 * (1 - choice.verdicts[choice.name].ratio.value)
        return f"Use {choice.title}: {less:.0f} % less error than with {OWN}"

    def _first_result(self, name: str, cases: tuple[str, ...]) -> CaseResult:
        return next(r for r in self.choice.results if r.settings == name and r.case in cases)

    def table(self) -> Table:
        """The drives with each settings, a row per case."""
        return self.choice.table()

    def figure(self, *about: Any, **options: Any) -> Any:
        """The figure of matplotlib that shows it.

        Parameters
        ----------
        *about, **options
            What `save` takes, which the figure does not show.
        """
        return super().figure()

    def _write(self, folder: Path, *about: Any) -> None:
        write_tuned(folder / "nav2_params.yaml", self.winner, *about)

    def summary(self, *about: Any, **more: Any) -> dict[str, object]:
        """Everything in numbers, fit for JSON.

        Parameters
        ----------
        *about, **more
            What `save` takes, which the numbers do not have.
        """
        maps = [{"name": grid.name, "digest": grid.digest} for grid in self.grids]
        return finite(
            {
                "conclusion": self.conclusion,
                **({"maps": maps} if maps[1:] else {"map": maps[0]}),
                "changes": self.changes,
                "choice": choice_values(self.choice),
                "notes": list(self.notes),
                "warnings": list(self.warnings),
                "beams_compared": self.beams_left.compared,
                "beams_returned": self.beams_left.returned,
                **{name: getattr(self, name) for name in ("paths", "drives", "seed")},
                **about_filter(self.filter_map),
                "robot": self.robot.summary(),
                "recording": self.recording or None,
            }
        )
