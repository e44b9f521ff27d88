"""What a session begins with, and what it shows at one moment."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from locplan.costs import Costmap
from locplan.explorer._snap import Floor, Parts
from locplan.field import CovarianceField, FieldConfig
from locplan.planners import Position
from locplan.robots import Robot


@dataclass(frozen=True)
class Opening:
    """What a session begins with, and what never changes in it."""

    config: FieldConfig
    """Settings of the first field."""
    robot: Robot = field(default_factory=Robot)
    """The robot; its lidar is None where none was named."""
    criterion: str | None = None
    """Scalar that u is made of; None for the estimator's own."""
    weight: float | None = None
    """Metres of detour accepted per degenerate metre; None for the estimator's own."""
    start: Position | None = None
    """Position of the start [m]; None for a place of the page's own choice."""
    goal: Position | None = None
    """Position of the goal [m]; None for a place of the page's own choice."""
    via: tuple[Position, ...] = ()
    """Positions to visit on the way [m]."""
    folder: Path | None = None
    """Folder that files are written under; None where none may be written."""
    drives: tuple[Any, ...] = ()
    """Recorded drives that can be shown."""
    cache_dir: Path | None = None
    """Folder of cached fields; None for the usual one."""
    threads: int | None = None
    """Number of threads for fields; None for all cores."""
    map_file: str | None = None
    """The map's file as it was named; None where the map comes from Python."""
    force: bool = False
    """True lets files in the way be replaced."""


@dataclass(frozen=True, eq=False)
class Scene:
    """The map, its field and its costs at one moment."""

    costs: Costmap
    """The costmap at the default weight; blank without a field."""
    field: CovarianceField | None
    """The field, or None before there is one."""
    whole: bool
    """False while some values are those from before an edit."""
    serial: int
    """Number of the scene."""

    @cached_property
    def digest(self) -> str:
        """Digest of the map and of the values of its field."""
        settings = self.field.config.to_json() if self.field else None
        state = None if self.whole else self.serial
        text = json.dumps([self.costs.grid.digest, settings, state], sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()[:32]

    @cached_property
    def saturated_share(self) -> float:
        """Share of the places whose matches count as perfect, 0..1; 0 without a field."""
        return 0.0 if self.field is None else self.field.saturated_share

    @cached_property
    def parts(self) -> Parts:
        """The connected parts of the free space."""
        return Parts.of(self.costs)

    @cached_property
    def floor(self) -> Floor:
        """The floor in larger cells, for drafts."""
        return Floor.of(self.costs)

    @cached_property
    def log_deviation(self) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
        """Logarithm of the largest position deviation [m] on the lattice, and 1 where it is known.

        Both are 0 elsewhere, and there are none without a field.
        """
        if self.field is None:
            return None
        with np.errstate(divide="ignore"):
            values = np.log(self.field.scalar("position_std", headings="mean"))
        values = self.field.on_lattice(values)
        known = ~np.isnan(values)
        return np.where(known, values, 0.0), known.astype(np.float64)


@dataclass(frozen=True)
class Download:
    """A file that the page can fetch."""

    name: str
    """Name that it is saved under."""
    content: bytes
    """What is in it."""
    media_type: str
    """Its kind, such as text/html."""


@dataclass
class Busy:
    """Work in the background."""

    do: str
    """What is done."""
    done: int = 0
    """Steps that are done."""
    total: int = 0
    """All steps; 0 before that is known."""
