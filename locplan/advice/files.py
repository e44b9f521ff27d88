"""Files of a check's recommended fixes: maps, parameters, a mask, paths, and poles."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path as Folder
from typing import TypeAlias

from locplan._support.files import write_text
from locplan._support.tables import write_csv_rows
from locplan.advice.check_result import Check
from locplan.advice.fixes import CORRECTED_MAP, FULL_RANGE, LANDMARKS, PATHS, REPAIRED_MAP, SETTINGS
from locplan.export.nav2 import nav2_keepout
from locplan.export.parameters import write_merged_parameters
from locplan.export.servers import write_filter_map
from locplan.maps.files import format_corrected_yaml, save_map
from locplan.robots.parameters import read_parameters
from locplan.simulation.amcl_parameters import write_tuned_parameters

Params: TypeAlias = Folder | str | Sequence[Folder] | None
"""The user's parameter files of Nav2."""


def describe_fix_files(check: Check, params: Params = ()) -> dict[str, str]:
    """Return the purpose of each file of the recommended fixes."""
    values, params = (
        "copy its lines into the amcl section of your parameters",
        list_parameter_files(params),
    )
    if {FULL_RANGE, SETTINGS} & {*check.recommended} and has_amcl_section(params):
        values = "your parameters with the changes"
        if len(params) > 1:
            file_names = " and ".join(parameter_path.name for parameter_path in params)
            values = f"{file_names} merged, with the changes"
    mask = {"mask/nav2.yaml": "parameters with the mask; mask/README.md explains its planner"}
    texts_by_kind = {
        CORRECTED_MAP: {"map.yaml": f"the corrected map for Nav2: {check.correction.title}"},
        REPAIRED_MAP: {
            "map_amcl.yaml": "for AMCL only: copy the line of amcl.yaml into your parameters"
        },
        FULL_RANGE: {"nav2_params.yaml": values},
        SETTINGS: {"nav2_params.yaml": values},
        PATHS: mask
        if check.artifacts.get(PATHS)
        else dict.fromkeys(check.changed_paths, "the path of a route, to follow or to export"),
        LANDMARKS: {"landmarks.csv": "position of each pole"},
    }
    return {file: text for kind in check.recommended for file, text in texts_by_kind[kind].items()}


def list_parameter_files(params: Params) -> list[Folder]:
    """Return the parameter files as a list."""
    if isinstance(params, Folder | str):
        return [Folder(params)]
    return [*params] if params else []


def has_amcl_section(params: Sequence[Folder]) -> bool:
    """True if one of the parameter files has an amcl section."""
    return bool(read_parameters(*params).read_node_parameters("amcl"))


def write_fix_files(folder: Folder, check: Check, params: Params) -> None:
    """Write the files of the recommended fixes.

    Parameters
    ----------
    folder : path
        The folder.
    check : Check
        The check.
    params : path, sequence of path or None
        The user's Nav2 parameters. Their merged copy is changed: nav2_bringup takes one file.
    """
    kinds, correction, parameter_file = (
        {*check.recommended},
        check.correction,
        folder / "nav2_params.yaml",
    )
    params = base = list_parameter_files(params)
    if kinds & {FULL_RANGE, SETTINGS} and has_amcl_section(params):
        if len(params) > 1:
            write_merged_parameters(parameter_file, params)
            base = [parameter_file]
        write_tuned_parameters(parameter_file, check.fixed_scenario.robot.amcl, base[0])
        base = [parameter_file]
    elif kinds & {FULL_RANGE, SETTINGS}:
        write_tuned_parameters(parameter_file, check.fixed_scenario.robot.amcl)
    if CORRECTED_MAP in kinds and check.source:
        write_text(
            folder / "map.yaml", format_corrected_yaml(check.source, correction.corrected_lengths)
        )
    elif CORRECTED_MAP in kinds:
        save_map(correction.rescale(correction.grid), folder / "map.yaml")
    if REPAIRED_MAP in kinds:
        filter_map = check.fixed_scenario.filter_map
        write_filter_map(
            folder, correction.rescale(filter_map) if CORRECTED_MAP in kinds else filter_map
        )
    if LANDMARKS in kinds:
        placed = check.artifacts[LANDMARKS]
        write_csv_rows(folder / "landmarks.csv", ("x", "y"), placed.poses[:, :2].tolist())
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
