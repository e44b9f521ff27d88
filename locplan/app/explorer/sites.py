"""Sites, and the changes of the page that turn one site into another."""

from __future__ import annotations

import dataclasses
import itertools
import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from locplan._support.checks import MAX_RANGE, check_number
from locplan._support.kernels.arrays import Octets
from locplan.advice.landmark_objects import ObjectShape, Pole, find_covered_cells
from locplan.errors import ConfigError
from locplan.field.config import SHORT_LIDAR, FieldConfig, equip_robot
from locplan.maps.grid import OccupancyGrid
from locplan.maps.occupancy import FREE, OCCUPIED
from locplan.maps.zones import KINDS as ZONE_KINDS, Zone, Zones
from locplan.robots.lidar import LIDARS, Lidar
from locplan.robots.robot import Robot

if TYPE_CHECKING:
    from locplan.app.explorer.messages import Question

MAX_CHANGES, MAX_POINTS = 2000, 5000
"""Maximum numbers of changes and of points in one change."""
MAX_ZONES, MAX_CORNERS = 1500, 10_000
"""Maximum numbers of initial zones and their corners; they leave room for changes."""
SPEED = 50.0
"""Default speed in a slow zone [% of the top speed]."""
KINDS = "wall", "erase", "pole", "lidar", "zone"
Change = Mapping[str, Any]
"""A change as the page sends it, checked."""


@dataclass(frozen=True, eq=False)
class ExploredSite:
    """A map with the robot, the settings of its field, and the zones."""

    grid: OccupancyGrid
    """The map."""
    config: FieldConfig
    """Settings of the field."""
    named_robot: Robot
    """The robot. Its lidar is None if the user named none."""
    zones: Zones = field(default_factory=Zones)
    """The zones."""

    @cached_property
    def robot(self) -> Robot:
        """The robot with its lidar, or with an assumed lidar of the field's range."""
        return equip_robot(self.named_robot, self.config)

    @cached_property
    def digests(self) -> dict[str, str]:
        """Digests of the map, the robot and the zones."""
        return {
            "map": self.grid.digest,
            "robot": self.robot.digest,
            "zones": self.zones.digest,
        }

    @cached_property
    def key(self) -> str:
        """Key of the site: equal sites have equal keys."""
        return json.dumps([self.digests, self.config.to_json()], sort_keys=True)

    def with_changes(self, changes: Sequence[Change]) -> ExploredSite:
        """Apply changes in their order, and return the changed site.

        Raises
        ------
        ConfigError
            If a lidar does not suit the estimator of the field, or a zone encloses no area.
        """
        cells, config, robot = self.grid.cells.copy(), self.config, self.named_robot
        for change in changes:
            if change["kind"] == "lidar":
                config, robot = _with_lidar(config, robot, change["lidar"], change["range"])
            elif change["kind"] == "pole":
                pose = np.array([*change["points"][0], 0.0])
                cells[find_covered_cells(self.grid, Pole(change["width"]), pose)] = OCCUPIED
            elif change["kind"] != "zone":
                level = OCCUPIED if change["kind"] == "wall" else FREE
                _draw_line(cells, self.grid, change["points"], change["width"], level)
        zones = [_make_zone(change) for change in changes if change["kind"] == "zone"]
        is_edited = not np.array_equal(cells, self.grid.cells)
        grid = dataclasses.replace(self.grid, cells=cells) if is_edited else self.grid
        return ExploredSite(grid, config, robot, Zones([*self.zones, *zones]))


def _draw_line(
    cells: Octets, grid: OccupancyGrid, points: Sequence[Sequence[float]], width: float, level: int
) -> None:
    """Fill the cells whose centres a line covers; of a thin line, the cells that it crosses."""
    half = max(width / 2, math.sqrt(0.5) * grid.resolution)
    ends = np.column_stack(grid.world_to_grid(*np.array(points).T))
    for first, last in itertools.pairwise(ends if len(ends) > 1 else [*ends, *ends]):
        middle, along = (first + last) / 2, last - first
        line = ObjectShape(grid.resolution * float(np.hypot(*along)) / 2, 0.0, is_round=False)
        window, distance = line.compute_window_distances(
            grid, np.array([*middle, math.atan2(*along)]), half
        )
        cells[window][distance <= half + 1e-9] = level


def _with_lidar(
    config: FieldConfig, robot: Robot, name: str | None, lidar_range: float | None
) -> tuple[FieldConfig, Robot]:
    """Return the field settings and the robot with another lidar or range."""
    estimator: Any = config.estimator
    lidar = Lidar.preset(name) if name else robot.lidar or getattr(estimator, "lidar", None)
    if lidar is None and estimator.casts_rays:
        lidar = dataclasses.replace(SHORT_LIDAR, model="assumed lidar")
    if lidar is None:  # such as Sad, whose range is a setting
        estimator = dataclasses.replace(estimator, range=lidar_range) if lidar_range else estimator
    else:
        lidar = dataclasses.replace(lidar, range=lidar_range) if lidar_range else lidar
        estimator = estimator.with_lidar(lidar)
        robot = dataclasses.replace(robot, lidar=lidar)
    return FieldConfig(estimator, stride=config.stride, headings=config.headings), robot


def read_changes(question: Question) -> tuple[Change, ...]:
    """Return the changes of a question.

    Raises
    ------
    ConfigError
        If a change is invalid.
    """
    return tuple(map(_read_change, question.items("changes", MAX_CHANGES)))


def _read_change(change: Question) -> Change:
    change_kind = change.choice("kind", KINDS, None)
    if change_kind is None:
        raise ConfigError(f"a change must have a kind: {', '.join(KINDS)}")
    read_values: Callable[[Question], Change] = _read_stroke
    if change_kind == "lidar":
        read_values = _read_lidar
    elif change_kind == "zone":
        read_values = _read_zone
    return {"kind": change_kind, **read_values(change)}


def _read_stroke(stroke: Question) -> Change:
    points = stroke.positions("points", MAX_POINTS)
    if not points:
        raise ConfigError("walls, erased lines and poles need at least one point")
    width = check_number("width", stroke.values.get("width"), 0.001, 20.0)
    return {"points": [list(xy) for xy in points], "width": width}


def _read_lidar(lidar_values: Question) -> Change:
    return {
        "lidar": lidar_values.choice("lidar", LIDARS, None),
        "range": lidar_values.number("range", 0.1, MAX_RANGE, None),
    }


def _read_zone(zone_values: Question) -> Change:
    zone = zone_values.choice("zone", ZONE_KINDS, None)
    if zone is None:
        raise ConfigError(f"a zone must have a kind: {', '.join(ZONE_KINDS)}")
    polygon = [list(xy) for xy in zone_values.positions("polygon", MAX_POINTS)]
    percent = zone_values.number("percent", 1, 100, SPEED) if zone == "slow" else None
    return {"zone": zone, "polygon": polygon, "percent": percent}


def changes_from_zones(zones: Zones) -> tuple[Change, ...]:
    """Return zones as changes, so that the page can edit and remove them.

    Raises
    ------
    ConfigError
        If there are too many.
    """
    corners = sum(len(zone.polygon) for zone in zones)
    if len(zones) > MAX_ZONES or corners > MAX_CORNERS:
        raise ConfigError(
            f"{len(zones):,} zones with {corners:,} corners are too many for the page; draw at most"
            f" {MAX_ZONES:,} with {MAX_CORNERS:,}"
        )
    return tuple(
        {
            "kind": "zone",
            "zone": zone.kind,
            "polygon": zone.polygon.tolist(),
            "percent": zone.percent,
        }
        for zone in zones
    )


def _make_zone(change: Change) -> Zone:
    try:
        return Zone(change["zone"], change["polygon"], change["percent"])
    except ConfigError as error:
        raise ConfigError(f"this zone: {error}") from None
