"""Readers that follow the source formulas of ROS navigation stacks, for tests of exported maps.

Read from navigation2 humble, jazzy, kilted, lyrical, main (2026-08) and ROS 1 noetic-devel, not run
under ROS.  Arrays are (H, W), row 0 at the lowest y; cells are (row, column); lengths in cells.
"""

from __future__ import annotations

import heapq
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray
from PIL import Image
from scipy.ndimage import distance_transform_edt
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

NO_INFORMATION, LETHAL, INSCRIBED, MAX_NON_OBSTACLE = 255, 254, 253, 252

U8 = NDArray[np.uint8]
I8 = NDArray[np.int8]
F64 = NDArray[np.float64]
Bool = NDArray[np.bool_]
Cell = tuple[int, int]


@dataclass(frozen=True)
class Grid:
    """A published map: -1 (unknown) or 0..100, and MapMetaData's float32 resolution."""

    data: I8
    resolution: float
    origin: tuple[float, float, float]


def load(yaml_path: str | Path, stack: str) -> Grid:
    """Read a map as map_server does.  "main": map_io.cpp of main, lyrical, kilted, jazzy >= 1.3.7;
    "humble": of humble, iron, jazzy <= 1.3.6; "ros1": main.cpp and image_loader.cpp, noetic-devel.
    """
    reader = {"main": _read_main, "humble": _read_humble, "ros1": _read_ros1}[stack]
    path = Path(yaml_path)
    doc: dict[str, Any] = yaml.safe_load(path.read_text())
    free, high = float(doc["free_thresh"]), float(doc["occupied_thresh"])
    origin = [float(v) for v in doc["origin"]]
    if not doc["image"] or len(origin) < 3 or (stack != "ros1" and len(origin) > 3):
        raise ValueError("empty image, or origin without exactly 3 elements")
    if stack == "ros1" and isinstance(doc["negate"], bool):
        raise ValueError("ROS 1 reads negate as an integer only")
    mode = str(doc.get("mode", "trinary"))
    mode = mode if stack == "ros1" else mode.lower()
    if mode not in ("trinary", "scale", "raw"):
        raise ValueError(f"unknown mode {mode!r}")
    with Image.open(path.parent / str(doc["image"])) as image:
        data = reader(image, mode, bool(doc["negate"]), free, high)
    flipped = np.ascontiguousarray(data[::-1])
    return Grid(flipped, float(np.float32(doc["resolution"])), (origin[0], origin[1], origin[2]))


def _split(image: Image.Image) -> tuple[Image.Image, U8 | None]:
    """Return the image as 8-bit L or RGB, and its alpha channel (None without one)."""
    if image.mode not in ("1", "L", "LA", "P", "PA", "RGB", "RGBA"):
        raise ValueError(f"not an 8-bit image: {image.mode}")
    matte = image.mode in ("LA", "PA", "RGBA") or "transparency" in image.info
    alpha = np.asarray(image.convert("RGBA").getchannel("A")) if matte else None
    return image.convert("L" if image.mode in ("1", "L", "LA") else "RGB"), alpha


def _read_main(image: Image.Image, mode: str, negate: bool, free: float, high: float) -> I8:
    """Nav2 main map_io.cpp: float32, closed ends (free wins), ties away from zero.
    Alpha below 255 is unknown in trinary and scale.  Luma of colours: exact for greys only.
    """
    flat, alpha = _split(image)
    grey = np.asarray(flat.convert("L"))
    if mode == "raw":
        return np.where(grey <= 100, grey.astype(np.int16), -1).astype(np.int8)
    lo, hi = np.float32(free), np.float32(high)
    occ = grey.astype(np.float32) / np.float32(255)
    occ = occ if negate else np.float32(1) - occ
    out = np.full(occ.shape, -1, np.int8)
    out[occ >= hi] = 100
    out[occ <= lo] = 0
    if mode == "scale":
        between = (occ > lo) & (occ < hi)
        scaled = (occ[between] - lo) / np.float32(high - free) * np.float32(100)
        whole = np.floor(scaled)
        out[between] = (whole + (scaled - whole >= 0.5)).astype(np.int8)
    if alpha is not None:
        out[alpha < 255] = -1
    return out


def _read_humble(image: Image.Image, mode: str, negate: bool, free: float, high: float) -> I8:
    """Nav2 humble map_io.cpp: double, open ends, ties to even, mean of the colour channels
    (and of alpha in trinary); scale makes non-opaque pixels unknown.
    """
    flat, alpha = _split(image)
    rgb = np.asarray(flat.convert("RGB"), np.float64)
    if mode == "trinary" and alpha is not None:
        rgb = np.dstack([rgb, alpha.astype(np.float64)])
    shade = rgb.sum(axis=2) / rgb.shape[2] / 255.0
    if mode == "raw":
        value = np.floor(shade * 255 + 0.5)
        return np.where(value <= 100, value, -1).astype(np.int8)
    occ = shade if negate else 1.0 - shade
    out = np.full(occ.shape, -1, np.int8)
    if mode == "scale":
        between = (occ >= free) & (occ <= high)
        out[between] = np.rint((occ[between] - free) / (high - free) * 100.0).astype(np.int8)
    out[occ < free] = 0
    out[occ > high] = 100
    if mode == "scale" and alpha is not None:
        out[alpha != 255] = -1
    return out


def _read_ros1(image: Image.Image, mode: str, negate: bool, free: float, high: float) -> I8:
    """ROS 1 map_server/src/image_loader.cpp: channel mean, open ends, scale 1 + 98 r truncated.
    Raw honours negate and wraps to int8 (255 is -1, but 101..254 are not unknown).  Palette images
    give their indices.  With several channels the last one acts as alpha (unknown only if 0).
    """
    if image.mode not in ("L", "LA", "P", "RGB", "RGBA"):
        raise ValueError(f"not modelled for ROS 1: {image.mode}")
    source = image.convert("RGBA") if image.mode == "LA" else image  # SDL_image expands it
    pixels = np.atleast_3d(np.asarray(source, np.float64))
    channels = pixels.shape[2]
    used = 3 if channels == 4 and mode != "trinary" else channels
    mean = pixels[:, :, :used].sum(axis=2) / used
    mean = 255 - mean if negate else mean
    if mode == "raw":
        return np.asarray(mean.astype(np.uint8).view(np.int8))
    occ = (255 - mean) / 255.0
    out = np.full(occ.shape, -1, np.int8)
    if mode == "scale":
        between = (occ >= free) & (occ <= high)
        between &= (pixels[:, :, -1] >= 1) | (channels == 1)
        out[between] = (1 + 98 * ((occ[between] - free) / (high - free))).astype(np.int8)
    out[occ < free] = 0
    out[occ > high] = 100
    return out


def mask_cost(data: I8) -> U8:
    """Nav2 getMaskCost (costmap_filter.cpp; humble: costmap_2d.cpp): round(2.54 value)."""
    cost = np.floor(data.astype(np.float64) * 254 / 100 + 0.5)
    return np.where(data == -1, NO_INFORMATION, cost).astype(np.uint8)


def keepout(
    costs: U8,
    mask: Grid,
    resolution: float,
    origin: tuple[float, float],
    lethal_override_cost: int | None = None,
) -> U8:
    """KeepoutFilter::process (keepout_filter.cpp, same loop in humble..main), mask in same frame.
    A master cell looks up the mask cell of its centre (yaw, base and multiplier are ignored);
    cells outside the window of the mask's corners + half a mask cell, truncated, are left alone
    (a mask coarser than the map loses half a mask cell at its low x and y edges).
    `lethal_override_cost` (jazzy >= 1.3.8, at most 252) is written instead of every mask cost
    while override_lethal_cost is on and the robot stands on a lethal mask cell.
    """
    index, keep = [], []
    for axis in (0, 1):  # x, then y
        size, count, corner = costs.shape[1 - axis], mask.data.shape[1 - axis], mask.origin[axis]
        half, length = 0.5 * mask.resolution, float(np.float32(count) * np.float32(mask.resolution))
        first = int((corner + half - origin[axis]) / resolution)
        last = int((corner + length + half - origin[axis]) / resolution)
        cells = np.arange(size)
        offset = origin[axis] + (cells + 0.5) * resolution - corner
        at = (offset / mask.resolution).astype(np.int64)
        keep.append((cells >= first) & (cells < last) & (offset >= 0) & (at < count))
        index.append(np.clip(at, 0, count - 1))
    data = mask_cost(mask.data)[np.ix_(index[1], index[0])]
    write = keep[1][:, None] & keep[0][None, :] & (data != NO_INFORMATION)
    write &= (data > costs) | (costs == NO_INFORMATION)
    new = data if lethal_override_cost is None else np.uint8(min(lethal_override_cost, 252))
    return np.where(write, new, costs).astype(np.uint8)


def static_layer(
    data: I8,
    stack: str,
    trinary_costmap: bool = True,
    lethal_cost_threshold: int = 100,
    unknown_cost_value: int = 255,
    track_unknown_space: bool | None = None,
    inscribed_obstacle_cost_value: int = 99,
) -> U8:
    """StaticLayer::interpretValue (static_layer.cpp of each stack); defaults as declared there:
    track_unknown_space is false in Nav2, true in ROS 1.  "main" (and lyrical) turns 99 into 253
    before any threshold, trinary or not; "humble" (jazzy, kilted) and "ros1" do not.  Soft values
    are truncated: 1 gives 2, 50 gives 127, 99 gives 251.
    """
    track = stack == "ros1" if track_unknown_space is None else track_unknown_space
    value = data.view(np.uint8)
    threshold = max(min(lethal_cost_threshold, 100), 0)
    out = np.zeros(value.shape, np.uint8)
    if not trinary_costmap and threshold:
        out = (np.minimum(value, threshold) / threshold * LETHAL).astype(np.uint8)
    out[value >= threshold] = LETHAL
    if stack == "main":
        out[value == inscribed_obstacle_cost_value] = INSCRIBED
    out[value == unknown_cost_value % 256] = NO_INFORMATION if track else 0
    return out


def inflation(
    costs: U8,
    resolution: float,
    inscribed_radius: float,
    inflation_radius: float,
    cost_scaling_factor: float = 10.0,
) -> U8:
    """InflationLayer::updateCosts and computeCost (inflation_layer.cpp, same in humble..main),
    after the layers below it and before filters.  Distances are those of centres of cells.
    Unknown cells are raised from 253 on only (inflate_unknown false).
    """
    away = distance_transform_edt(costs != LETHAL)
    beyond = np.maximum(away * resolution - inscribed_radius, 0.0)
    cost = ((INSCRIBED - 1) * np.exp(-cost_scaling_factor * beyond)).astype(np.uint8)
    cost[away * resolution <= inscribed_radius] = INSCRIBED
    cost[away == 0] = LETHAL
    write = away <= np.ceil(inflation_radius / resolution)
    write &= np.where(costs == NO_INFORMATION, cost >= INSCRIBED, cost > costs)
    return np.where(write, cost, costs).astype(np.uint8)


def speed_limit(data: I8, kind: int, base: float, multiplier: float) -> F64:
    """SpeedFilter (speed_filter.cpp, same in humble..main): limit per mask cell, 0 = no limit.
    `kind` 1: percent (outside 0..100: none), 2: m/s (negative: none).  Unknown keeps the last: NaN.
    """
    if kind not in (1, 2):
        raise ValueError("SpeedFilter takes type 1 or 2")
    limit = data * float(np.float32(multiplier)) + float(np.float32(base))
    none = (data == 0) | (limit < 0) | ((limit > 100) & (kind == 1))
    return np.where(data == -1, np.nan, np.where(none, 0.0, limit))


def smac_blocked(costs: U8, allow_unknown: bool = True) -> Bool:
    """GridCollisionChecker::inCollision: cost >= 253; unknown passes by default (as 255)."""
    return np.asarray((costs >= INSCRIBED) & ~((costs == NO_INFORMATION) & allow_unknown))


def smac2d_multiplier(costs: U8, k: float = 1.0) -> F64:
    """Node2D::getTraversalCost (node_2d.cpp): step = length (1 + k cost/252), entered cell.
    cost_travel_multiplier k is 1.0 in the code of every branch (the documentation says 2.0).
    """
    return 1.0 + (np.float32(k) * (costs / 252.0).astype(np.float32)).astype(np.float64)


def smac_hybrid_multiplier(
    costs: U8, k: float = 2.0, retrospective_penalty: float = 0.015, quadratic: bool = False
) -> F64:
    """NodeHybrid::getTraversalCost (node_hybrid.cpp), straight forward, per length: 1 -
    retrospective_penalty (0.015) + k cost/252 at the cell where the motion primitive ends.
    cost_penalty k is 2.0 in every branch; use_quadratic_cost_penalty (false; from jazzy on)
    squares cost/252 only.  Up to kilted the first step has no penalty.
    """
    normalised = costs.astype(np.float32) / np.float32(252)
    penalty = np.float32(k) * normalised * (normalised if quadratic else np.float32(1))
    reward = np.float32(1) - np.float32(retrospective_penalty)
    return (reward + penalty).astype(np.float64)


def navfn_costs(costs: U8, allow_unknown: bool = True) -> U8:
    """NavFn::setCostmap and setupNavFn (navfn.cpp, all branches): 50 + 0.8 cost, truncated.
    252 gives 251, unknown 253 (or 254 without allow_unknown, default true); 253, 254 and the
    outermost ring of the map give 254, the obstacle.  Entering a cell costs this per length.
    """
    out = np.minimum(50 + 0.8 * costs.astype(np.float64), 253).astype(np.uint8)
    out[(costs >= INSCRIBED) & ~((costs == NO_INFORMATION) & allow_unknown)] = 254
    out[[0, -1], :] = 254
    out[:, [0, -1]] = 254
    return out


def navfn_potential(array: U8, source: Cell) -> F64:
    """Fixed point of NavFn::updateCell (navfn.cpp, all branches) on navfn_costs, from the robot.
    With h the cell's cost and p <= q the lower neighbour of each axis, d = (q - p)/h: p + h if
    d >= 1, else p + h (-0.2301 d^2 + 0.5307 d + 0.7040).  NavFn updates in blocks and stops
    early, so it may stay slightly above.
    """
    pot = np.full(array.shape, np.inf)
    pot[source] = 0.0
    heap: list[tuple[float, Cell]] = [(0.0, source)]
    while heap:
        _, (r, c) = heapq.heappop(heap)
        for i, j in ((r + 1, c), (r - 1, c), (r, c + 1), (r, c - 1)):
            if array[i, j] >= 254:
                continue
            h = float(array[i, j])
            p, q = sorted((min(pot[i, j - 1], pot[i, j + 1]), min(pot[i - 1, j], pot[i + 1, j])))
            d = (q - p) / h
            new = p + h * (1.0 if d >= 1 else -0.2301 * d * d + 0.5307 * d + 0.7040)
            if new < pot[i, j] - 1e-9:
                pot[i, j] = new
                heapq.heappush(heap, (new, (i, j)))
    return pot


def theta_star_traversal(costs: U8, w_traversal_cost: float = 2.0) -> F64:
    """ThetaStar::getTraversalCost (theta_star.hpp, all branches): w ((26 + 0.9 cost)/252)^2.
    Charged once per entered cell, whatever the step's length, on top of w_euc_cost (1.0) times
    the length; w is w_traversal_cost (2.0).  A straight-line shortcut counts unknown as 253/252.
    """
    cost = 26 + 0.9 * costs.astype(np.float64)
    return w_traversal_cost * cost * cost / 252 / 252


def theta_star_blocked(costs: U8, allow_unknown: bool = True, line: bool = False) -> Bool:
    """ThetaStar::isSafe: cost > 252; on a straight `line`, 26 + 0.9 cost > 252."""
    over = 26 + 0.9 * costs.astype(np.float64) > 252 if line else costs > MAX_NON_OBSTACLE
    return np.asarray(over & ~((costs == NO_INFORMATION) & allow_unknown))


def grid_path(
    per_length: Any, blocked: Bool, start: Cell, goal: Cell, per_cell: Any = 0.0
) -> tuple[list[Cell], float]:
    """Cheapest 8-neighbour path and its cost in cells; ([], inf) if there is none.
    A step costs length * per_length + per_cell of the entered cell and may cut corners, as in
    SmacPlanner2D and Theta*.  The start may be blocked (planners clear it or do not check it).
    """
    height, width = blocked.shape
    along = np.broadcast_to(np.asarray(per_length, np.float64), blocked.shape)
    fixed = np.broadcast_to(np.asarray(per_cell, np.float64), blocked.shape)
    number = np.arange(height * width, dtype=np.int32).reshape(height, width)
    parts = []
    for r, c in product((-1, 0, 1), repeat=2):
        here = np.s_[max(-r, 0) : height - max(r, 0), max(-c, 0) : width - max(c, 0)]
        there = np.s_[max(r, 0) : height + min(r, 0), max(c, 0) : width + min(c, 0)]
        if (r, c) != (0, 0):
            ok = ~blocked[there]
            step = np.hypot(r, c) * along[there] + fixed[there]
            parts.append((step[ok], number[here][ok], number[there][ok]))
    step, source, target = (np.concatenate(p) for p in zip(*parts, strict=True))
    graph = csr_array((step, (source, target)), shape=(number.size, number.size))
    first, last = int(number[start]), int(number[goal])
    cost, before = dijkstra(graph, indices=first, return_predecessors=True)
    nodes = [last] if np.isfinite(cost[last]) else []
    while nodes and nodes[-1] != first:
        nodes.append(int(before[nodes[-1]]))
    return [divmod(node, width) for node in reversed(nodes)], float(cost[last])


def smac2d_path(costs: U8, start: Cell, goal: Cell, k: float = 1.0) -> list[Cell]:
    """SmacPlanner2D's path before smoothing (its Euclidean heuristic never overestimates)."""
    return grid_path(smac2d_multiplier(costs, k), smac_blocked(costs), start, goal)[0]
