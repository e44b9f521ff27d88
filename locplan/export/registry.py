"""Export formats, and export folders that are written completely or not at all."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from locplan._support.files import check_writable_file, write_text
from locplan._support.output import ResultOutput
from locplan._support.public import load_templates
from locplan._support.reading import make_file_stamp
from locplan.errors import ConfigError

if TYPE_CHECKING:
    from locplan.field.field import CovarianceField
    from locplan.planning.costmap import Costmap
    from locplan.planning.path import Path as Route
    from locplan.robots.robot import Robot
    from locplan.simulation.recommendation import Recommendation

NAV2_FILES = {
    "README.md": "how to use them in Nav2",
    "nav2.yaml": "Nav2's parameters, with these files active",
    "graph.geojson": "the route graph for Nav2's route server",
    "mask.yaml": "the mask, as a map of Nav2",
    "speed_mask.yaml": "the speeds in slow zones, as a map of Nav2",
    "preview.png": "the picture",
}
"""Purpose of the files for Nav2 by name, the most useful first."""
METADATA_FILE = "export.json"
"""The file that records the input of an export."""
METADATA_VERSION = 1
"""Version of this file's content."""
Distro = Literal["humble", "jazzy", "kilted", "lyrical", "rolling"]
"""A distribution of ROS 2."""
DEFAULT_DISTRO: Distro = "jazzy"
"""The default distribution."""
DEFAULT_FRAME = "map"
"""The default frame of the coordinates."""
DEFAULT_SLOWEST = 0.3
"""Default share of the speed that a speed mask allows at u = 1."""
DEFAULT_LEAD = 0.5
"""Default distance before a place at which its speed limit begins [m]."""


@dataclass(frozen=True)
class ExportJob:
    """The input of an export."""

    costs: Costmap
    """The costmap, with its map."""
    field: CovarianceField | None
    """The covariance field of the map; None if a path is only copied."""
    paths: Mapping[str, Route] = dataclasses.field(default_factory=dict)
    """The paths by name."""
    robot: Robot | None = None
    """The robot; None if it is not known."""
    recommendation: Recommendation | None = None
    """The recommendation that the costs and the path come from; None without one."""
    force: bool = False
    """True overwrites files of the same names in a folder; others stay."""

    @property
    def advice_rows(self) -> list[tuple[str, str]]:
        """Steps to take before using the export: a label and a text each."""
        return (
            [("first", sentence) for sentence in self.recommendation.advice]
            if self.recommendation
            else []
        )

    @classmethod
    def from_recommendation(
        cls, recommendation: Recommendation, field: CovarianceField
    ) -> ExportJob:
        """Return the job that exports a recommendation.

        Parameters
        ----------
        recommendation : Recommendation
            A recommendation with a path.
        field : CovarianceField
            The field of its map, with the recommendation's `config`.
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
        """Return the job that exports the paths of recommendations, and additional paths.

        The costmap comes from the first recommendation.

        Parameters
        ----------
        recommendations : mapping of str to Recommendation
            Recommendations on one map, by the names of their paths. Recommendations without a path
            are skipped.
        field : CovarianceField
            The field of the map, with the recommendations' `config`.
        paths : mapping of str to Path
            The additional paths by name.

        Raises
        ------
        ConfigError
            If the recommendations differ in the map, the field or the robot's size, or two paths
            have the same name.
        """
        name, first = next(iter(recommendations.items()))
        for other, recommendation in recommendations.items():
            if (recommendation.map, recommendation.config, recommendation.robot.radius) != (
                *(first.map, first.config, first.robot.radius),
            ):
                raise ConfigError(
                    f"the recommendations {name} and {other} differ in the map, the field or the"
                    " robot's size; export them separately"
                )
            if other in paths:
                raise ConfigError(f"a path and a recommendation are both named {other}; rename one")
        recommended_paths = {
            other: recommendation.path
            for other, recommendation in recommendations.items()
            if recommendation.path is not None
        }
        if not recommended_paths and not paths:
            raise ConfigError(f"the recommendation {name} has no path: {first.sentence}")
        costs = first.with_field(field).costs
        assert costs is not None
        return cls(costs, field, {**recommended_paths, **paths}, robot=first.robot)


@dataclass(frozen=True)
class ExportSummary:
    """Summary of a written export."""

    values: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    """Plain data by name, for JSON."""
    rows: tuple[tuple[str, str], ...] = ()
    """The same for people: a label and a text each."""


def make_option_field(default: Any, *, flag: str = "", metavar: str = "") -> Any:
    """Return a dataclass field that is also an option of the command `export`.

    The option's help is the first sentence of the docstring below the field.

    Parameters
    ----------
    default : object
        The default.
    flag : str, optional
        The option's name on the command line; by default the field's name.
    metavar : str, optional
        The word for the value in the help; by default its type's word.
    """
    metadata = {"is_option": True, "flag": flag, "metavar": metavar}
    return dataclasses.field(default=default, metadata=metadata)


@dataclass(frozen=True)
class ExportOptions:
    """Options of a format; the base class has none."""

    def __post_init__(self) -> None:
        """Raise a LocplanError if an option is invalid; subclasses check their options."""


@dataclass(frozen=True, kw_only=True)
class FrameOptions(ExportOptions):
    """Options of a format with coordinates."""

    frame: str = make_option_field(DEFAULT_FRAME)
    """Frame of the coordinates."""


@dataclass(frozen=True, kw_only=True)
class DistroOptions(ExportOptions):
    """Options of a format that depends on the robot's distribution of ROS 2."""

    distro: Distro = make_option_field(DEFAULT_DISTRO)
    """Distribution of ROS 2."""


@dataclass(frozen=True)
class ExportFormat:
    """An export format."""

    name: str
    """The name on the command line."""
    description: str
    """A few words that describe it."""
    write: Callable[[Path, ExportJob, Any], ExportSummary]
    """The function that writes a job to a target, with an instance of `options`."""
    options: type = ExportOptions
    """A frozen dataclass whose fields have docstrings; its constructor checks the options."""
    suffixes: tuple[str, ...] = ()
    """The suffixes of the file, the usual one first; none for a folder."""
    purpose: str = "the export"
    """The file's purpose, which is printed next to its name."""
    paths: Literal["none", "one", "several"] = "none"
    """The number of paths that it takes."""
    check: Callable[[Any, int], None] = lambda options, paths: None
    """The function that raises a ConfigError if the options do not fit the number of paths; it is
    called before any long computation."""

    def check_target(self, target: Path, *, force: bool = False) -> None:
        """Raise a LocplanError unless the target can be written; called before any computation.

        Parameters
        ----------
        target : Path
            The file, or the folder.
        force : bool, default False
            True overwrites files of the same names.
        """
        if self.suffixes:
            check_writable_file(target, *self.suffixes)
        self._output(target, force=force).check()

    def export(self, target: Path, job: ExportJob, options: Any) -> ExportSummary:
        """Write a job to a target; next to a file, also write its run.yaml.

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

    def _output(self, target: Path, *, force: bool) -> ResultOutput:
        purposes = {"*": self.purpose}
        return ResultOutput(
            target, self.name, force, is_file=bool(self.suffixes), purposes=purposes
        )


def list_formats() -> dict[str, ExportFormat]:
    """Return all formats by name."""
    from locplan.export.formats import FORMATS

    return {export_format.name: export_format for export_format in FORMATS}


@contextmanager
def create_export_folder(
    target: str | Path,
    readme: str,
    metadata: Mapping[str, Any],
    template_values: Mapping[str, Any],
    *,
    purposes: Mapping[str, str] = NAV2_FILES,
    force: bool,
) -> Iterator[Path]:
    """Yield a new folder whose files move to `target` when the block succeeds.

    The folder gets export.json with `metadata`, and README.md: the template `readme` filled with
    `template_values`. `purposes` has the purpose of each file by name, the most useful first.
    """
    with ResultOutput(Path(target), metadata["kind"], force, purposes=purposes).writing() as folder:
        yield folder
        write_text(folder / "README.md", render_template(readme, template_values))
        content = {**make_file_stamp(metadata["kind"], METADATA_VERSION), **metadata}
        write_text(folder / METADATA_FILE, json.dumps(content, indent=2, allow_nan=False) + "\n")


def render_template(template: str, template_values: Mapping[str, Any]) -> str:
    """Return the text of one of this package's templates, filled with values."""
    templates = load_templates("locplan.export", keep_trailing_newline=True)
    return templates.get_template(template).render(template_values)


def check_has_field(costs: Costmap) -> None:
    """Raise a ConfigError unless the costmap has the degeneracy u of its cells."""
    import numpy as np

    if np.isnan(costs.u).all() and np.isfinite(costs.density).any():
        raise ConfigError("this export needs a covariance field; use Costmap.from_field")
