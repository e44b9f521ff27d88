"""The cells that paths cross, with the lengths in them, for the headings of a field."""

from __future__ import annotations

import numpy as np

from locplan._kernels.arrays import Array, Floats, Ints
from locplan.costs._any_path import poses_of_paths
from locplan.costs._path import Path
from locplan.errors import LocplanError
from locplan.maps import OccupancyGrid

MAX_CELLS = 10**7
"""Maximum number of cells that a path may cross."""


def crossed_cells(grid: OccupancyGrid, path: Path, headings: int = 1) -> list[Array]:
    """Headings, rows and columns of the cells that a path crosses, and lengths in them [m].

    Parameters
    ----------
    grid : OccupancyGrid
        The map; cells may lie outside it.
    path : Path
        The path in the world [m].
    headings : int, default 1
        Number of headings, evenly spaced from 0 on; over 1e7 cells are a LocplanError.
    """
    poses, sizes, _ = poses_of_paths(path)
    return crossed_by_paths(grid, poses, sizes, headings)[:4]


def crossed_by_paths(grid: OccupancyGrid, poses: Floats, sizes: Ints, headings: int) -> list[Array]:
    """Cells that several paths cross: headings, rows, columns, lengths [m], and paths' numbers.

    Cells are in order of travel. A path, or a part of it in one heading, that has no length has
    one cell with length 0.

    Parameters
    ----------
    grid : OccupancyGrid
        The map; cells may lie outside it.
    poses : (k, 3) array
        Poses of all paths, one path after the other [m, m, rad].
    sizes : (m,) array
        Number of poses of each path, at least 1.
    headings : int
        Number of headings, evenly spaced from 0 on; the poses' headings do not count if it is 1.
    """
    from locplan._kernels.rays import cells_of_lines

    number = np.repeat(np.arange(len(sizes)), sizes)
    is_alone = np.repeat(sizes == 1, sizes)  # such a path is a line without length
    first = np.flatnonzero(is_alone | np.append(number[1:] == number[:-1], False))
    last = np.where(is_alone[first], first, first + 1)
    number, heading = number[first], np.zeros(len(first), np.int64)
    begin, end = poses[first, :2], poses[last, :2]
    if headings > 1:
        lines, begin, end, heading = _split_by_heading(poses[first], poses[last], number, headings)
        number = number[lines]
    begin, end = (np.column_stack(grid.world_to_grid(*xy.T)) for xy in (begin, end))
    if np.bincount(number, np.abs(end - begin).sum(axis=1)).max() > MAX_CELLS:
        raise LocplanError(
            f"the path crosses over {MAX_CELLS} cells of {grid.resolution:g} m; give a path in"
            " metres on this map"
        )
    row, col, length, line = cells_of_lines(begin, end)
    is_new = (np.diff(number, prepend=-1) != 0) | (np.diff(heading, prepend=-1) != 0)
    part = np.cumsum(is_new) - 1
    empty = np.flatnonzero(is_new)[np.bincount(part[line], minlength=part[-1] + 1) == 0]
    if empty.size:
        at = np.floor(begin[empty]).astype(np.int64)
        line = np.concatenate([line, empty])
        order = np.argsort(line, kind="stable")
        row, col = np.concatenate([row, at[:, 0]])[order], np.concatenate([col, at[:, 1]])[order]
        length, line = np.concatenate([length, np.zeros(len(empty))])[order], line[order]
    return [heading[line], row, col, length * grid.resolution, number[line]]


def _split_by_heading(
    begin: Floats, end: Floats, number: Ints, headings: int
) -> tuple[Ints, Floats, Floats, Ints]:
    """Split paths' lines between poses (n, 3) where the nearest of several even headings changes.

    Along each line the heading turns evenly, the shorter way. Returned are the number of the line
    that a part belongs to, the begin and the end of the part, (m, 2), and its nearest heading.
    """
    # The full turns to add so that headings go on without jumps along each path.
    turns = -np.round((end[:, 2] - begin[:, 2]) / (2 * np.pi))
    total = np.concatenate([[0.0], np.cumsum(turns)])
    first = np.flatnonzero(np.diff(number, prepend=-1) != 0)[number]
    before = begin[:, 2] + 2 * np.pi * (total[:-1] - total[first])
    after = end[:, 2] + 2 * np.pi * (total[1:] - total[first])
    # In steps between headings, shifted so that the nearest heading changes at whole numbers.
    before, after = (each / (2 * np.pi) * headings + 0.5 for each in (before, after))
    changes = np.floor(after) - np.floor(before)
    counts = np.abs(changes).astype(np.int64) + 1
    lines = np.repeat(np.arange(len(begin)), counts)
    steps = np.arange(len(lines)) - np.repeat(np.cumsum(counts) - counts, counts)
    way = np.sign(changes)[lines]
    heading = np.floor(before)[lines] + way * steps
    # A further part begins where the heading crosses the border to its nearest heading.
    starts, is_further = begin[lines, :2], steps > 0
    crossed = lines[is_further]
    border = np.where(way > 0, heading, heading + 1)[is_further]
    share = (border - before[crossed]) / (after - before)[crossed]
    starts[is_further] += share[:, None] * (end - begin)[crossed, :2]
    is_last = np.append(lines[1:] != lines[:-1], True)
    ends = np.where(is_last[:, None], end[lines, :2], np.roll(starts, -1, axis=0))
    return lines, starts, ends, heading.astype(np.int64) % headings
