"""The result of a check: what fails, which fixes help, and what to do next."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path as Folder
from typing import TYPE_CHECKING, Any, ClassVar

from locplan._support.output import Results
from locplan._support.records import Column, Result, Table
from locplan._support.saved import to_plain_data
from locplan._support.tables import make_file_name, nan_to_none
from locplan.advice.driving import Site
from locplan.advice.failures import Passage
from locplan.advice.fixes import MEND, WALLS
from locplan.advice.map_reading import MapReading
from locplan.advice.preset_choice import PresetChoice, choice_values
from locplan.advice.rates import DriveRates, FixResult, RouteResult, is_better
from locplan.advice.weak_spots import CLEAR, WeakSpot
from locplan.maps.files import MapSource
from locplan.maps.grid import OccupancyGrid
from locplan.maps.map_faults import MapFaults
from locplan.planning.path import Path
from locplan.simulation.verdict import Verdict

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, eq=False, repr=False)
class Check(Result):
    """Failures of a robot on a map, and the fixes that help; made by `check`."""

    files: ClassVar[Results] = Results(
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
    degenerate: float
    """Share of the free space where a scan fits at many poses, 0..1."""
    spots: tuple[WeakSpot, ...]
    """Weak spots and other places where drives fail, first those where most do, and then those of
    the largest deviation x length x routes that pass."""
    routes: tuple[RouteResult, ...]
    """The routes, first those with the highest rate of the main failure."""
    baseline: DriveRates
    """All drives of the baseline."""
    passage: Passage | None
    """The place where most robots fail that fail with perfect localization, too; None if no
    robots, or few of those that miss the goal, do."""
    fixes: tuple[FixResult, ...]
    """The fixes that were tried, the best first."""
    recommended: tuple[str, ...]
    """Kinds of the fixes to do together; empty if there is nothing to do, or nothing helps."""
    before: DriveRates
    """Fresh drives of the baseline; `baseline` if nothing is recommended."""
    after: DriveRates
    """The same drives with all that is recommended."""
    confirmed: Verdict | None
    """Verdict of these fresh drives; None if nothing is recommended."""
    recorded: tuple[str, ...]
    """What recorded drives show, in sentences without a full stop."""
    findings: tuple[str, ...]
    """Those of `recorded` that report how the map fits, and what is wrong with a drive."""
    preset_choice: PresetChoice | None
    """The choice among the presets of AMCL's settings; None if none was tried."""
    site: Site
    """The site of the baseline."""
    fixed_site: Site
    """The site with all that is recommended."""
    source: MapSource | None
    """How the map was read; None where it was no file."""
    reading: MapReading
    """How the map's file should be read."""
    artifacts: Mapping[str, Any]
    """What the files of recommended fixes are made of, by kind: landmarks, or a mask's costmap."""
    assumed: bool
    """Whether the lidar was assumed, since none was named."""
    effort: str
    """"quick", "usual" or "thorough"."""
    seed: int
    """Seed of all random numbers."""

    def __repr__(self) -> str:
        doing = ", ".join(self.recommended) or "nothing to recommend"
        return f"Check({self.grid.name or 'map'}: {self.baseline.lost.value:.0%} lost, {doing})"

    @property
    def is_fine(self) -> bool:
        """True if drives fail so rarely that there is nothing to do."""
        keeps_place = self.baseline.keeps_place
        return keeps_place and not self.recommended and not self.passage

    @property
    def recommended_fixes(self) -> tuple[FixResult, ...]:
        """The fixes that are recommended."""
        return tuple(fix for kind in self.recommended for fix in self.fixes if fix.kind == kind)

    def table(self) -> Table:
        """The fixes, a row each."""
        share = partial(Column, digits=0, people="%", interval=True)
        columns = (
            Column("title", title="fix"),
            share("lost", title="lost", value=lambda fix: fix.rates.lost),
            share("off_at_end", title="off at the end", value=lambda fix: fix.rates.off_at_end),
            share("reached", title="reaches the goal", value=lambda fix: fix.rates.reached),
            Column("ratio", "", "error", interval=True),
            Column("longer", "m", "longer", 1, signed=True),
            Column("effort", title="takes"),
            Column("verdict", title="verdict"),
            Column("kind"),
            Column("detail"),
            share("gain"),
            Column("n_drives", value=lambda fix: fix.rates.n_drives),
            Column("n_closed", value=lambda fix: fix.rates.n_closed),
        )
        return Table.from_records(columns, self.fixes)

    def summary(self, *related: Any, **details: Any) -> dict[str, object]:
        """Everything in numbers, fit for JSON.

        Parameters
        ----------
        *related, **details
            What `save` takes, of which it says nothing.
        """
        from locplan.advice.next_step import next_action
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
                "robot": self.site.robot.summary(),
                "effort": self.effort,
                "seed": self.seed,
                "degenerate": self.degenerate,
                "weak_spots": spots,
                "routes": routes,
                "baseline": to_plain_data(self.baseline),
                "passage": self.passage and self.passage._asdict(),
                "fixes": self.table().records(),
                "recommended": list(self.recommended),
                "before": to_plain_data(self.before),
                "after": to_plain_data(self.after),
                "confirmed": self.confirmed and to_plain_data(self.confirmed),
                "recorded": list(self.recorded),
                "settings": self.preset_choice and choice_values(self.preset_choice),
                "next": next_action(self, *related)._asdict(),
            }
        )

    def list_written_files(
        self, params: Folder | str | Sequence[Folder] | None = ()
    ) -> dict[str, str]:
        """The files of the recommended fixes, and what to do with each.

        Parameters
        ----------
        params : path or sequence of path, default ()
            The user's parameters of Nav2, of which a copy is changed.
        """
        from locplan.advice.files import describe_fix_files

        return dict(describe_fix_files(self, params))

    @property
    def changed_paths(self) -> Mapping[str, Path]:
        """The paths that are other ones than the shortest, by the file's name."""
        old = self.site.paths
        new = {name: path for name, path in self.fixed_site.paths.items() if path is not old[name]}
        return {f"{make_file_name(name)}.csv": path for name, path in new.items()}

    def save(self, folder: str | os.PathLike[str], *related: Any, force: bool = False) -> None:
        """Write the report, and the files of the fixes, whole or not at all.

        Parameters
        ----------
        folder : path
            Folder of the results, which need not exist.
        *related
            The folder that the commands name, by default this one, and the user's parameters of
            Nav2, of which a copy is changed.
        force : bool, default False
            True overwrites files of the same names and removes other results; other files stay.
        """
        super().save(folder, *(related or (Folder(folder),)), force=force)

    def _write(self, folder: Folder, *related: Any) -> None:
        from locplan.advice.files import write_files
        from locplan.advice.report import write_report

        self.table().write_csv(folder / "check.csv")
        write_files(folder, self, (*related, ())[1])
        write_report(folder / "report.html", self, *related)

    def figure(self, *_: Any) -> Figure:
        """Draw the map with its routes, weak spots, and where drives fail.

        Parameters
        ----------
        *_
            What `save` takes, of which nothing is drawn.
        """
        from locplan.advice.figures import check_figure

        return check_figure(self)

    def report(self, folder: Folder | None = None, *related: Any) -> str:
        """Return the output of a check, in at most 25 lines.

        Parameters
        ----------
        folder : path, optional
            The folder that its files are in.
        *related
            The user's parameters of Nav2, of which a copy was changed.
        """
        from locplan.advice.text import check_report

        return check_report(self, folder, *related)


def explain_spots(
    spots: Sequence[WeakSpot], faults: MapFaults, fixes: Sequence[FixResult]
) -> tuple[WeakSpot, ...]:
    """Name the map's fault at places where scans fit, if a fix of the map is better.

    Parameters
    ----------
    spots : sequence of WeakSpot
        The places.
    faults : MapFaults
        Faults of the map.
    fixes : sequence of FixResult
        The fixes as they were driven.
    """
    if not any(is_better(fix) for fix in fixes if fix.kind in (WALLS, MEND)):
        return tuple(spots)
    reason = f"the map is wrong ({', '.join(fault.kind for fault in faults) or 'its walls'})"
    return tuple(replace(s, missing=reason) if s.missing == CLEAR else s for s in spots)
