"""The drive of a robot by the planner of Nav2 that is in use."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

from locplan._util.checks import number, shown
from locplan._util.reading import read_text
from locplan.errors import ConfigError, LocplanError
from locplan.robots._parameters import PLANNER_SERVER, Nav2Parameters
from locplan.robots._parts import Kinematics

DEFAULT_PLANNER = "GridBased"
"""The planner of Nav2's default behaviour trees."""
DEFAULT_TYPE = "nav2_navfn_planner::NavfnPlanner"
"""The type that Nav2 gives to GridBased if it is the only planner and has none."""
DEFAULT_LATTICE = "0.5m_turning_radius/ackermann/output.json"
"""The end of SmacPlannerLattice's default file."""
MAX_LATTICE_BYTES = 2**24


def planner_types(parameters: Nav2Parameters) -> dict[str, str]:
    """Return the plugin types of the planners by name, as the files have them.

    As in Nav2, GridBased is the only planner if `planner_plugins` is missing, and then needs no
    type. Empty if the files have nothing of a planner.

    Parameters
    ----------
    parameters : Nav2Parameters
        The parameters.
    """
    server = parameters.of(PLANNER_SERVER)
    has_default = any(name.startswith(f"{DEFAULT_PLANNER}.") for name in server)
    default = (DEFAULT_PLANNER,) if has_default and "planner_plugins" not in server else ()
    names = parameters.names(PLANNER_SERVER, "planner_plugins", default)
    missing = DEFAULT_TYPE if names == [DEFAULT_PLANNER] else ""
    return {name: str(server.get(f"{name}.plugin", missing)) for name in names}


def planner_drives(parameters: Nav2Parameters) -> dict[str, Kinematics | None]:
    """Return the drives of the planners by name; None is that of a planner without motion model.

    Parameters
    ----------
    parameters : Nav2Parameters
        The parameters.

    Raises
    ------
    ConfigError
        If a turning radius is out of its range.
    """
    return {name: _drive(parameters, name) for name in planner_types(parameters)}


def planner_in_use(parameters: Nav2Parameters, named: str | None = None) -> str | None:
    """Return the planner that the user names, else GridBased, else the first one; None without any.

    Parameters
    ----------
    parameters : Nav2Parameters
        The parameters.
    named : str, optional
        The planner's name in them.

    Raises
    ------
    ConfigError
        If there is no planner of this name.
    """
    names = [*planner_types(parameters)]
    if named is not None and named not in names:
        known = f"its planners are {', '.join(names)}" if names else "they list no planner"
        raise ConfigError(f"Nav2's parameters have no planner {shown(named)}; {known}")
    usual = DEFAULT_PLANNER if DEFAULT_PLANNER in names else next(iter(names), None)
    return usual if named is None else named


def describe_drive(drive: Kinematics) -> str:
    """Return a drive in a few words.

    Parameters
    ----------
    drive : Kinematics
        The drive.
    """
    if drive.drive != "car-like":
        return drive.drive
    reverse = "" if drive.reverse else ", forwards only"
    return f"car-like with a turning radius of {drive.turning_radius:g} m{reverse}"


def unread_lattice(parameters: Nav2Parameters, planner: str) -> str | None:
    """Return the lattice file of a planner if its motion model is not known, else None.

    Parameters
    ----------
    parameters : Nav2Parameters
        The parameters.
    planner : str
        The planner's name.
    """
    is_lattice = _kind(parameters.of(PLANNER_SERVER), planner) == "SmacPlannerLattice"
    return (
        _lattice_path(parameters, planner)
        if is_lattice and not _lattice(parameters, planner)
        else None
    )


def _kind(own: dict[str, Any], planner: str) -> str:
    """Type of a planner, of both spellings, without its package."""
    return str(own.get(f"{planner}.plugin", "")).replace("/", "::").rpartition("::")[2]


def _drive(parameters: Nav2Parameters, planner: str) -> Kinematics | None:
    own = parameters.of(PLANNER_SERVER)
    kind = _kind(own, planner)
    if kind in ("SmacPlannerHybrid", "SmacPlanner"):  # the latter up to foxy
        model = own.get(f"{planner}.motion_model_for_search", "DUBIN")
        if model in ("DUBIN", "REEDS_SHEPP"):  # the latter drives in reverse, too
            radius = own.get(f"{planner}.minimum_turning_radius", 0.4)
            reverse = model == "REEDS_SHEPP"
            return Kinematics(drive="car-like", turning_radius=radius, reverse=reverse)
    if kind == "SmacPlannerLattice" and (lattice := _lattice(parameters, planner)):
        model, radius = lattice
        if model == "ackermann":
            reverse = own.get(f"{planner}.allow_reverse_expansion") is True
            return Kinematics(drive="car-like", turning_radius=radius, reverse=reverse)
        return Kinematics(drive="omnidirectional" if model == "omni" else "differential")
    return None


def _lattice_path(parameters: Nav2Parameters, planner: str) -> str:
    return str(parameters.of(PLANNER_SERVER).get(f"{planner}.lattice_filepath", DEFAULT_LATTICE))


def _lattice(parameters: Nav2Parameters, planner: str) -> tuple[str, float] | None:
    """Motion model and turning radius of a lattice planner's file, or those in the file's name."""
    text = _lattice_path(parameters, planner)
    value = parameters.values(PLANNER_SERVER).get(f"{planner}.lattice_filepath")
    file = parameters.files[value.file].path if value else None
    folder = file.parent if file else Path()
    for path in (folder / text, folder / Path(text).name) if value else ():
        try:
            metadata = json.loads(read_text(path, MAX_LATTICE_BYTES))["lattice_metadata"]
            model, radius = metadata["motion_model"], metadata["turning_radius"]
            if model in ("ackermann", "diff", "omni"):
                return str(model), number("turning_radius", radius, 0.0)
        except (LocplanError, OSError, ValueError, KeyError, TypeError, RecursionError):
            continue
    named = re.search(r"(\d+(?:\.\d+)?)m_turning_radius/(ackermann|diff|omni)\b", text)
    return (named[2], float(named[1])) if named else None
