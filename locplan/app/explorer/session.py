"""A session: a map, its field and its costs, and what is kept of them; it knows no web."""

from __future__ import annotations

import dataclasses
import secrets
import threading
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path as FilePath
from typing import Any

from locplan._support.tables import finite
from locplan.app.explorer.requests import MAX_WEIGHT, Ask, Cancel, Work
from locplan.app.explorer.scene import Opening, Scene, Texture, stops_of, textures_of
from locplan.app.explorer.searches import Flood, Kept
from locplan.app.explorer.upkeep import Upkeep
from locplan.app.explorer.view import View
from locplan.errors import ConfigError, LocplanError
from locplan.field.config import equipped
from locplan.field.field import CovarianceField
from locplan.maps.grid import OccupancyGrid
from locplan.planning.any_angle import AnyAngle
from locplan.planning.costmap import Costmap
from locplan.robots.lidar import Lidar
from locplan.robots.robot import Robot


@dataclass(frozen=True)
class Download:
    """A file that the page can fetch."""

    name: str
    """Name that it is saved under."""
    content: bytes
    """What is in it."""
    media_type: str
    """Its kind, such as text/html."""


class Session(Upkeep):
    """A map, its field and its costs as one page or several see and change them.

    Its methods may be called from several threads.

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    opening : Opening
        What the session begins with.
    """

    def __init__(self, grid: OccupancyGrid, opening: Opening) -> None:
        super().__init__(grid, opening)
        self.files = Kept(opening.limits.file_bytes)
        self.edits: list[Any] = []
        self.undone: list[Any] = []
        self.opening_ends = threading.Lock()
        self.saved = grid
        self.written: set[FilePath] = set()

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
    def edited(self) -> bool:
        """Whether the map differs from the one that was opened or saved last."""
        return self.grid.digest != self.saved.digest

    @property
    def default_weight(self) -> float:
        """The weight where none is asked for."""
        given = self.opening.weight
        return self.config.estimator.weight if given is None else given

    def costs(self, weight: float | None = None, scene: Scene | None = None) -> Costmap:
        """The costmap at a weight.

        Parameters
        ----------
        weight : float, optional
            Metres of detour accepted per degenerate metre, by default the usual weight.
        scene : Scene, optional
            The scene, by default the present one.

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
        return scene.costs.with_weight(weight)

    def weight_of(self, ask: Ask) -> float:
        """The weight of a question.

        Parameters
        ----------
        ask : Ask
            The question.
        """
        return ask.number("weight", 0.0, MAX_WEIGHT, self.default_weight)

    def view(self, ask: Ask) -> View:
        """What the page shows, for the answers that take long.

        Parameters
        ----------
        ask : Ask
            The question.
        """
        scene = self.scene
        costs = self.costs(self.weight_of(ask), scene)
        assert scene.field is not None
        stops, _ = stops_of(ask, scene.parts)
        return View(scene.field, costs, self.robot, stops, scene.whole)

    def textures(self, digest: str) -> Mapping[str, Texture] | None:
        """The layers of a digest: of the scene, or of one shortly before.

        Parameters
        ----------
        digest : str
            The digest; None is returned where there is nothing of it.
        """
        scene = self.scene
        if scene.digest != digest or scene.field is None:
            return self.files.get(("textures", digest))  # type: ignore[no-any-return]
        found: CovarianceField = scene.field
        return self.files.made(
            ("textures", digest),
            lambda: textures_of(found),
            lambda made: sum(each.values.nbytes for each in made.values()),
        )

    def layers(self) -> dict[str, Texture]:
        """The layers to choose from."""
        return dict(self.textures(self.scene.digest) or {})

    def add_download(self, name: str, content: bytes, media_type: str) -> str:
        """Keep a file for the page to fetch, and return its key.

        Parameters
        ----------
        name, media_type : str
            Name under which the browser saves it, and the type of its content.
        content : bytes
            The content.
        """
        key = secrets.token_urlsafe(16)
        self.files.put(("download", key), Download(name, content, media_type), len(content))
        return key

    def download(self, key: str) -> Download | None:
        """A file that was kept; None without it.

        Parameters
        ----------
        key : str
            Its key, from `add_download`.
        """
        return self.files.get(("download", key))  # type: ignore[no-any-return]

    def prepare(self) -> None:
        """Find the first ends and load the kernels, while the browser loads the page."""
        with suppress(LocplanError):  # the page's own questions tell what is wrong
            self.state()
        AnyAngle().prepare()
        Flood.prepare()

    def about(self) -> dict[str, Any]:
        """The map, and what can be chosen and done, fit for JSON."""
        from locplan.app.explorer.state import about

        return dict(about(self))

    def state(self) -> dict[str, Any]:
        """The field, the layers, the ends and the work in the background, fit for JSON."""
        from locplan.app.explorer.state import state

        return dict(state(self))

    def answer(
        self, do: str, *, progress: Callable[..., None] | None = None, **values: Any
    ) -> dict[str, Any]:
        """The answer to a question as the page gets it, fit for JSON.

        Parameters
        ----------
        do : str
            Name of the question.
        progress : callable, optional
            Called with (done, total), and perhaps what is done; what it raises ends the work.
        **values
            What the question says.

        Raises
        ------
        LocplanError
            If a value is out of its range.
        """
        work = Work(progress or (lambda *_: None), Cancel())
        from locplan.app.explorer.questions import QUESTIONS

        return finite(QUESTIONS[do].answer(self, Ask(do, 0, values), work))
