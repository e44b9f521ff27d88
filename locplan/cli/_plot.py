"""The command that draws fields, also as the paper does, and matches at a place."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Parameter
from cyclopts.validators import Number

from locplan.cli._groups import GENERAL, MapFile, Text, command, option_group, results
from locplan.cli._kinds import check_has, given_of
from locplan.cli._options import Computing, FieldOptions
from locplan.cli._robot_options import RobotOptions
from locplan.cli._values import load, say_written, two_numbers
from locplan.errors import ConfigError

if TYPE_CHECKING:
    from locplan.field import FieldConfig

app = command(
    "plot",
    "plot lab.yaml -o heading.png --scalar heading_std",
    "plot lab.yaml -o ellipses.png --figure ellipses --ranges 6,8",
    "plot lab.yaml -o models.png --figure models --at 2,3 --axis theta",
)


READ = {
    "field": ("scalar",),
    "e": ("ranges", "limits"),
    "ellipses": ("ranges", "spacing", "magnify"),
    "distribution": ("at",),
    "models": ("at", "axis"),
}
"""The options that each figure reads."""
OF_PLACE = ("distribution", "models")
"""Figures of a place."""


@option_group(GENERAL)
class FigureOptions:
    """The figure and how it is drawn."""

    figure: Literal["field", "e", "ellipses", "distribution", "models"] = "field"
    """Figure of a field (default), of the paper's e or ellipses, or of a place (--at)."""
    scalar: str | None = None
    """Scalar in the figure field: what degeneracy is made of by default, or e, position_std,
    position_rms, heading_std, ambiguity or entropy."""
    ranges: Annotated[str | None, Parameter(metavar="R1,R2")] = None
    """Ranges of the lidar side by side in the figures e and ellipses, in metres."""
    limits: Annotated[Text | None, Parameter(metavar="LOW,HIGH")] = None
    """Ends of the colours of the figure e, in m² rad."""
    spacing: Annotated[float | None, Parameter(validator=Number(gte=0.1))] = None
    """Least distance between ellipses, in metres; 2 by default."""
    magnify: Annotated[float | None, Parameter(validator=Number(gte=0.01))] = None
    """Factor by which ellipses are enlarged."""
    at: Annotated[Text | None, Parameter(metavar="X,Y")] = None
    """Place of the figures distribution and models (all seven), x,y in metres."""
    axis: Literal["x", "y", "theta"] | None = None
    """Axis along which the models are drawn; x by default."""

    def own(self) -> dict[str, Any]:
        """Arguments of the figure's function."""
        given = given_of(self)
        figure = given.pop("figure")
        for name in given:
            check_has(
                f"--{name}", "--figure", figure, [each for each in READ if name in READ[each]]
            )
        given.pop("ranges", None)
        given |= {n: two_numbers(n, given[n]) for n in ("at", "limits") if n in given}
        if figure in OF_PLACE and "at" not in given:
            raise ConfigError(f"--figure {figure} needs --at X,Y")
        return {"axis": "x"} | given if figure == "models" else given


@app.default
def plot(
    map_file: MapFile,
    /,
    *,
    output: Annotated[Path, results("File for the picture (.png, .pdf, .svg).")],
    shown: FigureOptions = FigureOptions(),
    robot_options: RobotOptions = RobotOptions(),
    options: FieldOptions = FieldOptions(),
    computing: Computing = Computing(),
) -> None:
    """Draw the map with its field, or how well a place matches its surroundings."""
    from locplan import paper, plotting
    from locplan._util.files import PICTURES, check_target
    from locplan._util.progress import working

    _, configs = options.to_configs(robot_options, shown.ranges)
    given = shown.own()
    check_target(output, *PICTURES)
    grid = load(map_file)
    if shown.figure in OF_PLACE:
        drawn = paper.place_figure(grid, estimator=_sad(shown.figure, configs[0]), **given)
    else:
        drawn = plotting.figure_of(grid, shown.figure, configs, compute=computing.field, **given)
    with working("drawing"):
        plotting.save_figure(drawn, output)
    say_written(output)


def _sad(figure: str, config: FieldConfig) -> Any:
    """The estimator of the settings, if it is one with a template."""
    if config.estimator.name != "sad":
        raise ConfigError(f"--figure {figure} is of --estimator sad")
    return config.estimator
