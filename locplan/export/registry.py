"""The formats of exports, and the folders that they write whole or not at all."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from locplan._support.files import check_target
from locplan._support.output import Output
from locplan._support.public import load_templates
from locplan.errors import ConfigError

if TYPE_CHECKING:
    from locplan.field.field import CovarianceField
    from locplan.planning.costmap import Costmap
    from locplan.planning.path import Path as Route
    from locplan.robots.robot import Robot
    from locplan.simulation.recommendation import Recommendation

NAV2_FILES = {
    "README.md": "how to use them in Nav2",
    "nav2.yaml": "Nav2's parameters, with these files in use",
    "graph.geojson": "the route graph for Nav2's route server",
    "mask.yaml": "the mask, as a map of Nav2",
    "speed_mask.yaml": "the speeds in slow zones, as a map of Nav2",
    "preview.png": "the picture",
}
"""Purpose of the files for Nav2 by name, the most useful first."""
METADATA_FILE = "export.json"
"""The file of a folder that says what it was made of."""
Distro = Literal["humble", "jazzy", "kilted", "lyrical", "rolling"]
"""A distribution of ROS 2."""
DISTRO: Distro = "jazzy"
"""The distribution by default."""
FRAME = "map"
"""The frame of the coordinates by default."""
SLOWEST = 0.3
"""Share of the speed that a speed mask leaves where u is 1, by default."""
LEAD = 0.5
"""Distance before a place at which its speed limit begins, by default [m]."""


@dataclass(frozen=True)
class ExportJob:
    """The objects to export."""

    costs: Costmap
    """The costmap, with its map."""
    field: CovarianceField
    """The covariance field of the map."""
    paths: Mapping[str, Route] = dataclasses.field(default_factory=dict)
    """The paths by name."""
    robot: Robot | None = None
    """The robot; None if it is not known."""
    recommendation: Recommendation | None = None
    """The choice that the costs and the path are of; None without one."""
    force: bool = False
    """True overwrites files of the same names in a folder; others stay."""

    @property
    def rows(self) -> list[tuple[str, str]]:
        """What people are to do before they use an export: a label and a text each."""
        return (
            [("first", sentence) for sentence in self.recommendation.advice]
            if self.recommendation
            else []
        )

    @classmethod
    def from_recommendation(
        cls, recommendation: Recommendation, field: CovarianceField
    ) -> ExportJob:
        """The objects of a choice.

        Parameters
        ----------
        recommendation : Recommendation
            A choice with a path.
        field : CovarianceField
            The field of its map, by the choice's `config`.
        """
        recommendation = recommendation.with_field(field)
        paths = {
            candidate.name: candidate.path
            for candidate in [recommendation.recommended_candidate]
            if candidate
        }
        return cls(
            recommendation.costmap(),
            field,
            paths,
            robot=recommendation.robot,
            recommendation=recommendation,
        )

    @classmethod
    def from_recommendations(
        cls,
        recommendations: Mapping[str, Recommendation],
        field: CovarianceField,
        paths: Mapping[str, Route],
    ) -> ExportJob:
        """The paths of choices, with further ones, on the costmap of the first choice's field.

        Parameters
        ----------
        recommendations : mapping of str to Recommendation
            Choices on one map by the names that their paths get; those without a path are left out.
        field : CovarianceField
            The field of the map, by the choices' `config`.
        paths : mapping of str to Path
            The further paths by name.

        Raises
        ------
        ConfigError
            If the choices differ in the map, the field or the robot's size, or two paths have one
            name.
        """
        name, first = next(iter(recommendations.items()))
        for other, recommendation in recommendations.items():
            if (recommendation.map, recommendation.config, recommendation.robot.radius) != (
                *(first.map, first.config, first.robot.radius),
            ):
                raise ConfigError(
                    f"the choices {name} and {other} differ in the map, the field or the robot's"
                    " size; export them separately"
                )
            if other in paths:
                raise ConfigError(f"a path and a choice are both named {other}; rename one")
        recommended_paths = {
            other: recommendation.path
            for other, recommendation in recommendations.items()
            if recommendation.path is not None
        }
        if not recommended_paths and not paths:
            raise ConfigError(f"the choice {name} has no path: {first.sentence}")
        costs = first.with_field(field).costs
        assert costs is not None
        return cls(costs, field, {**recommended_paths, **paths}, robot=first.robot)


@dataclass(frozen=True)
class ExportSummary:
    """Facts about an export that was written."""

    values: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    """The facts by name, fit for JSON."""
    rows: tuple[tuple[str, str], ...] = ()
    """The facts for people: a label and a text each."""


def option(default: Any, *, flag: str = "", metavar: str = "") -> Any:
    """Return the field of an option that the command `export` has as well.

    Its help is the first sentence below the field.

    Parameters
    ----------
    default : object
        The default.
    flag : str, optional
        The option's name on the command line; by default that of the field.
    metavar : str, optional
        The word for the value in the help; by default that of its type.
    """
    metadata = {"is_option": True, "flag": flag, "metavar": metavar}
    return dataclasses.field(default=default, metadata=metadata)


@dataclass(frozen=True)
class NoOptions:
    """The options of a format that has none, and what all options are."""

    def __post_init__(self) -> None:
        """Raise a LocplanError where an option is wrong; each kind of options checks its own."""


@dataclass(frozen=True, kw_only=True)
class InFrame(NoOptions):
    """The frame of what is written."""

    frame: str = option(FRAME)
    """Frame of the coordinates."""


@dataclass(frozen=True, kw_only=True)
class InDistro(NoOptions):
    """The robot's distribution of ROS 2."""

    distro: Distro = option(DISTRO)
    """Distribution of ROS 2."""


@dataclass(frozen=True)
class Format:
    """A format of exports."""

    name: str
    """The name on the command line."""
    description: str
    """A few words that describe it."""
    write: Callable[[Path, ExportJob, Any], ExportSummary]
    """The function that writes a job to a target, with an instance of `options`."""
    options: type = NoOptions
    """A frozen dataclass whose docstrings say what each field does; it checks itself when made."""
    suffixes: tuple[str, ...] = ()
    """The suffixes of a file, the usual one first; a folder has none."""
    purpose: str = "the export"
    """A file's purpose, which is printed next to its name."""
    paths: Literal["none", "one", "several"] = "none"
    """The number of paths that it takes."""
    check: Callable[[Any, int], None] = lambda options, paths: None
    """The function that raises a ConfigError where the options and the number of paths do not go
    together; it is called before long work."""

    def check_target(self, target: Path, *, force: bool = False) -> None:
        """Raise a LocplanError unless it can be written there; to be called before long work.

        Parameters
        ----------
        target : Path
            The file, or the folder.
        force : bool, default False
            True overwrites files of the same names.
        """
        if self.suffixes:
            check_target(target, *self.suffixes)
        self._output(target, force=force).check()

    def export(self, target: Path, job: ExportJob, options: Any) -> ExportSummary:
        """Write a job to a target, next to which a file gets its run.

        Parameters
        ----------
        target : Path
            The file, or the folder.
        job : ExportJob
            The objects to export.
        options : object
            An instance of `options`.
        """
        if not self.suffixes:
            return self.write(target, job, options)
        with self._output(target, force=job.force).writing() as file:
            return self.write(file, job, options)

    def _output(self, target: Path, *, force: bool) -> Output:
        purposes = {"*": self.purpose}
        return Output(target, self.name, force, is_file=bool(self.suffixes), purposes=purposes)


def list_formats() -> dict[str, Format]:
    """All formats by name."""
    from locplan.export.formats import FORMATS

    return {export_format.name: export_format for export_format in FORMATS}


@contextmanager
def export_folder(
    target: str | Path,
    readme: str,
    metadata: Mapping[str, Any],
    force: bool,
    *,
    purposes: Mapping[str, str] = NAV2_FILES,
    **template_values: Any,
) -> Iterator[Path]:
    """Yield a new folder whose files move to `target` when the block succeeds.

    It gets export.json and a README.md, the template `readme` filled with `template_values`.
    `purposes` are those of its files by name, the most useful first.
    """
    with Output(Path(target), metadata["kind"], force, purposes=purposes).writing() as folder:
        yield folder
        (folder / "README.md").write_text(render_template(readme, **template_values), "utf-8")
        text = json.dumps(metadata, indent=2, allow_nan=False)
        (folder / METADATA_FILE).write_text(text + "\n", "utf-8")


def render_template(template: str, **template_values: Any) -> str:
    """The text of one of our templates with what is known."""
    templates = load_templates("locplan.export", keep_trailing_newline=True)
    return templates.get_template(template).render(template_values)


def check_has_field(costs: Costmap) -> None:
    """Raise a ConfigError unless the costmap knows how degenerate its cells are."""
    import numpy as np

    if np.isnan(costs.u).all() and np.isfinite(costs.density).any():
        raise ConfigError("this export needs a costmap made of a field (Costmap.from_field)")
