"""The command `export`: write files for navigation stacks."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, get_args, get_origin, get_type_hints

from cyclopts import Parameter

import locplan
from locplan._support.progress import show_spinner
from locplan._support.public import read_field_docs
from locplan.app.cli.application import command, format_default
from locplan.app.cli.arguments import (
    INPUT,
    InputFile,
    InputFolders,
    MapFile,
    PathFiles,
    Position,
    check_ends,
    read_paths,
    reject_options,
)
from locplan.app.cli.groups import (
    FieldOptions,
    OutputOptions,
    RobotOptions,
    Threads,
    Weight,
    load_zones,
)
from locplan.errors import ConfigError
from locplan.export.registry import list_formats

if TYPE_CHECKING:
    from locplan.export.registry import ExportFormat, ExportJob
    from locplan.field.config import FieldConfig
    from locplan.field.field import CovarianceField

FORMATS = list_formats()
WITH_PATHS = [name for name, format in FORMATS.items() if format.paths != "none"]
FormatName = Annotated[str, Parameter(metavar="FORMAT", choices=tuple(FORMATS), help="Format.")]


def _collect_options() -> dict[str, dataclasses.Field[Any]]:
    """Return the options of all formats by name in Python."""
    fields = (field for format in FORMATS.values() for field in dataclasses.fields(format.options))
    return {field.name: field for field in fields if "is_option" in field.metadata}


def _make_option_flag(field: dataclasses.Field[Any]) -> str:
    """Return the name of an option on the command line."""
    return field.metadata["flag"] or field.name.replace("_", "-")


def _list_literal_words(kind: Any) -> tuple[str, ...]:
    """Return the words of a `Literal` type; empty for other types."""
    return get_args(kind) if get_origin(kind) is Literal else ()


def _list_option_types() -> list[tuple[str, Any, None]]:
    """Return name, type and default of each option of the formats, as a dataclass needs them."""
    types: dict[str, Any] = {}
    docs: dict[str, str] = {}
    for format in FORMATS.values():
        types |= get_type_hints(format.options)
        docs |= read_field_docs(format.options)
    typed = []
    annotate: Any = Annotated  # mypy rejects computed types in Annotated[...]
    for name, field in _collect_options().items():
        words = [
            word
            for kind in (types[name], *get_args(types[name]))
            for word in _list_literal_words(kind)
        ]
        sentence = " ".join(docs[name].split()).partition(". ")[0].removesuffix(".")
        parameter = Parameter(
            name=f"--{_make_option_flag(field)}",
            metavar=field.metadata["metavar"] or None,
            help=f"{', '.join(words[:-1])} or {words[-1]}." if words else f"{sentence}.",
            show_choices=False,
            show_default=format_default(field.default) or False,
        )
        parameters = [parameter, INPUT] if Path in get_args(types[name]) else [parameter]
        typed.append((name, annotate[types[name] | None, *parameters], None))
    return typed


FormatOptions: Any = Parameter(name="*")(
    dataclasses.make_dataclass(
        "FormatOptions",
        _list_option_types(),
        namespace={"__module__": __name__},
        frozen=True,
        kw_only=True,
    )
)
"""Options of all formats."""


@command(
    "export lab.yaml --to nav2-keepout --robot nav2_params.yaml -o mask",
    "export lab.yaml --to nav2-keepout --choice planned -o mask",
    "export lab.yaml --to path --start 2,3 --goal 38,3 -o path.csv",
)
def export(
    map_file: MapFile,
    /,
    *,
    to: FormatName,
    choice: InputFolders = (),
    path: PathFiles = (),
    start: Position = None,
    goal: Position = None,
    weight: Weight = None,
    zones: InputFile = None,
    options: FormatOptions = FormatOptions(),
    robot: RobotOptions = RobotOptions(),
    field: FieldOptions = FieldOptions(),
    threads: Threads = None,
    output: OutputOptions = OutputOptions(),
) -> None:
    """Write cost maps, route graphs and paths for navigation stacks.

    Parameters
    ----------
    map_file
        Map YAML, folder with one, or built-in map.
    choice
        Folder that `locplan plan -o` wrote. Repeatable for nav2-routes.
    path
        Path to export (CSV of x,y). Repeatable for nav2-routes.
    start
        Start of a path to plan and export, in metres.
    goal
        Goal of a path to plan and export, in metres.
    weight
        Detour that avoiding a degenerate metre is worth, in metres.
    zones
        Zones (GeoJSON) or a keepout mask (map YAML).
    """
    from locplan._support.tables import format_table

    format = FORMATS[to]
    check_ends(start, goal)
    if format.paths == "none":
        for name, value in (("path", path), ("choice", choice), ("start", start)):
            if value:
                raise ConfigError(
                    f"--{name} has no effect with --to {to}; use --to {', '.join(WITH_PATHS)}"
                )
    format_options = _read_options(format, options, robot.list_nav2_files())
    if zones and to == "ros-map":
        reject_options("with --to ros-map, which contains only u", zones=zones)
    grid = locplan.load_map(map_file)
    if choice:
        reject_options("with --choice, which sets it", start=start, weight=weight, zones=zones)
        reject_options("with --choice, which sets it", lidar=robot.lidar)
        reject_options("with --choice, which sets it", field=field.field, set=robot.set)
        config, make_job = _make_recommendation_job(format, choice, path)
    else:
        config, make_job = _make_options_job(grid, path, start, goal, weight, zones, robot, field)
    n_paths = len(path) + len(choice) + (start is not None)
    if format.paths == "one" and n_paths != 1:
        raise ConfigError(f"--to {to} needs one path: pass --path, --start and --goal, or --choice")
    format.check(format_options, n_paths)
    target = output.output or Path(f"{grid.name}-{to}" + "".join(format.suffixes[:1]))
    format.check_target(target, force=output.force)
    is_copy = to == "path" and bool(path)  # needs no field, which may take a minute
    job = make_job(None if is_copy else field.compute(grid, config, threads))
    with show_spinner(f"writing {target.name}"):
        summary = format.export(
            target, dataclasses.replace(job, force=output.force), format_options
        )
    values = {"map": grid.name, "to": to, "target": str(target), **summary.values}
    rows = [("map", grid.name), ("format", to)]
    if not is_copy:
        rows.append(("field", config.estimator.title))
    if job.costs.zones:
        rows.append(("zones", str(job.costs.zones)))
    output.show(values, format_table([], [*rows, *job.advice_rows, *summary.rows]), target)


MakeJob = Callable[["CovarianceField | None"], "ExportJob"]
"""Function that returns the objects to export for a field; without one, to copy a path."""


def _make_options_job(
    grid: locplan.OccupancyGrid,
    path_files: tuple[Path, ...],
    start: Any,
    goal: Any,
    weight: float | None,
    zones_file: Path | None,
    robot: RobotOptions,
    field: FieldOptions,
) -> tuple[FieldConfig, MakeJob]:
    """Return the field settings and a function that makes the job from the options."""
    from locplan.export import registry

    paths, zones = read_paths(path_files), load_zones(zones_file, grid)
    on_map, config = field.resolve(robot.load())

    def make_job(computed: CovarianceField | None) -> ExportJob:
        if computed is None:
            costs = locplan.Costmap.blank(grid, robot=on_map, zones=zones)
        else:
            costs = locplan.Costmap.from_field(computed, robot=on_map, weight=weight, zones=zones)
        if start and goal:
            paths["aware"] = _plan_path(costs, start, goal)
        return registry.ExportJob(costs, computed, paths, robot=on_map)

    return config, make_job


def _make_recommendation_job(
    format: ExportFormat, folders: tuple[Path, ...], path_files: tuple[Path, ...]
) -> tuple[FieldConfig, MakeJob]:
    """Return the field settings and a function that makes the job from saved recommendations."""
    from locplan.export import registry
    from locplan.simulation.recommendations import read_recommendations

    takes_several = format.paths == "several" and format.name == "nav2-routes"
    if not takes_several:
        reject_options("with --choice, which sets it", path=path_files)
    recommendations = read_recommendations(*folders)
    if len(recommendations) > 1 and not takes_several:
        raise ConfigError(
            f"--to {format.name} takes one --choice, not {len(recommendations)}; remove the others"
        )
    paths, first = read_paths(path_files), next(iter(recommendations.values()))

    def make_job(computed: CovarianceField | None) -> ExportJob:
        assert computed is not None
        if takes_several:
            return registry.ExportJob.from_recommendations(recommendations, computed, paths)
        return registry.ExportJob.from_recommendation(first, computed)

    return first.config, make_job


def _read_options(format: ExportFormat, options: Any, params: list[Path]) -> Any:
    """Return the options of a format; raise a ConfigError if an option is for other formats."""
    fields = {field.name for field in dataclasses.fields(format.options)}
    values = {name: value for name, value in vars(options).items() if value is not None}
    for name in values:
        if name not in fields:
            readers = [
                other.name
                for other in FORMATS.values()
                if name in {field.name for field in dataclasses.fields(other.options)}
            ]
            flag = _make_option_flag(_collect_options()[name])
            raise ConfigError(
                f"--{flag} has no effect with --to {format.name}; it is for {', '.join(readers)}"
            )
    if "params" in fields:
        values["params"] = tuple(params)
    return format.options(**values)


def _plan_path(costs: locplan.Costmap, start: Any, goal: Any) -> locplan.Path:
    """Plan the path to export, with the lattice for cars; raise a ConfigError if there is none."""
    is_car = costs.robot is not None and costs.robot.kinematics.turning_radius > 0
    plan = locplan.plan(costs, start, goal, planner="lattice" if is_car else None)
    if plan.path is None:
        raise ConfigError(f"no path leads from --start to --goal: {plan.note or plan.status}")
    return plan.path
