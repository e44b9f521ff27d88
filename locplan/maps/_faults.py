"""What of a map misleads a planner, a filter or its user: `faults`."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar

import numpy as np

from locplan._kernels.arrays import Bools
from locplan._util.output import Results
from locplan._util.records import Column, Result, Table
from locplan.errors import ConfigError
from locplan.maps._files import as_meant
from locplan.maps._grid import OccupancyGrid, check_grid
from locplan.maps._misleading import (
    MapFault,
    of_cells,
    of_mask,
    of_origin,
    of_painted,
    of_source,
    of_walls,
    specks_of,
)
from locplan.maps._occupancy import FREE
from locplan.maps._solid import hollowed, inside_of_walls, solidity
from locplan.maps._source import MapSource


@dataclass(frozen=True, eq=False, repr=False)
class MapFaults(Result):
    """What of a map misleads; made by `faults`."""

    _reported_by: ClassVar[str] = "locplan.maps._faults:faults_report"
    _drawn_by: ClassVar[str] = "locplan.plotting:faults_figure"
    files: ClassVar[Results] = Results("faults", ("faults.json", "faults.png", "faults.csv"))

    grid: OccupancyGrid
    """The map."""
    found: tuple[MapFault, ...]
    """The faults, the most important first."""
    meant: OccupancyGrid
    """The map as its file is meant, see `as_meant`, which the faults of walls and cells are of."""

    def __repr__(self) -> str:
        kinds = ", ".join(each.kind for each in self) or "none"
        return f"MapFaults({self.grid.name or 'map'}: {kinds})"

    def __iter__(self) -> Iterator[MapFault]:
        return iter(self.found)

    def __len__(self) -> int:
        return len(self.found)

    @property
    def is_solid(self) -> bool:
        """True if walls are black inside so that a filter gets lost, and hollowing mends it."""
        return any(each.kind == "solid walls" for each in self)

    @cached_property
    def cells(self) -> Bools:
        """The cells that walls black inside, painted unknown space and specks concern, (H, W)."""
        where, kinds = np.zeros(self.meant.shape, np.bool_), {each.kind for each in self}
        if kinds & {"solid walls", "thick walls", "painted unknown"}:
            where |= inside_of_walls(self.meant)
        if "specks" in kinds:
            where |= self.specks
        return where

    @cached_property
    def specks(self) -> Bools:
        """The cells of up to 3 that touch each other, and else only free ones, (H, W)."""
        return specks_of(self.meant)

    @property
    def mended(self) -> OccupancyGrid:
        """The map for a filter: as its file is meant, without specks, solid walls hollowed."""
        grid, kinds = self.meant, {each.kind for each in self}
        if "specks" in kinds:
            grid = replace(grid, cells=np.where(self.specks, np.uint8(FREE), grid.cells))
        # Where beams end deep in the walls the truth lies inside, and hollowing may harm.
        return hollowed(grid) if self.is_solid and "deep walls" not in kinds else grid

    def refuse_mask(self) -> None:
        """Raise a ConfigError if what was given for a map is a mask for a costmap filter."""
        for each in self:
            if each.kind == "mask":
                raise ConfigError(f"{self.grid.name or 'the map'}: {each.sentence}")

    def summary(self) -> dict[str, object]:
        """The faults, fit for JSON."""
        return {
            "map": {"name": self.grid.name, "digest": self.grid.digest},
            "faults": [
                {**row, "boxes": [list(box) for box in each.boxes]}
                for row, each in zip(self.table().records(), self, strict=True)
            ],
        }

    def table(self) -> Table:
        """The faults, a row each."""
        titles = {
            "kind": "fault",
            "what": "what",
            "where": "where",
            "costs": "costs",
            "mend": "mend",
        }
        columns = [Column(name, title=title) for name, title in titles.items()]
        return Table.of([*columns, Column("sure")], self)


def faults_report(faults: MapFaults) -> str:
    """A sentence for each fault."""
    if not faults.found:
        return f"{faults.grid.name or 'the map'}: no fault that the map alone shows"
    return "\n".join(f"{each.kind}: {each.sentence}" for each in faults)


def faults(grid: OccupancyGrid, source: MapSource | None = None) -> MapFaults:
    """Find what misleads: solid walls, painted unknown, specks, thresholds, open edges, masks.

    Solid walls are found by simulated scans, in some tenths of a second the first time that a map
    is seen by a process; no drive is needed.

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    source : MapSource, optional
        How its pixels were read, see `read_map`; without it only the cells are looked at.

    Returns
    -------
    MapFaults
        The faults, the most important first; none if all seems well.

    Raises
    ------
    MapError
        If it is no map.

    See Also
    --------
    hollowed : The map without the inside of its walls.

    Examples
    --------
    >>> len(faults(OccupancyGrid([[127, 0, 0, 0], [127, 0, 254, 0], [127, 0, 0, 0]], 0.05)))
    0
    """
    check_grid(grid)
    of_file = (*of_mask(grid, source), *of_source(grid, source)) if source else ()
    # No filter has a mask for its map, whose areas are no walls.
    is_mask = any(each.kind == "mask" for each in of_file)
    meant = grid if is_mask else as_meant(grid, source)
    walls = () if is_mask else (*of_walls(meant, solidity(meant)), *of_painted(meant))
    return MapFaults(grid, (*of_file, *walls, *of_cells(meant), *of_origin(grid)), meant)
