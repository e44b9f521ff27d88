"""The result of a check: what is wrong, what helps, and what to do."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path as Folder
from typing import Any, ClassVar

from locplan._kernels.arrays import Floats
from locplan._util.intervals import Interval
from locplan._util.public import called
from locplan._util.records import Column, Result, Table
from locplan._util.results import Results
from locplan._util.tables import file_name, finite
from locplan.costs import Path
from locplan.diagnosis._cures import CHEAP, KINDS, MEND, WALLS
from locplan.diagnosis._driving import Site
from locplan.diagnosis._reading import Reading
from locplan.diagnosis._weak_spots import CLEAR, WeakSpot
from locplan.maps import MapFaults, MapSource, OccupancyGrid
from locplan.simulation import LOST
from locplan.simulation.verdict import BETTER

SELDOM = 0.01
"""Share of lost drives that nothing is done about, as long as it is not surely larger."""
MISSED = 0.03
"""The same of drives that do not arrive, which may have other reasons, too."""
LARGE = 0.25
"""Error of a typical drive from which on it is lowered though drives are seldom lost [m]."""
NOTHING = Interval(math.nan, math.nan, math.nan)


def is_seldom(lost: Interval) -> bool:
    """Whether drives are not surely lost more often than there is something to do about."""
    return lost.low <= SELDOM


@dataclass(frozen=True)
class Rates:
    """How drives went."""

    drives: int
    """Number of drives along exact paths."""
    lost: Interval
    """Share that was off by over 1 m at some time, 0..1."""
    error: Interval
    """Error of a typical drive: the geometric mean of the RMSE of the position [m]."""
    arrives: Interval = NOTHING
    """Share of further drives, steered by the filter's pose, that arrive, 0..1; NaN without."""
    ends: str = ""
    """How most of those end that do not arrive, in words; empty where all arrive."""

    def summary(self) -> dict[str, object]:
        """The figures, fit for JSON."""
        named = {name: list(getattr(self, name)) for name in ("lost", "error", "arrives")}
        return {"drives": self.drives, **named, "ends": self.ends}


def keeps_place(rates: Rates) -> bool:
    """Whether drives are seldom lost, and seldom do not arrive."""
    return is_seldom(rates.lost) and not rates.arrives.high < 1 - MISSED


@dataclass(frozen=True, repr=False)
class Trip:
    """A trip of the robot, and how it went as it is."""

    name: str
    """Its name, of its start and goal."""
    path: Path
    """The shortest path."""
    rates: Rates
    """How the drives went."""
    lost_near: str
    """Letters of the places that lose a quarter of its lost drives or more."""
    lost_at: Floats = field(compare=False)
    """Positions where drives were first off by over 1 m, (n, 2) [m]."""

    def __repr__(self) -> str:
        return f"Trip({self.name}: {self.rates.lost.value:.0%} off by over {LOST:g} m)"


@dataclass(frozen=True)
class Cure:
    """Something that was tried against getting lost."""

    kind: str
    """"walls", "map", "range", "settings", "paths" or "landmarks"."""
    title: str
    """What is done, in words."""
    effort: str
    """What it takes, in words."""
    verdict: str
    """"better", "worse", "no difference" or "undecided"; of a cure that does not lead after a few
    drives, on these."""
    rates: Rates
    """How drives went with it."""
    gain: Interval
    """Share of the same drives that are no longer lost, less those that newly are."""
    ratio: Interval
    """Ratio of the errors with it to those without: geometric mean."""
    longer: float
    """What it makes a trip longer, the mean over the trips [m]."""
    keeps_more: bool = False
    """Whether it is better since it keeps drives from getting lost, and does not lower the error
    alone."""


@dataclass(frozen=True, eq=False, repr=False)
class Check(Result):
    """What is wrong with a map and a robot, and the cure that gains most; made by `check`."""

    _reported_by: ClassVar[str] = "locplan.diagnosis._text:check_report"
    _drawn_by: ClassVar[str] = "locplan.diagnosis:check_figure"
    files: ClassVar[Results] = Results(
        "check",
        (
            *("check.json", "check.png", "check.csv", "report.html", "nav2_params.yaml"),
            *("map_amcl.yaml", "map_amcl.pgm", "servers.yaml", "localizability.launch.xml"),
            *("amcl.yaml", "README.md", "map.yaml", "landmarks.csv"),
        ),
    )

    grid: OccupancyGrid
    """The map."""
    faults: MapFaults
    """Its faults."""
    degenerate: float
    """Share of the free space where a scan fits at many poses, 0..1."""
    spots: tuple[WeakSpot, ...]
    """Weak spots and other places where drives get lost, first those that lose most drives, and
    then those of the largest deviation x length x trips that pass."""
    trips: tuple[Trip, ...]
    """The trips as they are driven now."""
    as_is: Rates
    """All drives as it is."""
    cures: tuple[Cure, ...]
    """The cures that were tried, the best first."""
    recommended: tuple[str, ...]
    """Kinds of the cures to do together; empty if there is nothing to do, or nothing helps."""
    before: Rates
    """Fresh drives as it is, beside `after`; `as_is` where nothing is recommended."""
    after: Rates
    """The same drives with all that is recommended."""
    start: str
    """Where the robot may be put, in a sentence."""
    recorded: tuple[str, ...]
    """What recorded drives say, in sentences without a full stop."""
    site: Site
    """The site as it is."""
    cured: Site
    """The site with all that is recommended."""
    source: MapSource | None
    """How the map was read; None where it was no file."""
    reading: Reading
    """How the map's file should be read."""
    made: Mapping[str, Any]
    """What the files of recommended cures are made of, by kind: landmarks, or a mask's costmap."""
    assumed: bool
    """Whether the lidar was assumed, since none was named."""
    effort: str
    """"quick", "usual" or "thorough"."""
    seed: int
    """Seed of all random numbers."""

    def __repr__(self) -> str:
        doing = ", ".join(self.recommended) or "nothing to recommend"
        return f"Check({self.grid.name or 'map'}: {self.as_is.lost.value:.0%} lost, {doing})"

    @property
    def is_fine(self) -> bool:
        """Whether drives are lost so seldom that there is nothing to do."""
        return keeps_place(self.as_is) and not self.recommended

    @property
    def is_by_error(self) -> bool:
        """Whether what is recommended lowers the error, and not clearly the share of lost drives.

        Intervals that meet do not show it of drives in the same worlds: those of all cures do.
        """
        return not any(each.keeps_more for each in self.advised)

    @property
    def advised(self) -> tuple[Cure, ...]:
        """The cures that are recommended."""
        return tuple(each for kind in self.recommended for each in self.cures if each.kind == kind)

    def table(self) -> Table:
        """The cures, a row each."""
        share = partial(Column, digits=0, people="%", interval=True)
        columns = (
            Column("title", title="cure"),
            share("lost", title=f"off > {LOST:g} m", value=lambda each: each.rates.lost),
            share("arrives", title="arrives", value=lambda each: each.rates.arrives),
            Column("ratio", "", "error", interval=True),
            Column("longer", "m", "longer", 1, signed=True),
            Column("effort", title="takes"),
            Column("verdict", title="verdict"),
            Column("kind"),
            share("gain"),
            Column("drives", value=lambda each: each.rates.drives),
        )
        return Table.of(columns, self.cures)

    def summary(self, *about: Any, **more: Any) -> dict[str, object]:
        """Everything in numbers, fit for JSON.

        Parameters
        ----------
        *about, **more
            What `save` takes, of which it says nothing.
        """
        shapes = ("outline", "holes")
        spots = [
            {name: value for name, value in vars(each).items() if name not in shapes}
            for each in self.spots
        ]
        trips = [
            {"name": each.name, "length": each.path.length, "lost_near": each.lost_near}
            | {"start": each.path.xy[0].tolist(), "goal": each.path.xy[-1].tolist()}
            | {"lost_at": each.lost_at.tolist()}
            | each.rates.summary()
            for each in self.trips
        ]
        return finite(
            {
                **self.faults.summary(),
                "robot": self.site.robot.summary(),
                "effort": self.effort,
                "seed": self.seed,
                "degenerate": self.degenerate,
                "weak_spots": spots,
                "trips": trips,
                "as_is": self.as_is.summary(),
                "cures": self.table().records(),
                "recommended": list(self.recommended),
                "before": self.before.summary(),
                "after": self.after.summary(),
                "start": self.start,
                "recorded": list(self.recorded),
                "next": called("locplan.diagnosis._text:next_action", self, *about)._asdict(),
            }
        )

    def written(self, params: Folder | str | Sequence[Folder] | None = ()) -> dict[str, str]:
        """The files of the recommended cures, and what to do with each.

        Parameters
        ----------
        params : path or sequence of path, default ()
            The user's parameters of Nav2, of which a copy is changed.
        """
        return dict(called("locplan.diagnosis._files:files_of", self, params))

    @property
    def changed_paths(self) -> Mapping[str, Path]:
        """The paths that are other ones than the shortest, by the file's name."""
        old = self.site.paths
        new = {name: path for name, path in self.cured.paths.items() if path is not old[name]}
        return {f"{file_name(name)}.csv": path for name, path in new.items()}

    def save(self, folder: str | os.PathLike[str], *about: Any, force: bool = False) -> None:
        """Write the report, and the files of the cures, whole or not at all.

        Parameters
        ----------
        folder : path
            Folder of the results, which need not exist.
        *about
            The folder that the commands name, by default this one, and the user's parameters of
            Nav2, of which a copy is changed.
        force : bool, default False
            True also replaces files of these names that locplan did not write.
        """
        super().save(folder, *(about or (Folder(folder),)), force=force)

    def _write(self, folder: Folder, *about: Any) -> None:
        self.table().write_csv(folder / "check.csv")
        called("locplan.diagnosis._files:write_files", folder, self, (*about, ())[1])
        called("locplan.diagnosis._report:write_report", folder / "report.html", self, *about)


def is_better(cure: Cure) -> bool:
    """Whether a cure is better than what is there."""
    return cure.verdict == BETTER


def helps(cure: Cure, before: Rates) -> bool:
    """Whether a cure is worth being recommended.

    A lower error alone is, of a cheap cure. Where the robot keeps its place nothing is, unless
    the error is large, or walls are not read, which planners drive through, too.

    Parameters
    ----------
    cure : Cure
        The cure.
    before : Rates
        Drives as it is.
    """
    if keeps_place(before) and before.error.value < LARGE and cure.kind != WALLS:
        return False
    return cure.keeps_more or (is_better(cure) and cure.kind in CHEAP)


def misled(
    spots: Sequence[WeakSpot], faults: MapFaults, cures: Sequence[Cure]
) -> tuple[WeakSpot, ...]:
    """The places, where scans are clear with the fault of the map that a better one cures.

    Parameters
    ----------
    spots : sequence of WeakSpot
        The places.
    faults : MapFaults
        Faults of the map.
    cures : sequence of Cure
        The cures as they were driven.
    """
    if not any(is_better(each) for each in cures if each.kind in (WALLS, MEND)):
        return tuple(spots)
    why = f"nothing: the map errs ({', '.join(each.kind for each in faults) or 'its walls'})"
    return tuple(replace(s, missing=why) if s.missing == CLEAR else s for s in spots)


def ranked(cures: Sequence[Cure]) -> list[Cure]:
    """The cures, the best first: of those that keep as many drives as the best, the cheapest.

    Parameters
    ----------
    cures : sequence of Cure
        The cures.
    """
    keeping = [each for each in cures if each.keeps_more]
    least = min((each.rates.lost for each in keeping or filter(is_better, cures)), default=NOTHING)

    def key(cure: Cure) -> tuple[bool, bool, float, float]:
        better = is_better(cure)
        as_good = better and cure.rates.lost.value <= least.high
        others = better and bool(keeping) and cure not in keeping
        order = float(KINDS.index(cure.kind)) if as_good else cure.rates.lost.value
        return not better, others or not as_good, order, cure.ratio.value

    return sorted(cures, key=key)
