"""The features of a map: objects that stand free, and pieces of the walls."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

SHARP = 0.3
"""Least cornerness of a corner, as a share of that of a right angle."""
OBJECT, CORNER, WALL = "object", "corner", "wall"
"""Kinds of features: what stands free; walls at corners, ends and door frames; other walls."""


class Pieces(NamedTuple):
    """The features that a map is divided into."""

    labels: NDArray[np.int32]
    """Number of the feature that a cell belongs to, or -1, (H, W)."""
    kinds: tuple[str, ...]
    """Kind of each feature: object, corner or wall."""


def pieces_of(
    occupied: NDArray[np.bool_],
    met: NDArray[np.int64],
    resolution: float,
    piece: float,
    largest: float,
    gap: float,
) -> Pieces:
    """Divide what a robot sees into features.

    Occupied cells that are joined (also by their corners) are one object, up to a greatest
    extent, with those that are a small gap away: outlines on maps are often broken. Larger ones
    are walls: a piece of them is what is nearest to its middle. The middles are the corners, the
    sharpest first, and between them the wall is divided evenly.

    Parameters
    ----------
    occupied : (H, W) array of bool
        The occupied cells.
    met : (k,) array of int
        Cells that rays meet, row * W + col; what has none is no feature.
    resolution : float
        Edge of a cell [m].
    piece : float
        Length of a piece [m].
    largest : float
        Greatest extent of an object [m].
    gap : float
        Greatest gap between the parts of one object [m].
    """
    parts, boxes, small = _components(occupied, resolution, largest, gap)
    width = occupied.shape[1]
    rows, cols = np.divmod(np.unique(met), width)
    of_met = parts[rows, cols]
    seen = np.unique(of_met)
    objects = seen[small[seen]]
    numbers = np.full(len(boxes), -1, np.int32)
    numbers[objects] = np.arange(len(objects))
    labels = numbers[parts]
    kinds = [OBJECT] * len(objects)
    for part in seen[~small[seen]].tolist():
        own = of_met == part
        at = np.column_stack([rows[own], cols[own]])
        left, top, right, bottom = boxes[part].tolist()
        window = slice(top, bottom + 1), slice(left, right + 1)
        corner = np.array([top, left])
        inside = parts[window] == part
        sharp = _cornerness(inside, piece, resolution)[tuple((at - corner).T)]
        middles, number = _middles(at, sharp, piece / resolution)
        own_labels = _nearest(np.argwhere(inside), middles - corner, piece / resolution)
        labels[window][inside] = np.where(own_labels < 0, -1, own_labels + len(kinds))
        kinds += [CORNER] * number + [WALL] * (len(middles) - number)
    return Pieces(np.ascontiguousarray(labels, np.int32), tuple(kinds))


def _components(
    occupied: NDArray[np.bool_], resolution: float, largest: float, gap: float
) -> tuple[NDArray[np.int32], NDArray[np.int64], NDArray[np.bool_]]:
    """Number of what each cell is joined with (H, W), boxes, and which are objects.

    A box is the first and last column and row of the cells that are joined without a gap
    (left, top, right, bottom), (k, 4).
    """
    import cv2

    _, parts, about, _ = cv2.connectedComponentsWithStats(occupied.astype(np.uint8), connectivity=8)
    corner = about[:, [cv2.CC_STAT_LEFT, cv2.CC_STAT_TOP]]
    sides = about[:, [cv2.CC_STAT_WIDTH, cv2.CC_STAT_HEIGHT]]
    boxes = np.concatenate([corner, corner + sides - 1], axis=1).astype(np.int64)

    def fit(boxes: NDArray[np.int64]) -> NDArray[np.bool_]:
        sides = boxes[:, 2:] - boxes[:, :2] + 1
        return np.asarray(np.hypot(*sides.T) * resolution <= largest)

    small = fit(boxes)
    wider = int(gap / (2 * resolution) + 1e-9)
    mask = small[parts] & occupied
    if not wider or not mask.any():
        return parts, boxes, small
    size = 2 * wider + 1
    grown = cv2.dilate(mask.astype(np.uint8), np.ones((size, size), np.uint8))
    count, groups = cv2.connectedComponents(grown, connectivity=8)
    group = np.zeros(len(boxes), np.int64)
    group[parts[mask]] = groups[mask]
    signs = np.array([1, 1, -1, -1])  # so that least values are the farthest on all sides
    ends = np.full((count, 4), np.iinfo(np.int64).max)
    own = boxes * signs
    np.minimum.at(ends, group[small], own[small])
    together = small & fit(ends * signs)[group]
    first = np.full(count, len(boxes))
    numbers = np.arange(len(boxes))
    np.minimum.at(first, group[together], numbers[together])
    numbers[together] = first[group[together]]
    return numbers[parts].astype(np.int32), boxes, small


def _cornerness(solid: NDArray[np.bool_], piece: float, resolution: float) -> NDArray[np.float64]:
    """How far the outline turns about each cell, 1 for a right angle, (h, w)."""
    import cv2

    # Greatest distance of what cornerness looks at [cells].
    size = 2 * min(max(1, round(piece / 4 / resolution)), 200) + 1
    edge: Any = {"borderType": cv2.BORDER_CONSTANT}

    def response(cells: NDArray[np.bool_]) -> NDArray[np.float64]:
        padded = np.pad(cells.astype(np.float32), size)  # nothing beyond is occupied
        soft = cv2.GaussianBlur(padded, (0, 0), 1.0, **edge)
        found = cv2.cornerMinEigenVal(soft, size, ksize=3)
        return np.asarray(found[size:-size, size:-size], np.float64)

    ideal = np.ones((2 * size, 2 * size), bool)
    return np.asarray(response(solid) / response(ideal)[0, 0])


def _middles(
    at: NDArray[np.int64], sharp: NDArray[np.float64], piece: float
) -> tuple[NDArray[np.int64], int]:
    """Middles of a wall's pieces (k, 2), the corners first, and the number of corners [cells]."""
    from scipy.spatial import cKDTree

    tree = cKDTree(at)
    order = np.argsort(-sharp.round(6), kind="stable")
    free = sharp >= SHARP
    chosen: list[int] = []
    for n in order[: int(free.sum())].tolist():
        if free[n]:
            chosen.append(n)
            free[tree.query_ball_point(at[n], piece / 2)] = False
    corners = len(chosen)
    apart = np.full(len(at), math.inf)
    for n in chosen:
        apart = np.minimum(apart, np.hypot(*(at - at[n]).T))
    if not chosen:  # begin at an end
        chosen.append(int(np.argmax(np.hypot(*(at - at.mean(axis=0)).T))))
        apart = np.hypot(*(at - at[chosen[0]]).T)
    # Greatest distance of a wall's cell from the middle of its piece, in lengths of a piece.
    while apart.max() > 0.6 * piece:
        n = int(np.argmax(apart))
        chosen.append(n)
        apart = np.minimum(apart, np.hypot(*(at - at[n]).T))
    return at[chosen], corners


def _nearest(
    cells: NDArray[np.int64], middles: NDArray[np.int64], piece: float
) -> NDArray[np.int64]:
    """Number of each cell's nearest middle within a piece, else -1."""
    from scipy.spatial import cKDTree

    apart, nearest = cKDTree(middles).query(cells, distance_upper_bound=max(piece, 1.5))
    found: NDArray[np.int64] = np.where(np.isfinite(apart), nearest, -1)
    return found
