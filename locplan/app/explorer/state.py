"""Data that the page shows: the session, its state, and places on the map."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from locplan._support.checks import FARTHEST, check_number
from locplan._support.poses import find_window
from locplan.app.explorer.messages import MAX_WEIGHT, Question, QuestionJob
from locplan.app.explorer.scene import MapScene
from locplan.export.parameters import ROS_DISTRIBUTIONS
from locplan.field.covariance import position_axes, scalar
from locplan.maps.grid import OccupancyGrid
from locplan.maps.occupancy import OCCUPIED
from locplan.robots.lidar import LIDARS

if TYPE_CHECKING:
    from locplan.app.explorer.session import Session

FAR = 5.0
"""Largest clearance that is shown [m]."""


def describe_session(session: Session) -> dict[str, Any]:
    """Return the data that never changes: the map and the choices."""
    grid = session.original.grid
    return {
        "map": {
            "name": grid.name,
            "rows": grid.shape[0],
            "cols": grid.shape[1],
            "resolution": grid.resolution,
            "origin": list(grid.origin),
        },
        "lidars": [
            {
                "name": name,
                "title": f"{name}, {lidar.range:g} m, {lidar.field_of_view_deg:g}°",
                "range": lidar.range,
            }
            for name, lidar in LIDARS.items()
        ],
        "distros": list(ROS_DISTRIBUTIONS),
        "can_export": session.opening.folder is not None,
        "has_report": session.opening.report is not None,
        "max_weight": MAX_WEIGHT,
    }


def describe_state(session: Session) -> dict[str, Any]:
    """Return the data that changes: scene, robot, route and weak spots."""
    with session.lock:
        scene, changes, busy = session.scene, session.changes, session.busy
        spots, route = session.weak_spots, session.route
    layers = session.find_layers(scene.digest) if scene.digest else {}
    robot, weight = scene.site.robot, session.opening.weight
    lidar = robot.known_lidar
    return {
        "basis": scene.basis,
        "changes": list(changes),
        "field": _describe_field(scene),
        "layers": [layer.facts for layer in layers.values()],
        "busy": None if busy is None else {"done": busy[0], "total": busy[1]},
        "robot": {
            "title": robot.title,
            "lidar": lidar.model if lidar.model in LIDARS else None,
            "range": lidar.range,
        },
        "default_weight": scene.site.config.estimator.weight if weight is None else weight,
        "route": route and {name: _drop_heading(value) for name, value in vars(route).items()},
        "weak_spots": None if spots is None else [spot.facts for spot in spots],
    }


def _drop_heading(value: Any) -> list[Any]:
    """Return a position, or a list of positions, without headings."""
    return (
        [_drop_heading(xy) for xy in value]
        if value and isinstance(value[0], tuple)
        else list(value[:2])
    )


def _describe_field(scene: MapScene) -> dict[str, Any] | None:
    if scene.field is None:
        return None
    rows, cols = scene.field.covariance.shape[:2]
    return {
        "digest": scene.digest,
        "rows": rows,
        "cols": cols,
        "stride_cells": scene.field.stride,
        "is_whole": scene.is_field_complete,
    }


def describe_place(
    session: Session, scene: MapScene, question: Question, job: QuestionJob
) -> dict[str, Any]:
    """Return the error ellipse of a place, and the reason if scans are weak there."""
    x, y = (
        check_number(name, question.values.get(name), -FARTHEST, FARTHEST) for name in ("x", "y")
    )
    grid = scene.costs.grid
    answer: dict[str, Any] = {"x": x, "y": y, "known": False, "clearance": None, "reason": None}
    cell = grid.cell((x, y))
    if not grid.contains(*cell):
        return answer
    answer["clearance"] = measure_obstacle_distance(grid, *cell)
    covariance = np.array(np.nan) if scene.field is None else scene.field.at((x, y), "covariance")
    if np.isnan(covariance).any():
        return answer
    major, minor, angle = (float(value) for value in position_axes(covariance))
    spots = session.weak_spots or [] if scene is session.scene else []
    return answer | {
        "known": True,
        "axes": [100 * major, 100 * minor],
        "angle": angle,
        "heading_deg": math.degrees(float(scalar(covariance, "heading_std"))),
        "reason": next((spot.reason for spot in spots if spot.contains((x, y))), None),
    }


def measure_obstacle_distance(grid: OccupancyGrid, row: int, col: int) -> float:
    """Return the distance from a cell's centre to the nearest occupied cell's edge [m].

    It is that of `OccupancyGrid.clearance`, without an array of the whole map; NaN beyond `FAR`.
    """
    window = find_window(row, col, FAR / grid.resolution + 1, grid.shape)
    occupied = np.argwhere(grid.cells[window] == OCCUPIED) + [axis.start for axis in window]
    # In halves of a cell, from the centre to the edges of the others.
    gaps = np.maximum(2 * np.abs(occupied - (row, col)) - 1, 0)
    near = math.sqrt((gaps**2).sum(axis=1).min(initial=2**52)) * (grid.resolution / 2)
    return near if near <= FAR else math.nan
