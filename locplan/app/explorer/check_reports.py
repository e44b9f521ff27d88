"""The report of a check, with its places, routes and fixes."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path as Folder
from typing import TYPE_CHECKING, Any, ClassVar

from locplan._support.checks import file_path
from locplan._support.reading import MAX_BYTES, document, read_content
from locplan._support.runs import RUN_FILE, Run
from locplan._support.tables import file_name
from locplan.app.explorer.scene import rounded
from locplan.errors import ConfigError, LocplanError
from locplan.field.config import COARSE_STRIDE
from locplan.maps.files import load_map
from locplan.planning.costmap import Costmap
from locplan.planning.path import Path
from locplan.planning.plans import plan
from locplan.planning.protocol import Position
from locplan.robots.robot import Robot

if TYPE_CHECKING:
    from locplan.app.explorer.requests import Ask, Work
    from locplan.app.explorer.session import Session


@dataclass(frozen=True, eq=False)
class CheckReport:
    """What `locplan check` has written into a folder."""

    folder: Folder
    """The folder."""
    about: Mapping[str, Any]
    """Content of its check.json, see `Check.summary`."""
    map_file: Folder
    """The map: that of the check, or the one that it wrote with the right threshold."""
    robot: Robot
    """The robot that was checked."""
    stride: ClassVar[float] = COARSE_STRIDE
    """Spacing of the field that a check takes, which is in the cache then [m]."""

    @classmethod
    def read(cls, path: str | os.PathLike[str]) -> CheckReport:
        """Read the folder of a report.

        Parameters
        ----------
        path : path
            The folder.

        Raises
        ------
        LocplanError
            If it is none, is damaged, or its map is gone or another one by now.
        """
        folder = Folder(file_path("a report", path))
        file, remedy = folder / "check.json", "name the folder that locplan check -o has written"
        for each in (file, folder / RUN_FILE):
            if not each.is_file():
                raise LocplanError(f"{folder}: has no {each.name}; {remedy}")
        about = document(file, read_content(file, MAX_BYTES, remedy), remedy)
        run = Run.read(folder)
        try:
            robot = Robot.from_summary(about["robot"])
            digest, named = about["map"]["digest"], run.settings["map"]
            recommended = [*about["recommended"]]
            _check_shown(about)
        except (LookupError, TypeError, ConfigError):
            raise LocplanError(f"{file}: is damaged, or of another locplan; check again") from None
        own = Folder(str(named))
        grid = load_map(own)
        if grid.digest != digest:
            raise LocplanError(f"{own}: has changed since {folder} was written; check it again")
        read_right = folder / "map.yaml"
        is_other = "walls" in recommended and read_right.is_file()
        return cls(folder, about, read_right if is_other else own, robot)

    @property
    def ends(self) -> dict[str, Position]:
        """Start and goal of the first route, on which most drives fail."""
        worst = self.about["routes"][0]
        return {name: tuple(worst[name]) for name in ("start", "goal")}

    def chosen(self, route: str) -> Path | None:
        """The path to take of a route, where the check recommends another one than the shortest.

        Parameters
        ----------
        route : str
            Name of the route.
        """
        file = self.folder / f"{file_name(route)}.csv"
        return Path.load(file) if "paths" in self.about["recommended"] and file.is_file() else None


def _check_shown(about: Mapping[str, Any]) -> None:
    """Raise a LookupError or a TypeError if something is missing that the page shows."""
    for each in about["routes"]:
        _ = each["name"], each["lost"][0], each["reached"][0], each["start"][1], each["goal"][1]
    for each in about["weak_spots"]:
        _ = each["letter"], each["x"], each["y"]
    for each in about["fixes"]:
        _ = each["kind"], each["lost"], each["title"]
    _ = about["routes"][0], about["next"]["sentence"], about["baseline"]


def checked(session: Session, ask: Ask, work: Work) -> dict[str, object]:
    """Answer the ask for the report that the page opened on, with the paths of its routes."""
    report = session.opening.report
    if report is None:
        raise ConfigError("there is no report; start the explorer with --check FOLDER")
    about = report.about
    costs = Costmap.blank(session.original, robot=report.robot)
    routes = []
    for number, each in enumerate(about["routes"]):
        work.progress(number, len(about["routes"]))
        shortest = plan(costs, each["start"], each["goal"], planner="any-angle").path
        paths = {"xy": shortest, "chosen": report.chosen(each["name"])}
        routes.append({**each, **{name: path and rounded(path.xy) for name, path in paths.items()}})
    poles = report.folder / "landmarks.csv"
    has_poles = "landmarks" in about["recommended"] and poles.is_file()
    return {
        "spots": about["weak_spots"],
        "routes": routes,
        "fixes": about["fixes"],
        "recommended": about["recommended"],
        "baseline": about["baseline"],
        "next": about["next"]["sentence"],
        "poles": rounded(Path.load(poles).xy) if has_poles else [],
    }
