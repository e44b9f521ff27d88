"""Reports of `locplan check`, with their routes and fixes."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path as Folder
from typing import TYPE_CHECKING, Any

import numpy as np

from locplan._support.checks import check_file_path
from locplan._support.reading import MAX_BYTES, check_file_stamp, parse_yaml, read_content
from locplan._support.runs import RUN_FILE, RunRecord
from locplan._support.tables import make_file_name
from locplan.advice.check_result import Check
from locplan.app.explorer.messages import format_sentence
from locplan.errors import ConfigError, LocplanError
from locplan.maps.files import load_map
from locplan.planning.costmap import Costmap
from locplan.planning.path import Path
from locplan.planning.plans import plan
from locplan.planning.protocol import Position
from locplan.robots.robot import Robot

if TYPE_CHECKING:
    from locplan.app.explorer.messages import Question, QuestionJob
    from locplan.app.explorer.scene import MapScene
    from locplan.app.explorer.session import Session


@dataclass(frozen=True, eq=False)
class CheckReport:
    """Report that `locplan check` wrote into a folder."""

    folder: Folder
    """The folder."""
    facts: Mapping[str, Any]
    """Content of its check.json, see `Check.summary`."""
    map_file: Folder
    """The checked map, or the corrected one that the check wrote."""
    robot: Robot
    """The robot that was checked."""

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
            If the folder has no valid report, or its map has changed or is missing.
        """
        folder = Folder(check_file_path("a report", path))
        file, remedy = folder / "check.json", "name a folder that `locplan check -o` wrote"
        for required_file in (file, folder / RUN_FILE):
            if not required_file.is_file():
                raise LocplanError(f"{folder}: has no {required_file.name}; {remedy}")
        facts = parse_yaml(file, read_content(file, MAX_BYTES, remedy), remedy)
        run = RunRecord.read(folder)
        try:
            robot = Robot.from_summary(facts["robot"])
            digest, map_name = facts["map"]["digest"], run.settings["map"]
            recommended = [*facts["recommended"]]
            _check_facts(facts)
        except (LookupError, TypeError, ConfigError):
            raise LocplanError(
                f"{file}: is damaged or from another version; run `locplan check` again"
            ) from None
        check_file_stamp(file, facts, Check.files.kind, Check.version)
        map_folder = Folder(str(map_name))
        if load_map(map_folder).digest != digest:
            raise LocplanError(
                f"{map_folder}: has changed since {folder} was written; run `locplan check` again"
            )
        repaired_map = folder / "map.yaml"
        is_repaired = "walls" in recommended and repaired_map.is_file()
        return cls(folder, facts, repaired_map if is_repaired else map_folder, robot)

    @property
    def first_route_ends(self) -> dict[str, Position]:
        """Start and goal of the first route, where most drives fail."""
        worst = self.facts["routes"][0]
        return {name: tuple(worst[name]) for name in ("start", "goal")}

    def recommended_path(self, route: str) -> Path | None:
        """Return the recommended path of a route if it is not the shortest one.

        Parameters
        ----------
        route : str
            Name of the route.
        """
        file = self.folder / f"{make_file_name(route)}.csv"
        return Path.load(file) if "paths" in self.facts["recommended"] and file.is_file() else None

    @property
    def poles(self) -> list[list[float]]:
        """Positions of the recommended landmarks [m]."""
        file = self.folder / "landmarks.csv"
        has_poles = "landmarks" in self.facts["recommended"] and file.is_file()
        return _round_positions(Path.load(file)) if has_poles else []


def _check_facts(facts: Mapping[str, Any]) -> None:
    """Raise a LookupError or a TypeError if the page would miss a value."""
    for route in facts["routes"]:
        _ = route["name"], route["lost"][0], route["reached"][0], route["problem"]
        _ = route["start"][1], route["goal"][1]
    for spot in facts["weak_spots"]:
        _ = spot["letter"], spot["x"], spot["y"], spot["missing"], spot["position_std"]
    for fix in facts["fixes"]:
        _ = fix["kind"], fix["lost"], fix["title"]
    _ = facts["version"], facts["routes"][0], facts["next"]["sentence"], facts["baseline"]


def describe_report(
    session: Session, scene: MapScene, question: Question, job: QuestionJob
) -> dict[str, object]:
    """Return the report of the session, with the paths of its routes."""
    report = session.opening.report
    if report is None:
        raise ConfigError("the page has no report; open it on the folder of a check")
    facts = report.facts
    costs = Costmap.blank(session.original.grid, robot=report.robot)
    routes = []
    for number, route in enumerate(facts["routes"]):
        job.progress(number, len(facts["routes"]))
        shortest = plan(costs, route["start"], route["goal"], planner="any-angle").path
        recommended = report.recommended_path(route["name"])
        paths = {
            "xy": _round_positions(shortest),
            "chosen": recommended and _round_positions(recommended),
        }
        routes.append({**route, "title": route["problem"], **paths})
    # The report is valid for the map and the robot before any change.
    basis = {**scene.basis, **session.original.digests, "route": None}
    return {
        "basis": basis,
        "routes": routes,
        "fixes": facts["fixes"],
        "recommended": facts["recommended"],
        "baseline": facts["baseline"],
        "next": format_sentence(facts["next"]["sentence"].removesuffix(":")),
        "poles": report.poles,
    }


def _round_positions(path: Path | None) -> list[list[float]]:
    """Return the positions of a path, to a millimetre [m]."""
    values: list[list[float]] = [] if path is None else np.round(path.xy, 3).tolist()
    return values
