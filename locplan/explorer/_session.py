"""A session: a map, its field and its costs, and what is kept of them; it knows no web."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import secrets
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from locplan._util.public import called
from locplan.costs import Costmap
from locplan.errors import ConfigError
from locplan.explorer._scene import Busy, Download, Opening, Scene
from locplan.explorer._searches import Kept
from locplan.explorer._snap import Parts, snapped
from locplan.explorer._textures import Texture, textures_of
from locplan.explorer._upkeep import Upkeep
from locplan.explorer._view import View
from locplan.explorer._wire import Ask
from locplan.field import CovarianceField, equipped
from locplan.maps import OccupancyGrid
from locplan.planners import Position
from locplan.robots import Lidar, Robot

KEPT_BYTES = 520e6
"""Bytes of costmaps and searches that are kept: at 4000 x 4000 cells two costmaps, searches on both
from two ends, drafts, and a search that is made."""
KEPT_FILES = 80e6
"""Bytes of textures and files to download that are kept."""
MAX_WEIGHT = 1000.0
"""Greatest weight that the page can ask for."""
Listener = Callable[[dict[str, Any]], None]
"""Function that takes an event, fit for JSON."""


@dataclass
class History:
    """The maps before the last edits, and those that were undone."""

    before: list[Any] = field(default_factory=list)
    """Changes that can be undone, the last one at the end."""
    undone: list[Any] = field(default_factory=list)
    """Changes that can be redone, the next one at the end."""


class Session:
    """A map, its field and its costs as one page or several see and change them.

    Its methods may be called from several threads. A scene is replaced as a whole, so that a plan
    works on one of them from the beginning to the end.
    """

    def __init__(self, grid: OccupancyGrid, opening: Opening) -> None:
        self.opening = opening
        self.original = grid
        self.grid = grid
        self.config = opening.config
        self.kept = Kept(KEPT_BYTES)
        self.files = Kept(KEPT_FILES)
        self.history = History()
        self.busy: Busy | None = None
        self.changing = threading.RLock()
        self.opening_ends = threading.Lock()
        self.listeners: list[Listener] = []
        blank = Costmap.blank(grid, robot_radius=opening.robot.radius)
        self.scene = Scene(blank, None, True, 0)
        self.saved, self.saved_as = grid, ""
        self.written: set[Path] = set()
        self.twins: Texture | None = None
        self.upkeep = Upkeep(self)

    @property
    def name(self) -> str:
        """Name of the map."""
        return self.grid.name

    @property
    def field(self) -> CovarianceField | None:
        """The field, or None before there is one."""
        return self.scene.field

    @property
    def lidar(self) -> Lidar | None:
        """The robot's lidar by the present settings; None where none was named."""
        own: Lidar | None = getattr(self.config.estimator, "lidar", None)
        return own if self.config is not self.opening.config else self.opening.robot.lidar or own

    @property
    def robot(self) -> Robot:
        """The robot with its lidar; where none was named, with one of the field's range."""
        return equipped(dataclasses.replace(self.opening.robot, lidar=self.lidar), self.config)

    @property
    def twins_digest(self) -> str:
        """Digest of what the layer of look-alikes is made of; empty before there is a lattice."""
        field = self.scene.field
        if field is None:
            return ""
        made_of = [self.grid.digest, self.robot.digest, field.stride]
        return hashlib.sha256(json.dumps(made_of).encode()).hexdigest()[:32]

    @property
    def map_file(self) -> str | None:
        """The map's file as it was named, or the one that was saved last; None without either."""
        return self.saved_as or self.opening.map_file

    @property
    def force(self) -> bool:
        """Whether files in the way may be replaced."""
        return self.opening.force

    @property
    def edited(self) -> bool:
        """Whether the map differs from the one that was opened or saved last."""
        return self.grid.digest != self.saved.digest

    @property
    def folder(self) -> Path | None:
        """Folder that files are written under, or None."""
        return self.opening.folder

    @property
    def drives(self) -> Sequence[Any]:
        """Recorded drives that can be shown."""
        return self.opening.drives

    @property
    def default_weight(self) -> float:
        """The weight where none is asked for."""
        given = self.opening.weight
        return self.config.estimator.weight if given is None else given

    def costmap_of(self, field: CovarianceField) -> Costmap:
        """The costmap of a field with the session's settings."""
        given = {"criterion": self.opening.criterion, "weight": self.opening.weight}
        radius = self.opening.robot.radius
        options: dict[str, Any] = {name: v for name, v in given.items() if v is not None}
        return Costmap.from_field(field.grid, field, robot_radius=radius, **options)

    def show(self, costs: Costmap, field: CovarianceField | None, *, whole: bool) -> None:
        """Replace the scene, and tell all pages."""
        with self.changing:
            serial = self.scene.serial + 1
            self.scene = Scene(costs, field, whole, serial)
        self.kept.forget(lambda key: key[1] == serial)
        self.tell({"event": "state"})

    def costs(self, weight: float | None = None, scene: Scene | None = None) -> Costmap:
        """The costmap at a weight, by default the usual one.

        Raises
        ------
        ConfigError
            If there is no field yet.
        """
        scene = scene or self.scene
        if scene.field is None:
            raise ConfigError("the field is still being computed; wait until it is there")
        if weight is None or weight == scene.costs.weight:
            return scene.costs
        key = ("costs", scene.serial, float(weight))
        return self.kept.made(
            key, lambda: scene.costs.with_weight(weight), lambda made: made.density.nbytes
        )

    def parts(self, scene: Scene | None = None) -> Parts:
        """The connected parts of the free space."""
        return (scene or self.scene).parts

    def weight_of(self, ask: Ask) -> float:
        """The weight of a question."""
        given = ask.number("weight", 0.0, MAX_WEIGHT)
        return self.default_weight if given is None else given

    def stops(self, ask: Ask, scene: Scene | None = None) -> list[Position]:
        """Start, waypoints and goal of a question, moved to where the robot can stand."""
        stops = [ask.position("start"), *ask.positions("via"), ask.position("goal")]
        return snapped(self.parts(scene), stops)

    def view(self, ask: Ask) -> View:
        """What the page shows, for the answers that take long."""
        scene = self.scene
        costs = self.costs(self.weight_of(ask), scene)
        assert scene.field is not None
        start, *via, goal = self.stops(ask, scene)
        shown = costs.grid, scene.field, costs, self.robot
        return View(*shown, start, goal, tuple(via), scene.whole)

    def textures(self, digest: str) -> Mapping[str, Texture] | None:
        """The layers of a digest: of the scene, of one shortly before, or of the look-alikes.

        None where there is nothing of it.
        """
        scene, twins = self.scene, self.twins
        if twins is not None and digest == twins.digest:
            return {twins.name: twins}
        if scene.digest != digest or scene.field is None:
            before: Mapping[str, Texture] | None = self.files.get(("textures", digest))
            return before
        found: CovarianceField = scene.field
        return self.files.made(
            ("textures", digest),
            lambda: textures_of(found),
            lambda made: sum(each.values.nbytes for each in made.values()),
        )

    def layers(self) -> dict[str, Texture]:
        """The layers to choose from: the field's, and the look-alikes of this map and lidar."""
        found = dict(self.textures(self.scene.digest) or {})
        if found and self.twins is not None and self.twins.digest == self.twins_digest:
            found[self.twins.name] = self.twins
        return found

    def add_download(self, name: str, content: bytes, media_type: str) -> str:
        """Keep a file for the page to fetch, and return its key."""
        key = secrets.token_urlsafe(16)
        self.files.put(("download", key), Download(name, content, media_type), len(content))
        return key

    def download(self, key: str) -> Download | None:
        """A file that was kept; None without it."""
        found: Download | None = self.files.get(("download", key))
        return found

    def tell(self, event: dict[str, Any]) -> None:
        """Tell all pages of an event."""
        for listener in list(self.listeners):
            listener(event)

    def replace_grid(self, grid: OccupancyGrid) -> None:
        """Take an edited map; what shows it is brought up to date by `Upkeep`."""
        self.grid = dataclasses.replace(grid, name=self.original.name)

    def make_room(self) -> None:
        """Drop what is kept of a scene that is replaced next: the new costmap needs the room."""
        self.kept.forget(lambda key: False)

    def about(self) -> dict[str, Any]:
        """The map, and what can be chosen and done, fit for JSON."""
        return dict(called("locplan.explorer._state:about", self))

    def state(self) -> dict[str, Any]:
        """The field, the layers, the ends and the work in the background, fit for JSON."""
        return dict(called("locplan.explorer._state:state", self))

    def answer(
        self, do: str, *, progress: Callable[..., None] = lambda *_: None, **values: Any
    ) -> dict[str, Any]:
        """The answer to a question as the page gets it, fit for JSON.

        `progress` is called with (done, total), and perhaps what is done; what it raises ends the
        work. A value out of its range is a LocplanError.
        """
        return dict(called("locplan.explorer._asks:answer", self, do, values, progress))
