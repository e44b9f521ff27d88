"""The result of a check: what fails, which fixes help, and what to do next."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path as Folder
from typing import TYPE_CHECKING, Any, ClassVar

from locplan._support.output import ResultFiles
from locplan._support.records import Result, Table, TableColumn
from locplan._support.saved import to_plain_data
from locplan._support.tables import make_file_name, nan_to_none
from locplan.advice.driving import Scenario
from locplan.advice.failures import FailurePassage
from locplan.advice.fixes import CORRECTED_MAP, REPAIRED_MAP
from locplan.advice.map_reading import MapCorrection
from locplan.advice.preset_choice import PresetChoice, summarize_choice
from locplan.advice.rates import DriveRates, FixResult, RouteResult, is_better
from locplan.advice.weak_spots import SCANS_FIT, WeakSpot
from locplan.maps.files import MapSource
from locplan.maps.grid import OccupancyGrid
from locplan.maps.map_faults import MapFaults
from locplan.planning.path import Path
from locplan.simulation.verdict import Verdict

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, eq=False, repr=False)
class Check(Result):
    """Result of `check`: failures of a robot on a map, and the fixes that help."""

    files: ClassVar[ResultFiles] = ResultFiles(
        "check",
        (
            *("check.json", "check.png", "check.csv", "report.html", "nav2_params.yaml"),
            *("map_amcl.yaml", "map_amcl.pgm", "servers.yaml", "localizability.launch.xml"),
            *("amcl.yaml", "README.md", "map.yaml", "landmarks.csv"),
        ),
        purposes={
            "report.html": "the report, for your browser",
            "README.md": "how to use the repaired map in Nav2",
            "nav2_params.yaml": "Nav2's parameters with the recommended settings",
            "landmarks.csv": "where each pole goes",
            "map.yaml": "the corrected map",
            "map_amcl.yaml": "the repaired map, for AMCL alone",
            "mask/README.md": "how to use the mask in Nav2",
            "check.csv": "the fixes with their rates",
        },
    )

    grid: OccupancyGrid
    """The map."""
    faults: MapFaults
    """Its faults."""
    degenerate_share: float
    """Share of the free space that is degenerate (u of at least 0.5), 0..1."""
    spots: tuple[WeakSpot, ...]
    """Weak spots and other places where drives fail, first those where most do, and then those of
    the largest deviation x length x routes that pass."""
    routes: tuple[RouteResult, ...]
    """The routes, first those with the highest rate of the main failure."""
    baseline: DriveRates
    """All drives of the baseline."""
    passage: FailurePassage | None
    """The place where most drives fail even with perfect localization; None if few or no failures
    are of that kind."""
    fixes: tuple[FixResult, ...]
    """The fixes that were tried, the best first."""
    recommended: tuple[str, ...]
    """Kinds of the recommended fixes; empty if there is nothing to do, or no fix helps."""
    before: DriveRates
    """Fresh drives of the baseline; `baseline` if nothing is recommended."""
    after: DriveRates
    """The same drives with all recommended fixes."""
    confirmation: Verdict | None
    """Verdict of these fresh drives; None if nothing is recommended."""
    recording_sentences: tuple[str, ...]
    """Sentences about recorded drives, without a full stop."""
    recording_findings: tuple[str, ...]
    """The sentences of `recording_sentences` on the fit of the map and on faults of a drive."""
    preset_choice: PresetChoice | None
    """The choice among the AMCL presets; None if no preset was tried."""
    scenario: Scenario
    """The scenario of the baseline."""
    fixed_scenario: Scenario
    """The scenario with all recommended fixes."""
    source: MapSource | None
    """How the map was read; None if it was not a file."""
    correction: MapCorrection
    """Corrections of the map's file."""
    artifacts: Mapping[str, Any]
    """Data for the files of recommended fixes, by kind: placed poles, or a mask's costmap."""
    is_lidar_assumed: bool
    """True if no lidar was named, so that the default was used."""
    effort: str
    """"quick", "usual" or "thorough"."""
    seed: int
    """Seed of all random numbers."""

    def __repr__(self) -> str:
        doing = ", ".join(self.recommended) or "nothing to recommend"
        return f"Check({self.grid.name or 'map'}: {self.baseline.lost.value:.0%} lost, {doing})"

    @property
    def is_fine(self) -> bool:
        """True if drives fail so rarely that no fix is needed."""
        keeps_place = self.baseline.is_reliable
        return keeps_place and not self.recommended and not self.passage

    @property
    def recommended_fixes(self) -> tuple[FixResult, ...]:
        """The fixes that are recommended."""
        return tuple(fix for kind in self.recommended for fix in self.fixes if fix.kind == kind)

    def table(self) -> Table:
        """Return the table of the fixes, a row each."""
        share = partial(TableColumn, digits=0, people="%", interval=True)
        columns = (
            TableColumn("title", title="fix"),
            share("lost", title="lost", value=lambda fix: fix.rates.lost),
            share("off_at_end", title="off at the end", value=lambda fix: fix.rates.off_at_end),
            share("reached", title="reaches the goal", value=lambda fix: fix.rates.reached),
            TableColumn("ratio", "", "error", interval=True),
            TableColumn("longer", "m", "longer", 1, signed=True),
            TableColumn("effort", title="takes"),
            TableColumn("verdict", title="verdict"),
            TableColumn("kind"),
            TableColumn("detail"),
            share("gain"),
            TableColumn("n_drives", value=lambda fix: fix.rates.n_drives),
            TableColumn("n_closed", value=lambda fix: fix.rates.n_closed),
        )
        return Table.from_records(columns, self.fixes)

    def summary(self, *related_results: Any, **details: Any) -> dict[str, object]:
        """Return the result as plain data for JSON.

        Parameters
        ----------
        *related_results, **details
            Arguments of `save`; ignored.
        """
        from locplan.advice.next_step import choose_next_action
        from locplan.advice.text import problem_text

        shapes = ("outline", "holes")
        spots = [
            {name: value for name, value in vars(spot).items() if name not in shapes}
            for spot in self.spots
        ]
        routes = [
            {
                "name": route.name,
                "length": route.path.length,
                "start": route.path.xy[0].tolist(),
                "goal": route.path.xy[-1].tolist(),
                "problem": problem_text(route),
                "lost_at": route.lost_at.tolist(),
                "stopped_at": route.stopped_at.tolist(),
                **to_plain_data(route.rates),
            }
            for route in self.routes
        ]
        return nan_to_none(
            {
                **self.faults.summary(),
                "robot": self.scenario.robot.summary(),
                "effort": self.effort,
                "seed": self.seed,
                "degenerate": self.degenerate_share,
                "weak_spots": spots,
                "routes": routes,
                "baseline": to_plain_data(self.baseline),
                "passage": self.passage and self.passage._asdict(),
                "fixes": self.table().records(),
                "recommended": list(self.recommended),
                "before": to_plain_data(self.before),
                "after": to_plain_data(self.after),
                "confirmed": self.confirmation and to_plain_data(self.confirmation),
                "recorded": list(self.recording_sentences),
                "settings": self.preset_choice and summarize_choice(self.preset_choice),
                "next": choose_next_action(self, *related_results)._asdict(),
            }
        )

    def describe_fix_files(
        self, params: Folder | str | Sequence[Folder] | None = ()
    ) -> dict[str, str]:
        """Return the purpose of each file of the recommended fixes.

        Parameters
        ----------
        params : path or sequence of path, default ()
            The user's Nav2 parameters; the check changes a copy.
        """
        from locplan.advice.files import describe_fix_files

        return dict(describe_fix_files(self, params))

    @property
    def changed_paths(self) -> Mapping[str, Path]:
        """The recommended paths that differ from the shortest, by file name."""
        old = self.scenario.paths
        new = {
            name: path for name, path in self.fixed_scenario.paths.items() if path is not old[name]
        }
        return {f"{make_file_name(name)}.csv": path for name, path in new.items()}

    def save(
        self, folder: str | os.PathLike[str], *related_results: Any, force: bool = False
    ) -> None:
        """Write the report, and the files of the fixes, whole or not at all.

        Parameters
        ----------
        folder : path
            Folder of the results, which need not exist.
        *related_results
            The folder that the printed commands name, by default this one, and the user's Nav2
            parameters; the check changes a copy.
        force : bool, default False
            True overwrites files of the same names and removes results of another command. It
            keeps the user's files.
        """
        super().save(folder, *(related_results or (Folder(folder),)), force=force)

    def _write(self, folder: Folder, *related_results: Any) -> None:
        from locplan.advice.files import write_fix_files
        from locplan.advice.report import write_report

        self.table().write_csv(folder / "check.csv")
        write_fix_files(folder, self, (*related_results, ())[1])
        write_report(folder / "report.html", self, *related_results)

    def figure(self, *_: Any) -> Figure:
        """Draw the map with its routes, weak spots, and where drives fail.

        Parameters
        ----------
        *_
            Arguments of `save`; ignored.
        """
        from locplan.advice.figures import check_figure

        return check_figure(self)

    def report(self, folder: Folder | None = None, *related_results: Any) -> str:
        """Return the output of a check, in at most 25 lines.

        Parameters
        ----------
        folder : path, optional
            The folder that its files are in.
        *related_results
            The user's Nav2 parameters; the check changes a copy.
        """
        from locplan.advice.text import check_report

        return check_report(self, folder, *related_results)


def explain_spots(
    spots: Sequence[WeakSpot], faults: MapFaults, fixes: Sequence[FixResult]
) -> tuple[WeakSpot, ...]:
    """Return the spots, with the map's fault as their reason if scans fit and a map fix is better.

    Parameters
    ----------
    spots : sequence of WeakSpot
        The places.
    faults : MapFaults
        Faults of the map.
    fixes : sequence of FixResult
        The fixes that were tried.
    """
    if not any(is_better(fix) for fix in fixes if fix.kind in (CORRECTED_MAP, REPAIRED_MAP)):
        return tuple(spots)
    reason = f"the map is wrong ({', '.join(fault.kind for fault in faults) or 'its walls'})"
    return tuple(replace(s, missing=reason) if s.missing == SCANS_FIT else s for s in spots)
