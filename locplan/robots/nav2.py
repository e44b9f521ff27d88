"""A robot in Nav2's parameters: filter, outline, drive, planner and costmap layers."""

from __future__ import annotations

import dataclasses
import json
import os
import re
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from locplan._support.checks import check_number, check_positive, short_repr
from locplan._support.reading import read_text
from locplan.errors import ConfigError, LocplanError, format_one_line
from locplan.robots.amcl import (
    DIFFERENTIAL,
    MODELS,
    NOT_SIMULATED,
    OMNIDIRECTIONAL,
    SIMULATED,
    Amcl,
)
from locplan.robots.parameters import (
    AMCL,
    GLOBAL_COSTMAP,
    LOCAL_COSTMAP,
    PLANNER_SERVER,
    Nav2Parameters,
    read_parameters,
)
from locplan.robots.parts import Footprint, Inflation, Kinematics

DEFAULT_TYPES = {
    "static_layer": "nav2_costmap_2d::StaticLayer",
    "obstacle_layer": "nav2_costmap_2d::ObstacleLayer",
    "inflation_layer": "nav2_costmap_2d::InflationLayer",
}
"""Nav2's default layers in their order, with the types that it gives to just this list
(costmap_2d_ros.cpp, from humble on)."""


class CostmapLayer(NamedTuple):
    """A layer of a costmap."""

    name: str
    """Name in the costmap's parameters, such as inflation_layer or container.inflation_layer."""
    plugin: str
    """Type of the plugin; empty if the parameters do not have it."""
    enabled: Any
    """True if it is enabled; the placeholder's text if a launch file replaces it."""
    container: str = ""
    """Name of the PluginContainerLayer that holds it, if one does."""

    def is_active(self, kind: str) -> bool:
        """True if the layer is not disabled and its plugin has this class name."""
        return self.enabled is not False and self.plugin.rpartition("::")[2] == kind


def list_costmap_layers(parameters: Nav2Parameters, costmap: str) -> list[CostmapLayer]:
    """Return the layers of a costmap, those in containers included; none without the costmap.

    Parameters
    ----------
    parameters : Nav2Parameters
        The parameters.
    costmap : str
        Name of the costmap's node.
    """
    costmap_parameters = parameters.read_node_parameters(costmap)
    is_named = any(not section.is_shared for _, section in parameters.find_sections(costmap))
    if "plugins" not in costmap_parameters and not is_named:
        return []
    names = parameters.read_names(
        costmap, "plugins", () if "plugins" in costmap_parameters else (*DEFAULT_TYPES,)
    )
    types = DEFAULT_TYPES if names == [*DEFAULT_TYPES] else {}

    def read_layer(name: str, container: str = "") -> CostmapLayer:
        plugin = str(costmap_parameters.get(f"{name}.plugin", types.get(name, ""))).replace(
            "/", "::"
        )
        return CostmapLayer(
            name, plugin, costmap_parameters.get(f"{name}.enabled", True), container
        )

    layers = []
    for outer in map(read_layer, names):
        layers.append(outer)
        if outer.is_active("PluginContainerLayer"):
            inner = parameters.read_names(costmap, f"{outer.name}.plugins")
            layers += [read_layer(f"{outer.name}.{name}", outer.name) for name in inner]
    return layers


def find_inflating_layer(parameters: Nav2Parameters) -> str | None:
    """Return the name of the layer that inflates the global costmap's walls, or None.

    Layers update the costs in their order, so that a layer inflates only the layers before it. A
    layer in a container inflates only the layers in it, so that the map's layer must be in the same
    container.

    Parameters
    ----------
    parameters : Nav2Parameters
        The parameters.
    """
    layers = list_costmap_layers(parameters, GLOBAL_COSTMAP)
    for at, layer in enumerate(layers):
        if layer.is_active("InflationLayer") and not _inflates_no_walls(layers, at):
            return layer.name
    return None


def _inflates_no_walls(layers: list[CostmapLayer], layer_index: int) -> bool:
    """True if the map's layer is not before a layer, or not in its container.

    Outside of containers, a costmap without a StaticLayer may have walls of a layer of another
    type.
    """
    container = layers[layer_index].container
    walls = [n for n, layer in enumerate(layers) if layer.is_active("StaticLayer")]
    if container:
        return not any(n < layer_index and layers[n].container == container for n in walls)
    return bool(walls) and min(walls) > layer_index


def list_layer_notes(parameters: Nav2Parameters) -> Iterator[str]:
    """Yield sentences about layers that Nav2 rejects, and about layers that inflate no walls.

    Parameters
    ----------
    parameters : Nav2Parameters
        The parameters.
    """
    layers = list_costmap_layers(parameters, GLOBAL_COSTMAP)
    if missing := [costmap_layer.name for costmap_layer in layers if not costmap_layer.plugin]:
        plugin_names = ", ".join(
            costmap_layer.name for costmap_layer in layers if not costmap_layer.container
        )
        yield (
            f"Nav2 refuses the plugins of global_costmap ({plugin_names}), since"
            f" {', '.join(missing)}"
            f" {'has' if len(missing) == 1 else 'have'} no plugin type; add it, or list just Nav2's"
            " default layers"
        )
    inflating = find_inflating_layer(parameters)
    for layer in layers:
        if inflating is not None or not layer.is_active("InflationLayer"):
            continue
        if layer.container:
            yield (
                f"{layer.name} inflates only the layers before it in {layer.container}, and no"
                " StaticLayer is among them: the map's walls are not inflated"
            )
        else:
            yield (
                f"{layer.name} stands before the StaticLayer in plugins: the map's walls are not"
                " inflated; list it last"
            )


def list_zone_notes(parameters: Nav2Parameters) -> Iterator[str]:
    """Yield sentences about keepout and speed filters, whose zones are not known.

    The masks that locplan exports are none.

    Parameters
    ----------
    parameters : Nav2Parameters
        The parameters.
    """
    kinds = {
        "KeepoutFilter": "keeps the robot out of zones",
        "SpeedFilter": "limits the robot's speed in zones",
    }
    reported = set()
    for costmap in (GLOBAL_COSTMAP, LOCAL_COSTMAP):
        costmap_parameters = parameters.read_node_parameters(costmap)
        for name in (
            name
            for key in ("filters", "plugins")
            for name in _list_strings(costmap_parameters.get(key))
        ):
            kind = (
                str(costmap_parameters.get(f"{name}.plugin")).replace("/", "::").rpartition("::")[2]
            )
            enabled = costmap_parameters.get(f"{name}.enabled", True)
            is_locplan_filter = name.startswith("localizability_")
            if (
                kind in kinds
                and kind not in reported
                and enabled is not False
                and not is_locplan_filter
            ):
                reported.add(kind)
                sentence = f"{name} {kinds[kind]} that `plan` and `check` do not know"
                if kind == "KeepoutFilter":
                    sentence += "; give its mask to `plan` with --zones"
                if isinstance(enabled, str):
                    yield f"If your launch enables it (enabled: {short_repr(enabled)}), {sentence}"
                else:
                    yield f"{costmap.partition('/')[0]}: {sentence}"


def _list_strings(value: Any) -> list[str]:
    """Return the texts in a value that may be a list."""
    return [text for text in value if isinstance(text, str)] if isinstance(value, list) else []


DEFAULT_PLANNER = "GridBased"
"""The planner of Nav2's default behaviour trees."""
DEFAULT_TYPE = "nav2_navfn_planner::NavfnPlanner"
"""The type that Nav2 gives to GridBased if it is the only planner and has none."""
DEFAULT_LATTICE = "0.5m_turning_radius/ackermann/output.json"
"""The end of SmacPlannerLattice's default file."""
MAX_LATTICE_BYTES = 2**24


def read_planner_types(parameters: Nav2Parameters) -> dict[str, str]:
    """Return the plugin types of the planners by name, as the files have them.

    As in Nav2, GridBased is the only planner if `planner_plugins` is missing, and then needs no
    type. Empty if the files have nothing of a planner.

    Parameters
    ----------
    parameters : Nav2Parameters
        The parameters.
    """
    server = parameters.read_node_parameters(PLANNER_SERVER)
    has_default = any(name.startswith(f"{DEFAULT_PLANNER}.") for name in server)
    default = (DEFAULT_PLANNER,) if has_default and "planner_plugins" not in server else ()
    names = parameters.read_names(PLANNER_SERVER, "planner_plugins", default)
    missing = DEFAULT_TYPE if names == [DEFAULT_PLANNER] else ""
    return {name: str(server.get(f"{name}.plugin", missing)) for name in names}


def read_planner_drives(parameters: Nav2Parameters) -> dict[str, Kinematics | None]:
    """Return the drives of the planners by name; None for a planner without motion model.

    Parameters
    ----------
    parameters : Nav2Parameters
        The parameters.

    Raises
    ------
    ConfigError
        If a turning radius is out of its range.
    """
    return {name: _read_drive(parameters, name) for name in read_planner_types(parameters)}


def find_active_planner(
    parameters: Nav2Parameters, requested_name: str | None = None
) -> str | None:
    """Return the planner that the user names, otherwise GridBased or the first; None without any.

    Parameters
    ----------
    parameters : Nav2Parameters
        The parameters.
    requested_name : str, optional
        The planner's name in them.

    Raises
    ------
    ConfigError
        If there is no planner of this name.
    """
    names = [*read_planner_types(parameters)]
    if requested_name is not None and requested_name not in names:
        planner_list = f"its planners are {', '.join(names)}" if names else "they list no planner"
        raise ConfigError(
            f"Nav2's parameters have no planner {short_repr(requested_name)}; {planner_list}"
        )
    default_name = DEFAULT_PLANNER if DEFAULT_PLANNER in names else next(iter(names), None)
    return default_name if requested_name is None else requested_name


def describe_drive(drive: Kinematics) -> str:
    """Describe a drive in a few words.

    Parameters
    ----------
    drive : Kinematics
        The drive.
    """
    if drive.drive != "car-like":
        return drive.drive
    reverse = "" if drive.reverse else ", forwards only"
    return f"car-like with a turning radius of {drive.turning_radius:g} m{reverse}"


def find_unknown_lattice_file(parameters: Nav2Parameters, planner: str) -> str | None:
    """Return the lattice file of a planner if its motion model is unknown, otherwise None.

    Parameters
    ----------
    parameters : Nav2Parameters
        The parameters.
    planner : str
        The planner's name.
    """
    is_lattice = (
        _get_planner_class_name(parameters.read_node_parameters(PLANNER_SERVER), planner)
        == "SmacPlannerLattice"
    )
    return (
        _read_lattice_path(parameters, planner)
        if is_lattice and not _read_lattice_drive(parameters, planner)
        else None
    )


def _get_planner_class_name(server_parameters: dict[str, Any], planner: str) -> str:
    """Return the type of a planner without its package, whichever separator it uses."""
    return (
        str(server_parameters.get(f"{planner}.plugin", "")).replace("/", "::").rpartition("::")[2]
    )


def _read_drive(parameters: Nav2Parameters, planner: str) -> Kinematics | None:
    """Read the drive that a planner plans for; None for a planner without motion model."""
    server_parameters = parameters.read_node_parameters(PLANNER_SERVER)
    kind = _get_planner_class_name(server_parameters, planner)
    if kind in ("SmacPlannerHybrid", "SmacPlanner"):  # the latter up to foxy
        model = server_parameters.get(f"{planner}.motion_model_for_search", "DUBIN")
        if model in ("DUBIN", "REEDS_SHEPP"):  # the latter also drives in reverse
            radius = server_parameters.get(f"{planner}.minimum_turning_radius", 0.4)
            reverse = model == "REEDS_SHEPP"
            return Kinematics(drive="car-like", turning_radius=radius, reverse=reverse)
    if kind == "SmacPlannerLattice" and (lattice := _read_lattice_drive(parameters, planner)):
        model, radius = lattice
        if model == "ackermann":
            reverse = server_parameters.get(f"{planner}.allow_reverse_expansion") is True
            return Kinematics(drive="car-like", turning_radius=radius, reverse=reverse)
        return Kinematics(drive="omnidirectional" if model == "omni" else "differential")
    return None


def _read_lattice_path(parameters: Nav2Parameters, planner: str) -> str:
    """Read the path of a planner's lattice file."""
    return str(
        parameters.read_node_parameters(PLANNER_SERVER).get(
            f"{planner}.lattice_filepath", DEFAULT_LATTICE
        )
    )


def _read_lattice_drive(parameters: Nav2Parameters, planner: str) -> tuple[str, float] | None:
    """Read motion model and turning radius from a planner's lattice file, or from its name."""
    text = _read_lattice_path(parameters, planner)
    value = parameters.find_values(PLANNER_SERVER).get(f"{planner}.lattice_filepath")
    file = parameters.files[value.file].path if value else None
    folder = file.parent if file else Path()
    for path in (folder / text, folder / Path(text).name) if value else ():
        try:
            metadata = json.loads(read_text(path, MAX_LATTICE_BYTES))["lattice_metadata"]
            model, radius = metadata["motion_model"], metadata["turning_radius"]
            if model in ("ackermann", "diff", "omni"):
                return str(model), check_number("turning_radius", radius, 0.0)
        except (LocplanError, OSError, ValueError, KeyError, TypeError, RecursionError):
            continue
    name_match = re.search(r"(\d+(?:\.\d+)?)m_turning_radius/(ackermann|diff|omni)\b", text)
    return (name_match[2], float(name_match[1])) if name_match else None


class ParameterWarning(UserWarning):
    """Warning that a robot's parameters are simulated in part only."""


def read_amcl(path: str | os.PathLike[str]) -> Amcl:
    """Read AMCL's parameters from a parameter file of Nav2.

    Warns of parameters in the file that are not simulated.

    Parameters
    ----------
    path : path
        YAML file with a node `amcl`; missing parameters have Nav2's defaults. If it has several
        robots, append the namespace of one, as in "nav2.yaml:robot1".

    Raises
    ------
    LocplanError
        If the file cannot be read, has no parameters of amcl, or a value is out of its range.
    """
    parameters = read_parameters(path)
    settings = _read_filter(parameters)
    if settings is None:
        raise LocplanError(f"{path}: has no parameters of amcl; give the file that starts it")
    for note in _list_filter_notes(parameters):
        warnings.warn(ParameterWarning(note), stacklevel=2)
    return Amcl(**settings)


def read_settings(parameters: Nav2Parameters, planner: str | None = None) -> dict[str, Any]:
    """Read a robot's settings from parameters of Nav2, by the names of `Robot`'s fields.

    Those of its filter and its inflation are mappings by the names of the settings.

    Parameters
    ----------
    parameters : Nav2Parameters
        The parameters.
    planner : str, optional
        Name of the active planner; by default GridBased or, without it, the first one.

    Raises
    ------
    ConfigError
        If a value is out of its range, or there is no such planner.
    """
    inflation = _read_inflation(parameters)
    settings = {
        "filter": _read_filter(parameters),
        **_read_outline(parameters),
        "inflation": inflation[1] if inflation else None,
        "kinematics": _read_kinematics(parameters, planner),
    }
    return {name: value for name, value in settings.items() if value is not None}


def list_parameter_notes(parameters: Nav2Parameters, planner: str | None = None) -> list[str]:
    """List sentences about parameters of Nav2 that are not simulated or contradict each other.

    Parameters
    ----------
    parameters : Nav2Parameters
        The parameters.
    planner : str, optional
        Name of the planner in use.
    """
    notes = [
        *_list_filter_notes(parameters),
        *_list_conflict_notes(parameters),
        *list_layer_notes(parameters),
        *_list_drive_notes(parameters, planner),
        *list_zone_notes(parameters),
    ]
    return [format_one_line(note) for note in notes]


def read_nav2_inflation(parameters: Nav2Parameters) -> tuple[str, Inflation, float] | None:
    """Read the global costmap's inflation layer: its name, settings and inscribed radius [m].

    None if no layer inflates. The radius is computed from the padded corners, 16 of a circle.

    Parameters
    ----------
    parameters : Nav2Parameters
        The parameters.

    Raises
    ------
    LocplanError
        If a value is out of its range.
    """
    inflation = _read_inflation(parameters)
    if inflation is None:
        return None
    layer, settings = inflation
    parts = {"footprint": 0.1, "margin": 0.01} | _read_outline(parameters)  # as Nav2 has them
    outline, padding = parts["footprint"], parts["margin"]
    if not isinstance(outline, Footprint):
        angles = np.arange(16) * 2 * np.pi / 16
        outline = Footprint(outline * np.column_stack([np.cos(angles), np.sin(angles)]))
    padded = outline.vertices + np.sign(outline.vertices) * padding
    return layer, Inflation(**settings), Footprint(padded).inscribed_radius


def _read_filter(parameters: Nav2Parameters) -> dict[str, Any] | None:
    """Read the settings of AMCL; None without any."""
    amcl_parameters = parameters.read_node_parameters(AMCL)
    settings = {name: value for name, value in amcl_parameters.items() if name in SIMULATED}
    if not settings and all(section.is_shared for _, section in parameters.find_sections(AMCL)):
        return None
    model = _normalize_motion_model(str(settings.pop("robot_model_type", DIFFERENTIAL)))
    if model in (DIFFERENTIAL, OMNIDIRECTIONAL):
        settings["robot_model_type"] = model
    laser = settings.get("laser_model_type")
    if isinstance(laser, str) and laser not in MODELS:  # as amcl_node.cpp has it, except "beam"
        settings["laser_model_type"] = MODELS[0]
    with name_parameter_in_errors(parameters, AMCL):
        Amcl(**settings)
    return settings


def _list_filter_notes(parameters: Nav2Parameters) -> Iterator[str]:
    """Yield a note about AMCL's parameters that are not simulated."""
    amcl_parameters, unshared_parameters = (
        parameters.read_node_parameters(AMCL),
        parameters.read_node_parameters(AMCL, shared=False),
    )
    laser = amcl_parameters.get("laser_model_type")
    if isinstance(laser, str) and laser not in MODELS:
        file = parameters.files[parameters.find_values(AMCL)["laser_model_type"].file].path
        yield (
            f"{file}: AMCL's beam model is not simulated; {MODELS[0]} is used instead"
            if laser == "beam"
            else f"{file}: AMCL has no laser_model_type {short_repr(laser)}; Nav2 takes {MODELS[0]}"
        )
    model = _normalize_motion_model(str(amcl_parameters.get("robot_model_type", DIFFERENTIAL)))
    foreign = model not in (DIFFERENTIAL, OMNIDIRECTIONAL)
    unknown = sorted(
        {name.partition(".")[0] for name in unshared_parameters} - SIMULATED - NOT_SIMULATED.keys()
    )
    if left_out := (
        *_list_unsimulated_parameters(amcl_parameters),
        *["robot_model_type"] * foreign,
        *unknown,
    ):
        values = parameters.find_values(AMCL)
        files = {
            parameter.file
            for name, parameter in values.items()
            if name.partition(".")[0] in left_out
        }
        file_names = ", ".join(str(parameters.files[at].path) for at in sorted(files))
        yield format_one_line(f"{file_names}: not simulated: {', '.join(left_out)}")


def _list_conflict_notes(parameters: Nav2Parameters) -> Iterator[str]:
    """Yield notes about parameters whose values for a wildcard and for a name differ."""
    for node in (AMCL, PLANNER_SERVER, GLOBAL_COSTMAP, LOCAL_COSTMAP):
        for conflict in parameters.find_conflicts(node):
            if node != AMCL or conflict.name in SIMULATED:
                yield format_one_line(conflict.text)


def _read_outline(parameters: Nav2Parameters) -> dict[str, Any]:
    """Read footprint or radius, and the padding, of the first costmap that has one.

    As in Nav2, `robot_radius` counts only if `footprint` is "[]".
    """
    for costmap in (GLOBAL_COSTMAP, LOCAL_COSTMAP):
        costmap_parameters = parameters.read_node_parameters(costmap)
        footprint, radius = (
            str(costmap_parameters.get("footprint") or "[]"),
            costmap_parameters.get("robot_radius"),
        )
        if footprint == "[]" and radius is None:
            continue
        with name_parameter_in_errors(parameters, costmap):
            outline: Footprint | float = (
                check_positive("robot_radius", radius, "m")
                if footprint == "[]"
                else Footprint.from_text(footprint)
            )
            padding = costmap_parameters.get("footprint_padding", 0.01)  # as Nav2 has it
            return {"footprint": outline, "margin": check_number("footprint_padding", padding, 0.0)}
    return {}


def _read_inflation(parameters: Nav2Parameters) -> tuple[str, dict[str, Any]] | None:
    """Read the layer that inflates the global costmap's walls; None without one."""
    layer = find_inflating_layer(parameters)
    if layer is None:
        return None
    costmap_parameters = parameters.read_node_parameters(GLOBAL_COSTMAP)
    names = [setting.name for setting in dataclasses.fields(Inflation)]
    settings = {
        name: costmap_parameters[f"{layer}.{name}"]
        for name in names
        if f"{layer}.{name}" in costmap_parameters
    }
    with name_parameter_in_errors(parameters, GLOBAL_COSTMAP, layer):
        Inflation(**settings)
    return layer, settings


def _read_kinematics(parameters: Nav2Parameters, planner: str | None) -> Kinematics | None:
    """Read the kinematics of the active planner, or of AMCL's motion model if it has none."""
    used = find_active_planner(parameters, planner)
    with name_parameter_in_errors(parameters, PLANNER_SERVER, used or ""):
        drive = read_planner_drives(parameters)[used] if used else None
    if drive is None and _read_amcl_drive(parameters) == Kinematics(drive="omnidirectional"):
        return _read_amcl_drive(parameters)
    return drive


def _read_amcl_drive(parameters: Nav2Parameters) -> Kinematics:
    """Read the drive of AMCL's motion model."""
    model = _normalize_motion_model(
        str(parameters.read_node_parameters(AMCL).get("robot_model_type"))
    )
    return Kinematics(drive="omnidirectional" if model == OMNIDIRECTIONAL else "differential")


def _list_drive_notes(parameters: Nav2Parameters, planner: str | None) -> Iterator[str]:
    """Yield notes about planners without a type, a choice of planners, and an unknown lattice."""
    if missing := [name for name, plugin in read_planner_types(parameters).items() if not plugin]:
        has = "has" if len(missing) == 1 else "have"
        yield f"Nav2 refuses its planners, since {', '.join(missing)} {has} no plugin type; add it"
    used = find_active_planner(parameters, planner)
    if used is None:
        return
    drives = read_planner_drives(parameters)
    texts = {
        name: describe_drive(drive or _read_amcl_drive(parameters))
        for name, drive in drives.items()
    }
    if file := find_unknown_lattice_file(parameters, used):
        yield (
            f"the motion model of {used} is in {short_repr(file)}, which cannot be read; locplan"
            " takes"
            f" {texts[used]} from AMCL; otherwise set drive and turning_radius by --set"
        )
    alternatives = [f"{name} is {text}" for name, text in texts.items() if text != texts[used]]
    if planner is None and alternatives:
        yield (
            f"if {used} plans, the robot is {texts[used]}, which locplan assumes;"
            f" {', '.join(alternatives)}; to choose another planner, add --set planner=NAME"
        )


def _normalize_motion_model(name: str) -> str:
    """Return the name of AMCL's motion model, also for the names before Humble."""
    older = {"differential": DIFFERENTIAL, "omnidirectional": OMNIDIRECTIONAL}
    return older.get(name, name)


@contextmanager
def name_file_in_errors(path: str | os.PathLike[str], place: str = "") -> Iterator[None]:
    """Add the file, and the place in it, to an error of the block."""
    try:
        yield
    except ConfigError as error:
        raise ConfigError(f"{path}: {place}{': ' if place else ''}{error}") from None


@contextmanager
def name_parameter_in_errors(
    parameters: Nav2Parameters, node: str, plugin: str = ""
) -> Iterator[None]:
    """Add a parameter's file, node and plugin to an error of the block.

    The error must begin with the parameter's name.
    """
    try:
        yield
    except ConfigError as error:
        values = parameters.find_values(node)
        name = str(error).partition(" ")[0]
        value = values.get(f"{plugin}.{name}" if plugin else name)
        at = value.file if value else parameters.find_file_index(node) or 0
        place = ": ".join(filter(None, (node.partition("/")[0], plugin)))
        raise ConfigError(f"{parameters.files[at].path}: {place}: {error}") from None


def _list_unsimulated_parameters(amcl_parameters: Mapping[str, object]) -> Iterator[str]:
    """Yield names of parameters in `NOT_SIMULATED` whose values have an effect."""
    if (
        amcl_parameters.get("do_beamskip")
        and amcl_parameters.get("laser_model_type") == "likelihood_field_prob"
    ):
        yield "do_beamskip"
