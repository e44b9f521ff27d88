"""The command that draws fields, also as the paper does, and matches at a place."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

from cyclopts import Parameter
from cyclopts.validators import Number

from locplan.cli._groups import GENERAL, MapFile, Text, command, option_group, results
from locplan.cli._kinds import check_has, given_of
from locplan.cli._options import Computing, FieldOptions
from locplan.cli._robot_options import RobotOptions
from locplan.cli._values import load, say_written, two_numbers
from locplan.errors import ConfigError

app = command(
    "plot",
    "plot lab.yaml -o heading.png --scalar heading_std",
    "plot lab.yaml -o ellipses.png --figure ellipses --ranges 6,8",
    "plot lab.yaml -o models.png --figure models --at 2,3 --axis theta",
)


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


READ = {
    "field": ("scalar",),
    "e": ("ranges", "limits"),
    "ellipses": ("ranges", "spacing", "magnify"),
    "distribution": ("at",),
    "models": ("at", "axis"),
}
"""The options that each figure reads."""


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
    from locplan._util.working import working
    from locplan.field import SCALARS
    from locplan.paper.template_matching import along_axis, mismatch

    given = given_of(shown)
    figure, scalar = given.pop("figure"), given.get("scalar")
    for name in given:
        check_has(f"--{name}", "--figure", figure, [each for each in READ if name in READ[each]])
    _, configs = options.to_configs(robot_options, shown.ranges)
    estimator: Any = configs[0].estimator
    at_a_place = figure in ("distribution", "models")
    known = [*SCALARS, *(layer.name for layer in estimator.layers)]
    if scalar is not None and scalar not in known:
        more = "" if estimator.layers else "; ambiguity and entropy are of scan and fused"
        raise ConfigError(f"--scalar must be one of {', '.join(known)}, not {scalar!r}{more}")
    if at_a_place and estimator.name != "sad":
        raise ConfigError(f"--figure {figure} is of --estimator sad")
    check_target(output, *PICTURES)
    place = two_numbers("at", shown.at) if shown.at else None
    colours = two_numbers("limits", shown.limits) if shown.limits else None
    if colours and colours[0] >= colours[1]:
        raise ConfigError(f"--limits must rise, not {shown.limits!r}")
    if at_a_place and place is None:
        raise ConfigError(f"--figure {figure} needs --at X,Y")
    grid, axis = load(map_file), shown.axis or "x"
    if at_a_place and place:
        x, y = place
        title = f"{grid.name} at {x:g}, {y:g} m, range {estimator.range:g} m"
        if figure == "models":
            lines = along_axis(grid, *place, axis, estimator)
            drawn = paper.models_figure(*lines, axis, title)
        else:
            window = estimator.lattice(grid.resolution)
            drawn = paper.distribution_figure({title: mismatch(grid, *place, estimator)}, window)
    else:
        fields = {f"{grid.name}: {c.summary}": computing.field(grid, c) for c in configs}
        if figure == "e":
            drawn = plotting.e_figure(fields, colours)
        elif figure == "ellipses":
            drawn = plotting.ellipses_figure(
                fields, **{k: v for k, v in given.items() if k != "ranges"}
            )
        else:
            drawn = plotting.field_figure(next(iter(fields.values())), scalar)
    with working("drawing"):
        plotting.save_figure(drawn, output)
    say_written(output)
