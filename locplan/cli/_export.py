"""The command that exports to navigation stacks."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, cast, get_type_hints

from cyclopts import Parameter

import locplan
from locplan._util.progress import working
from locplan._util.public import field_docs
from locplan.cli import _options as shared, _types as typed
from locplan.cli._robot_options import FIELD, FieldOptions
from locplan.errors import ConfigError
from locplan.export import formats

FORMATS = formats()
ABOUT = ", ".join(
    f"{name} ({', '.join((*each.suffixes[:1], each.about))})" for name, each in FORMATS.items()
)
PATHS = [name for name, each in FORMATS.items() if each.paths != "none"]


class _Docs:
    """What the formats say of their options; the source is read where a help needs it."""

    def __get__(self, _: object, kind: type) -> str:
        docs: dict[str, dict[str, list[str]]] = {}
        for format, each in FORMATS.items():
            for name, doc in field_docs(each.options).items():
                docs.setdefault(name, {}).setdefault(doc.removesuffix("."), []).append(format)
        texts = {
            name: " ".join(f"{doc} ({', '.join(having)})." for doc, having in sentences.items())
            for name, sentences in docs.items()
        }
        lines = [f"{name}\n    {text}" for name, text in texts.items() if name != "params"]
        return "\n".join(["Options of formats.", "", "Parameters", "----------", *lines])


def _joint_options() -> type:
    """A dataclass with the options of all formats; one that was not given is None."""
    types: dict[str, Any] = {}
    for each in FORMATS.values():
        types |= get_type_hints(each.options)
    types.pop("params", None)  # they are a file of the robot
    under = typed.under("Format")
    fields = [(name, Annotated[hint | None, under], None) for name, hint in types.items()]
    settings: Any = {
        "bases": (typed.Options,),
        "namespace": {"__module__": __name__},
        "kw_only": True,
    }
    made = dataclasses.make_dataclass("FormatOptions", fields, frozen=True, **settings)
    made.__doc__ = cast("str", _Docs())
    return made


if TYPE_CHECKING:
    from locplan import CovarianceField, FieldConfig
    from locplan.export import ExportJob

    class FormatOptions(typed.Options):
        pass

else:
    FormatOptions = _joint_options()


@typed.command(
    "export lab.yaml --to nav2-keepout -o mask --planner smac-hybrid",
    "export lab.yaml --to path --start 2,3 --goal 38,3 -o path.csv --step 0.05",
)
class export(
    typed.OneMap,
    FieldOptions,
    FormatOptions,
    shared.Ends,
    shared.CostOptions,
    shared.Computing,
    shared.Output,
):
    """Write cost maps, route graphs and paths for navigation stacks."""

    to: Annotated[
        str, Parameter(choices=tuple(FORMATS), show_choices=False, help=f"Format: {ABOUT}.")
    ]
    path: Annotated[typed.Csv, Parameter(help=f"Path to export (x,y) ({', '.join(PATHS)}).")] = ()
    start: Annotated[
        typed.XY,
        Parameter(
            help="Start of a path that is planned and exported, x,y in metres"
            f" ({', '.join(PATHS)})."
        ),
    ] = None
    choice: Annotated[
        tuple[Path, ...],
        typed.INPUT,
        Parameter(
            metavar="FOLDER",
            help="Choice whose path is exported, and masks by the density of this path: the folder"
            " that plan -o wrote, or its choice.json; repeatable for nav2-routes, as is a folder of"
            f" such folders ({', '.join(PATHS)}).",
        ),
    ] = ()
    output: Annotated[Path | None, typed.Target, typed.under("Output")] = None
    """File or folder; MAP-FORMAT here by default."""

    def __call__(self) -> None:
        from locplan._util.tables import table

        to, format, named = self.to, FORMATS[self.to], ("path", "start", "goal", "choice")
        typed.check_read(self.given(*named), "--to", to, dict.fromkeys(PATHS, named))
        chosen, making = self._chosen(), self._of_choices() if self.choice else self._of_options()
        grid = locplan.load_map(self.map_file)
        target = self.output or Path(f"{grid.name}-{to}" + "".join(format.suffixes[:1]))
        format.check_target(target, force=self.force)
        count = len(self.path) + len(self.choice) + bool(self.start)
        if format.paths == "one" and count != 1:
            raise ConfigError(f"--to {to} needs one --path CSV, or --start and --goal, or --choice")
        format.check(chosen, count)
        config, job_of = making
        job = dataclasses.replace(job_of(self.field_of(grid, config)), force=self.force)
        with working(f"writing {target.name}"):
            summary = format.export(target, job, chosen)
        about = {"map": grid.name, "to": to, "target": str(target), **summary.values}
        rows = [("map", grid.name), ("format", to), ("field", config.estimator.title)]
        rows += [*job.rows, *summary.rows]
        shared.show(self.json, about, table([], rows), target)

    def _of_options(self) -> tuple[FieldConfig, Callable[[CovarianceField], ExportJob]]:
        """Settings of the field, and the objects on it by the options of costs and paths."""
        ends, paths = self.ends(), shared.read_paths(self.path)
        robot, config = self.robot_and_field()
        self.check_costs(config)

        def made(field: CovarianceField) -> ExportJob:
            costs = self.costmap(field.grid, field, robot)
            own = {"aware": _planned(costs, *ends)} if ends else {}
            return locplan.export.ExportJob(costs, field, {**paths, **own}, robot=robot)

        return config, made

    def _of_choices(self) -> tuple[FieldConfig, Callable[[CovarianceField], ExportJob]]:
        """Settings of the field of choices, and their objects on it."""
        others = "lidar", "set", "start", "goal", *FIELD
        self.refuse("with --choice, which has its own", *others, shared.CostOptions)
        several = self.to == "nav2-routes"
        if not several:
            self.refuse("with --choice, which has its own", "path")
        choices = locplan.simulation.read_choices(*self.choice)
        if len(choices) > 1 and not several:
            raise ConfigError(f"--to {self.to} takes one --choice, not {len(choices)}")
        paths, (first, *_) = shared.read_paths(self.path), choices.values()

        def made(field: CovarianceField) -> ExportJob:
            if several:
                return locplan.export.ExportJob.of_choices(choices, field, paths)
            return locplan.export.ExportJob.of_choice(first, field)

        return first.config, made

    def _chosen(self) -> Any:
        """The options of the format from those given; a ConfigError if one is not for it."""
        given = self.given(FormatOptions)
        known = {name: typed.field_names(each.options) for name, each in FORMATS.items()}
        typed.check_read(given, "--to", self.to, known)
        if "params" in known[self.to]:
            given["params"] = tuple(self.nav2_files())
        return FORMATS[self.to].options(**given)


def _planned(costs: locplan.Costmap, *ends: tuple[float, float]) -> locplan.Path:
    """The path between two ends, of the lattice for a car; a ConfigError if there is none."""
    on_radius = costs.robot is not None and costs.robot.kinematics.turning_radius > 0
    found = locplan.plan(costs, *ends, planner="lattice" if on_radius else None)
    if found.path is None:
        why = found.note or found.status
        raise ConfigError(f"no path leads from --start to --goal: {why}")
    return found.path
