"""What the page gets to know: what a session is about, how it stands, places, and layers as bytes.

Row 0 of layers and of maps is on top, as the page draws them.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from locplan import __version__
from locplan._support.checks import FARTHEST, number
from locplan._support.kernels.arrays import Octets
from locplan._support.poses import window_around
from locplan.app.explorer.requests import MAX_WEIGHT, Ask, Work
from locplan.app.explorer.scene import Scene
from locplan.field.covariance import position_axes, scalar
from locplan.maps.grid import OccupancyGrid
from locplan.maps.occupancy import FREE, OCCUPIED
from locplan.robots.lidar import LIDARS

if TYPE_CHECKING:
    from locplan.app.explorer.session import Session


def about(session: Session) -> dict[str, Any]:
    """The map, and what can be chosen and done."""
    from locplan.export.parameters import DISTRIBUTIONS

    grid, writes = session.original, session.opening.folder is not None
    return {
        "version": __version__,
        "map": {
            "name": grid.name,
            "rows": grid.shape[0],
            "cols": grid.shape[1],
            "resolution": grid.resolution,
            "origin": list(grid.origin),
        },
        "needs_lidar": session.config.estimator.casts_rays,
        "lidars": [
            {
                "name": name,
                "title": f"{name}, {each.range:g} m, {each.field_of_view_deg:g}°",
                "range": each.range,
            }
            for name, each in LIDARS.items()
        ],
        "distros": list(DISTRIBUTIONS),
        "can": {"export": writes, "save": writes},
        "max_weight": MAX_WEIGHT,
        "checked": session.opening.report is not None,
    }


def state(session: Session) -> dict[str, Any]:
    """How the session stands."""
    scene, opening, field = session.scene, session.opening, session.scene.field
    busy = session.busy and dict(zip(("done", "total"), session.busy, strict=True))
    start, goal = ends(session)
    lattice = None
    if field is not None:
        rows, cols = field.covariance.shape[:2]
        lattice = {"rows": rows, "cols": cols, "stride_cells": field.stride}
    return {
        "map": {
            "digest": session.grid.digest,
            "edited": session.edited,
            "can_undo": bool(session.edits),
            "can_redo": bool(session.undone),
        },
        "robot": session.robot.title,
        "field": _field(scene),
        "lattice": lattice,
        "layers": [each.to_json() for each in session.layers().values()],
        "default_weight": session.default_weight,
        "start": start,
        "goal": goal,
        "via": [list(xy[:2]) for xy in opening.via],
        "busy": busy and {"id": None, "do": "field", **busy},
    }


def ends(session: Session) -> tuple[list[float] | None, list[float] | None]:
    """Start and goal that the page begins with: those given, or two places far apart."""
    opening = session.opening
    if opening.start and opening.goal:
        return list(opening.start[:2]), list(opening.goal[:2])
    with session.opening_ends:  # the pages that open at once wait for one search
        found = session.files.made(("ends",), lambda: _far_apart(session), lambda _: 100)
    start, goal = opening.start or found[0], opening.goal or found[1]
    return (start and list(start[:2])), (goal and list(goal[:2]))


def _far_apart(session: Session) -> tuple[Any, Any]:
    """Two places of the largest part of the free space, far apart; None where there is none."""
    from locplan.planning.cost_to_go import farthest_pairs

    parts = session.scene.parts
    labels = parts.labels.astype(np.int32)
    sizes = np.bincount(labels.ravel())[1:]
    if not sizes.size:
        return None, None
    largest = int(sizes.argmax()) + 1
    pairs = farthest_pairs(parts.grid, labels, largest, "AB", 0.0)
    if pairs:
        return (pairs[0].start.x, pairs[0].start.y), (pairs[0].goal.x, pairs[0].goal.y)
    row, col = np.argwhere(labels == largest)[0].tolist()
    place = parts.grid.position(row, col)
    return place, place


def _field(scene: Scene) -> dict[str, Any] | None:
    if scene.field is None:
        return None
    config = scene.field.config
    model = getattr(getattr(config.estimator, "lidar", None), "model", "")
    return {
        "digest": scene.digest,
        "estimator": config.estimator.name,
        "lidar": model if model in LIDARS else None,
        "range": config.estimator.reach,
        "headings": config.headings,
        "saturated": scene.field.saturated_share,
        "whole": scene.whole,
    }


FAR = 5.0
"""Largest clearance that is shown [m]."""


def at(session: Session, ask: Ask, work: Work) -> dict[str, Any]:
    """Answer what the field knows about a place: its error ellipse, with axes [cm] and angle."""
    x, y = (number(name, ask.values.get(name), -FARTHEST, FARTHEST) for name in ("x", "y"))
    scene = session.scene
    grid = scene.costs.grid
    about: dict[str, Any] = {"x": x, "y": y, "known": False, "clearance": None}
    cell = grid.cell((x, y))
    if not grid.contains(*cell):
        return about
    about["clearance"] = clearance_at(grid, *cell)
    covariance = np.array(np.nan) if scene.field is None else scene.field.at((x, y), "covariance")
    if np.isnan(covariance).any():
        return about
    major, minor, angle = (float(value) for value in position_axes(covariance))
    return about | {
        "known": True,
        "axes": [100 * major, 100 * minor],
        "angle": angle,
        "heading_deg": math.degrees(float(scalar(covariance, "heading_std"))),
        "u": float(scene.costs.u[cell]),
        "e": float(scalar(covariance, "e")),
    }


def clearance_at(grid: OccupancyGrid, row: int, col: int) -> float:
    """Distance from a cell's centre to the nearest occupied cell's edge [m]; NaN beyond `FAR`.

    Where it is near this is `OccupancyGrid.clearance`, without the array of the whole map.
    """
    window = window_around(row, col, FAR / grid.resolution + 1, grid.shape)
    occupied = np.argwhere(grid.cells[window] == OCCUPIED) + [each.start for each in window]
    # In halves of a cell, from the centre to the edges of the others.
    apart = np.maximum(2 * np.abs(occupied - (row, col)) - 1, 0)
    near = math.sqrt((apart**2).sum(axis=1).min(initial=2**52)) * (grid.resolution / 2)
    return near if near <= FAR else math.nan


def cells_of(cells: Octets) -> Octets:
    """Cells of a map as 0 for unknown, 1 for free, 2 for occupied ones, row 0 on top."""
    classes = np.zeros(256, np.uint8)
    classes[FREE], classes[OCCUPIED] = 1, 2
    return np.asarray(classes[cells[::-1]])
