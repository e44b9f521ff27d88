"""The files of the fixes of a check: maps, parameters, a mask, paths, and where poles go."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path as Folder
from typing import TypeAlias

from locplan._support.tables import write_rows
from locplan.advice.check_result import Check
from locplan.advice.fixes import LANDMARKS, MEND, PATHS, REACH, SETTINGS, WALLS
from locplan.export.nav2 import nav2_keepout
from locplan.export.parameters import write_merged
from locplan.export.servers import write_filter_map
from locplan.maps.files import corrected_yaml, save_map
from locplan.robots.parameters import read_parameters
from locplan.simulation.amcl_parameters import write_tuned

Params: TypeAlias = Folder | str | Sequence[Folder] | None
"""The user's parameter files of Nav2."""


def describe_fix_files(check: Check, params: Params = ()) -> dict[str, str]:
    """The files of the recommended fixes, and what to do with each; see `Check.written`."""
    values, params = "put its lines under amcl in yours", as_files(params)
    if {REACH, SETTINGS} & {*check.recommended} and has_amcl(params):
        values = "your parameters, changed"
        if len(params) > 1:
            file_names = " and ".join(parameter_path.name for parameter_path in params)
            values = f"{file_names} in one file, changed"
    mask = {"mask/nav2.yaml": "parameters with the mask's; see mask/README.md for its planner"}
    texts_by_kind = {
        WALLS: {"map.yaml": f"the map for all of Nav2, with {check.reading.title}"},
        MEND: {"map_amcl.yaml": "for AMCL alone: put amcl.yaml's line under amcl in yours"},
        REACH: {"nav2_params.yaml": values},
        SETTINGS: {"nav2_params.yaml": values},
        PATHS: mask
        if check.artifacts.get(PATHS)
        else dict.fromkeys(check.changed_paths, "the path of a route, to follow or to export"),
        LANDMARKS: {"landmarks.csv": "where each pole goes"},
    }
    return {file: text for kind in check.recommended for file, text in texts_by_kind[kind].items()}


def as_files(params: Params) -> list[Folder]:
    """Return the parameter files, of which there may be one, several or none."""
    if isinstance(params, Folder | str):
        return [Folder(params)]
    return [*params] if params else []


def has_amcl(params: Sequence[Folder]) -> bool:
    """True if one of the user's parameter files is that of AMCL."""
    return bool(read_parameters(*params).read_node_parameters("amcl"))


def write_files(folder: Folder, check: Check, params: Params) -> None:
    """Write the files of the recommended fixes.

    Parameters
    ----------
    folder : path
        The folder.
    check : Check
        The check.
    params : path, sequence of path or None
        The user's parameters of Nav2, of which a copy is changed: one file, since nav2_bringup
        takes one.
    """
    kinds, reading, parameter_file = (
        {*check.recommended},
        check.reading,
        folder / "nav2_params.yaml",
    )
    params = base = as_files(params)
    if kinds & {REACH, SETTINGS} and has_amcl(params):
        if len(params) > 1:
            write_merged(parameter_file, params)
            base = [parameter_file]
        write_tuned(parameter_file, check.fixed_site.robot.amcl, base[0])
        base = [parameter_file]
    elif kinds & {REACH, SETTINGS}:
        write_tuned(parameter_file, check.fixed_site.robot.amcl)
    if WALLS in kinds and check.source:
        (folder / "map.yaml").write_text(corrected_yaml(check.source, reading.lengths), "utf-8")
    elif WALLS in kinds:
        save_map(reading.in_metres(reading.grid), folder / "map.yaml")
    if MEND in kinds:
        filter_map = check.fixed_site.filter_map
        write_filter_map(folder, reading.in_metres(filter_map) if WALLS in kinds else filter_map)
    if LANDMARKS in kinds:
        placed = check.artifacts[LANDMARKS]
        write_rows(folder / "landmarks.csv", ("x", "y"), placed.poses[:, :2].tolist())
        save_map(placed.grid, folder / "map_with_landmarks.yaml")
    if PATHS in kinds:
        for name, path in check.changed_paths.items():
            path.save(folder / name)
        if mask := check.artifacts.get(PATHS):
            ways = {
                file.removesuffix(".csv"): route_path
                for file, route_path in check.changed_paths.items()
            }
            nav2_keepout(folder / "mask", mask, params=base, paths=ways)
