"""The command that draws fields, also as the paper does, and matches at a place."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

from cyclopts import Parameter
from cyclopts.validators import Number

import locplan
from locplan._util.files import PICTURES, check_target
from locplan._util.progress import working
from locplan.cli._field_options import FieldOptions
from locplan.cli._groups import XY, MapFile, Ranges, command, option_group
from locplan.cli._options import Computing
from locplan.cli._output import Target, say_written
from locplan.cli._robot_options import RobotOptions
from locplan.cli._values import check_has, given_of, parsed, two_numbers
from locplan.errors import ConfigError

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


@option_group("Options")
class FigureOptions:
    """The figure and how it is drawn."""

    figure: Literal["field", "e", "ellipses", "distribution", "models"] = "field"
    """Figure of a field (default), of the paper's e or ellipses, or of a place (--at)."""
    scalar: str | None = None
    """Scalar in the figure field: what degeneracy is made of by default, or e, position_std,
    position_rms, heading_std, ambiguity or entropy."""
    ranges: Ranges = None
    """Ranges of the lidar side by side in the figures e and ellipses, in metres."""
    limits: Annotated[Any, parsed(two_numbers, "LOW,HIGH")] = None
    """Ends of the colours of the figure e, in m² rad."""
    spacing: Annotated[float | None, Parameter(validator=Number(gte=0.1))] = None
    """Minimum distance between ellipses, in metres; 2 by default."""
    magnify: Annotated[float | None, Parameter(validator=Number(gte=0.01))] = None
    """Factor by which ellipses are enlarged."""
    at: XY = None
    """Place of the figures distribution and models (all seven), x,y in metres."""
    axis: Literal["x", "y", "theta"] | None = None
    """Axis along which the models are drawn; x by default."""

    def own(self) -> dict[str, Any]:
        """Arguments of the figure's function."""
        given = given_of(self)
        del given["figure"]
        for name in given:
            check_has(
                name, "--figure", self.figure, [n for n, read in READ.items() if name in read]
            )
        if "at" in READ[self.figure] and "at" not in given:
            raise ConfigError(f"--figure {self.figure} needs --at X,Y")
        given.pop("ranges", None)
        return {"axis": "x"} | given if self.figure == "models" else given


@option_group("Output")
class Picture:
    """Where the picture goes."""

    output: Annotated[Path, Target]
    """File for the picture (.png, .pdf, .svg)."""


@app.default
def plot(
    map_file: MapFile,
    /,
    *,
    out: Picture,
    shown: FigureOptions = FigureOptions(),
    robot_options: RobotOptions = RobotOptions(),
    options: FieldOptions = FieldOptions(),
    computing: Computing = Computing(),
) -> None:
    """Draw the map with its field, or how well a place matches its surroundings."""
    _, configs = options.to_configs(robot_options, shown.ranges)
    given, name = shown.own(), shown.figure
    check_target(out.output, *PICTURES)
    grid = locplan.load_map(map_file)
    if "at" in READ[name]:
        estimator: Any = configs[0].estimator
        if estimator.name != "sad":
            raise ConfigError(f"--figure {name} is of --estimator sad")
        drawn = locplan.paper.place_figure(grid, estimator=estimator, **given)
    else:
        compute = computing.field
        drawn = locplan.plotting.figure_of(grid, name, configs, compute=compute, **given)
    with working("drawing"):
        locplan.plotting.save_figure(drawn, out.output)
    say_written(out.output)
