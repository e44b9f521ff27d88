"""What Nav2's parameters say of a robot, and changes of them that leave all else as it is."""

from __future__ import annotations

import dataclasses
import os
import re
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np

from locplan._util.checks import number, positive
from locplan._util.reading import compose, flow_text, read_content
from locplan.errors import ConfigError, LocplanError, one_line
from locplan.robots._amcl import DIFFERENTIAL, OMNIDIRECTIONAL, Amcl
from locplan.robots._parameters import (
    AMCL,
    GLOBAL_COSTMAP,
    LOCAL_COSTMAP,
    MAX_BYTES,
    PLANNER_SERVER,
    REMEDY,
    Nav2Parameters,
    file_and_robot,
    parameters_of,
    read_parameters,
)
from locplan.robots._parts import Footprint, Inflation, Kinematics

NOT_SIMULATED: dict[str, float | str | bool] = {
    "base_frame_id": "base_footprint",
    "beam_skip_distance": 0.5,
    "beam_skip_error_threshold": 0.9,
    "beam_skip_threshold": 0.3,
    "do_beamskip": False,
    "global_frame_id": "map",
    "lambda_short": 0.1,
    "odom_frame_id": "odom",
    "save_pose_rate": 0.5,
    "scan_topic": "scan",
    "tf_broadcast": True,
    "transform_tolerance": 1.0,
    "z_max": 0.05,
    "z_short": 0.05,
}
"""Parameters of AMCL that are not simulated, with the values that Nav2 has for them."""
NO_MATTER = {
    *NOT_SIMULATED,
    *("allow_parameter_qos_overrides", "always_reset_initial_pose", "first_map_only"),
    *("freespace_downsampling", "initial_pose", "initialize_at_saved_pose", "map_topic"),
    *("random_seed", "saved_pose_filepath", "set_initial_pose", "use_sim_time"),
}
"""All parameters of AMCL beside those simulated, most of which do not matter for that."""


class ParameterWarning(UserWarning):
    """Warning that a robot's parameters are simulated in part only."""


def read_amcl(path: str | os.PathLike[str]) -> Amcl:
    """Read AMCL's parameters from a parameter file of Nav2.

    Warns of parameters in the file that are not simulated.

    Parameters
    ----------
    path : path
        YAML file with a node `amcl`; parameters that are missing there have Nav2's defaults. Where
        it has several robots, the namespace of one follows, as in "nav2.yaml:robot1".

    Raises
    ------
    LocplanError
        If the file cannot be read, has no parameters of amcl, or a value is out of its range.
    """
    amcl = filter_of(path, read_parameters(path))
    if amcl is None:
        raise LocplanError(f"{path}: has no parameters of amcl; give the file that starts it")
    return amcl


def parts_of(path: str | os.PathLike[str]) -> dict[str, Any]:
    """What a parameter file says of a robot, by the names of `Robot`'s fields."""
    parameters = read_parameters(path)
    found = {
        "filter": filter_of(path, parameters),
        **_outline(path, parameters),
        "inflation": (_inflation(path, parameters) or (None, None))[1],
        "kinematics": _kinematics(path, parameters),
    }
    return {name: part for name, part in found.items() if part is not None}


def nav2_inflation(path: str | os.PathLike[str]) -> tuple[str, Inflation, float] | None:
    """Inflation layer of a global costmap by name, and the inscribed radius that it reads [m].

    None where no layer inflates. The radius is that of the padded corners, 16 of a circle.

    Parameters
    ----------
    path : path
        A parameter file of Nav2.

    Raises
    ------
    LocplanError
        If the file cannot be read, or a value is out of its range.
    """
    parameters = read_parameters(path)
    found = _inflation(path, parameters)
    if found is None:
        return None
    parts = {"footprint": 0.1, "margin": 0.01} | _outline(path, parameters)  # as Nav2 has them
    outline, padding = parts["footprint"], parts["margin"]
    if not isinstance(outline, Footprint):
        angles = np.arange(16) * 2 * np.pi / 16
        outline = Footprint(outline * np.column_stack([np.cos(angles), np.sin(angles)]))
    padded = outline.vertices + np.sign(outline.vertices) * padding
    return (*found, Footprint(padded).inscribed_radius)


def filter_of(path: str | os.PathLike[str], parameters: Nav2Parameters) -> Amcl | None:
    """AMCL's parameters, or None without any; warns of those that are not simulated."""
    given, own = parameters.of(AMCL), parameters.of(AMCL, shared=False)
    known = {each.name for each in dataclasses.fields(Amcl)} - {"half_cell"}
    taken = {name: value for name, value in given.items() if name in known}
    if not taken and all(each.is_shared for each in parameters.entries(AMCL)):
        return None
    model = _motion_model(str(taken.pop("robot_model_type", DIFFERENTIAL)))
    foreign = model not in (DIFFERENTIAL, OMNIDIRECTIONAL)
    if not foreign:
        taken["robot_model_type"] = model
    with errors_at(path, AMCL):
        amcl = Amcl(**taken)
    unknown = sorted({name.partition(".")[0] for name in own} - known - NO_MATTER)
    left_out = (*_not_simulated(given), *["robot_model_type"] * foreign, *unknown)
    if left_out:
        message = one_line(f"{path}: not simulated: {', '.join(left_out)}")
        warnings.warn(ParameterWarning(message), stacklevel=4)
    return amcl


def _outline(path: str | os.PathLike[str], parameters: Nav2Parameters) -> dict[str, Any]:
    """Footprint or radius, and its padding, of the first costmap that has one.

    As in Nav2, `footprint` counts where it is not "[]", and else `robot_radius`.
    """
    for costmap in (GLOBAL_COSTMAP, LOCAL_COSTMAP):
        own = parameters.of(costmap)
        footprint, radius = str(own.get("footprint") or "[]"), own.get("robot_radius")
        if footprint == "[]" and radius is None:
            continue
        with errors_at(path, costmap.partition("/")[0]):
            outline: Footprint | float = (
                positive("robot_radius", radius, "m")
                if footprint == "[]"
                else Footprint.from_text(footprint)
            )
            padding = own.get("footprint_padding", 0.01)  # as Nav2 has it
            return {"footprint": outline, "margin": number("footprint_padding", padding, 0.0)}
    return {}


def _inflation(
    path: str | os.PathLike[str], parameters: Nav2Parameters
) -> tuple[str, Inflation] | None:
    """Inflation layer of the global costmap by name, or None where it has no such layer."""
    own = parameters.of(GLOBAL_COSTMAP)
    for layer in parameters.names(GLOBAL_COSTMAP, "plugins"):
        if own.get(f"{layer}.plugin") == "nav2_costmap_2d::InflationLayer":
            names = [each.name for each in dataclasses.fields(Inflation)]
            given = {name: own[f"{layer}.{name}"] for name in names if f"{layer}.{name}" in own}
            with errors_at(path, f"global_costmap: {layer}"):
                return layer, Inflation(**given)
    return None


def _kinematics(path: str | os.PathLike[str], parameters: Nav2Parameters) -> Kinematics | None:
    """Kinematics of the first planner with a car-like motion model, or of AMCL's motion model."""
    own = parameters.of(PLANNER_SERVER)
    for planner in parameters.names(PLANNER_SERVER, "planner_plugins"):
        model = own.get(f"{planner}.motion_model_for_search")
        if model in ("DUBIN", "REEDS_SHEPP"):  # the latter drives in reverse, too
            radius = own.get(f"{planner}.minimum_turning_radius", 0.4)
            with errors_at(path, f"planner_server: {planner}"):
                reverse = model == "REEDS_SHEPP"
                return Kinematics(drive="car-like", turning_radius=radius, reverse=reverse)
    sideways = _motion_model(str(parameters.of(AMCL).get("robot_model_type"))) == OMNIDIRECTIONAL
    return Kinematics(drive="omnidirectional") if sideways else None


def _motion_model(name: str) -> str:
    """The name of AMCL's motion model, or that of one which was named otherwise before Humble."""
    older = {"differential": DIFFERENTIAL, "omnidirectional": OMNIDIRECTIONAL}
    return older.get(name, name)


@contextmanager
def errors_at(path: str | os.PathLike[str], where: str = "") -> Iterator[None]:
    """Name the file, and the place in it, in an error of the block."""
    try:
        yield
    except ConfigError as error:
        raise ConfigError(f"{path}: {where}{': ' if where else ''}{error}") from None


def _not_simulated(given: Mapping[str, object]) -> Iterator[str]:
    """Names of parameters in `NO_MATTER` that do matter with the values given."""
    if given.get("do_beamskip") and given.get("laser_model_type") == "likelihood_field_prob":
        yield "do_beamskip"


def edited_parameters(
    path: str | os.PathLike[str], node: str, values: Mapping[str, float | str | bool]
) -> bytes:
    """Content of a parameter file with other values of one node's parameters.

    They stand where the values in force stood; comments and layout stay. Parameters that are
    missing are inserted above the first one of an entry for this node, or in a new entry.

    Parameters
    ----------
    path : path
        The file, which `read_parameters` reads, and the robot in it.
    node : str
        Name of the node, such as amcl.
    values : mapping
        Values by the names of the parameters.

    Raises
    ------
    LocplanError
        If the file cannot be read, or if anchors, aliases or tags make one value stand for
        several, so that it cannot be changed alone.
    """
    return rewritten_parameters(path, read_parameters(path).changed(node, values))


def rewritten_parameters(path: str | os.PathLike[str], changed: Nav2Parameters) -> bytes:
    """Content of a parameter file that has become another one, as `edited_parameters` writes it.

    Parameters
    ----------
    path : path
        The file, which `read_parameters` reads, and the robot in it.
    changed : Nav2Parameters
        Its parameters with other values, or with more.

    Raises
    ------
    LocplanError
        If the file cannot be read, or one value stands for several.
    """
    before = read_parameters(path)
    file, robot = file_and_robot(path)
    content = read_content(file, MAX_BYTES, REMEDY)
    text = content.decode("utf-8-sig")
    root = compose(file, content, REMEDY)
    fault = LocplanError(
        f"{path}: its values cannot be changed alone; write out its anchors and aliases"
    )
    edits = []
    missing: dict[tuple[str, ...], Any] = {}
    for keys, value in _changes(before.content, changed.content):
        found = _found(root, keys)
        if found is None:
            missing.setdefault(keys[:-1], {})[keys[-1]] = value
        else:
            edits.append(_replacement(text, *found, value))
    for keys, new in missing.items():
        edits.append(_insertion(text, root, keys, new))
    for start, end, new_text in sorted(edits, reverse=True):
        text = text[:start] + new_text + text[end:]
    made = text.encode("utf-8-sig" if content.startswith(b"\xef\xbb\xbf") else "utf-8")
    try:
        read = parameters_of(file, made, robot)
    except LocplanError:
        raise fault from None
    if read != changed:
        raise fault
    return made


def _changes(
    before: Mapping[str, Any], after: Mapping[str, Any], above: tuple[str, ...] = ()
) -> Iterator[tuple[tuple[str, ...], Any]]:
    """Keys and value of what is another, or new, in a mapping of mappings."""
    for key, value in after.items():
        own, keys = before.get(key), (*above, key)
        if isinstance(own, dict) and isinstance(value, dict):
            yield from _changes(own, value, keys)
        elif key not in before or own != value:
            yield keys, value


def _found(mapping: Any, keys: Sequence[str]) -> tuple[Any, Any] | None:
    """Key and value at the end of keys, the last ones where a key stands several times."""
    if not (keys and mapping is not None and mapping.id == "mapping"):
        return None
    first, *inner = keys
    for key, value in reversed(mapping.value):
        if key.value == first:
            found = _found(value, inner) if inner else (key, value)
            if found is not None:
                return found
    return None


def _replacement(text: str, key: Any, value: Any, new: Any) -> tuple[int, int, str]:
    """Beginning, end and new text of a value."""
    start, end = value.start_mark.index, value.end_mark.index
    if value.id == "sequence" and not value.flow_style:  # which ends where the next thing begins
        return (
            text.index(":", key.end_mark.index) + 1,
            value.value[-1].end_mark.index,
            (f" {flow_text(new)}"),
        )
    if start < key.end_mark.index:  # an alias, whose node stands where its anchor is
        alias = re.compile(r"\s*:\s*(\*[^\s,\[\]{}]+)").match(text, key.end_mark.index)
        assert alias is not None
        return alias.start(1), alias.end(1), flow_text(new)
    anchor = re.compile(r"&[^\s,\[\]{}]+\s*").match(text, start)
    quote = text[start] if text[start : start + 1] in ("'", '"') else ""
    quote = quote if isinstance(new, str) else ""
    written = f"{quote}{new}{quote}" if quote else flow_text(new)
    return (anchor.end() if anchor else start), end, written


def _insertion(
    text: str, root: Any, keys: Sequence[str], values: Mapping[str, Any]
) -> tuple[int, int, str]:
    """Where missing parameters are inserted, twice, and their text."""
    entries = [f"{name}: {flow_text(value)}" for name, value in values.items()]
    found = _found(root, keys)
    mapping: Any = found[1] if found else root
    if mapping.flow_style:
        at = text.index("{", mapping.start_mark.index) + 1
        return at, at, ", ".join(entries) + (", " if mapping.value else "")
    first = mapping.value[0][0].start_mark
    indent = text[first.index - first.column : first.index]
    newline = "\r\n" if "\r\n" in text else "\n"
    return first.index, first.index, "".join(f"{entry}{newline}{indent}" for entry in entries)
