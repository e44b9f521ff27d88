"""The command that draws fields, also as the paper does, and matches at a place."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

from cyclopts import Parameter
from cyclopts.validators import Number

from locplan.cli._groups import GENERAL, MapFile, Text, command, option_group, results
from locplan.cli._options import Computing, FieldOptions
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
    """The figure shows a field (default), the paper's e or ellipses, or a place (--at)."""
    scalar: str = "e"
    """The figure field shows e, position_std, position_rms, heading_std; ambiguity or entropy."""
    ranges: Annotated[str | None, Parameter(metavar="R1,R2")] = None
    """The figures e and ellipses show these ranges of the lidar side by side [m]."""
    limits: Annotated[Text | None, Parameter(metavar="LOW,HIGH")] = None
    """The colours of the figure e end here [m² rad]."""
    spacing: Annotated[float, Parameter(validator=Number(gte=0.1))] = 2.0
    """The ellipses are this far apart at least [m]; 2 by default."""
    magnify: Annotated[float, Parameter(validator=Number(gte=0.01))] = 1.0
    """The ellipses are drawn so many times as large."""
    at: Annotated[Text | None, Parameter(metavar="X,Y")] = None
    """The figures distribution and models (all seven) show the mismatch at this place [m]."""
    axis: Literal["x", "y", "theta"] = "x"
    """The models are drawn along this axis."""


@app.default
def plot(
    map_file: MapFile,
    /,
    *,
    output: Annotated[Path, results("The picture is written here (.png, .pdf, .svg).")],
    wanted: FigureOptions = FigureOptions(),
    options: FieldOptions = FieldOptions(),
    computing: Computing = Computing(),
) -> None:
    """Draw the map with its field, or how well a place matches its surroundings."""
    from locplan import paper, plotting
    from locplan._util.files import PICTURES, check_target
    from locplan.field import SCALARS
    from locplan.paper.template_matching import along_axis, mismatch
    from locplan.plotting._captions import how

    configs = options.to_configs(wanted.ranges)
    estimator: Any = configs[0].estimator
    figure, scalar = wanted.figure, wanted.scalar
    at_a_place = figure in ("distribution", "models")
    known = [*SCALARS, *(layer.name for layer in estimator.layers)]
    if scalar not in known:
        more = "" if estimator.layers else "; ambiguity and entropy are of --estimator scan"
        raise ConfigError(f"--scalar must be one of {', '.join(known)}, not {scalar!r}{more}")
    if at_a_place and estimator.name != "sad":
        raise ConfigError(f"--figure {figure} is of --estimator sad")
    if wanted.ranges and figure not in ("e", "ellipses"):
        raise ConfigError("--ranges is for --figure e and ellipses")
    check_target(output, *PICTURES)
    place = two_numbers("at", wanted.at) if wanted.at else None
    colours = two_numbers("limits", wanted.limits) if wanted.limits else None
    if colours and colours[0] >= colours[1]:
        raise ConfigError(f"--limits must rise, not {wanted.limits!r}")
    if at_a_place and place is None:
        raise ConfigError(f"--figure {figure} needs --at X,Y")
    grid = load(map_file)
    if at_a_place and place:
        x, y = place
        title = f"{grid.name} at {x:g}, {y:g} m, range {estimator.range:g} m"
        if figure == "models":
            lines = along_axis(grid, *place, wanted.axis, estimator)
            drawn = paper.models_figure(*lines, wanted.axis, title)
        else:
            window = estimator.window.on(grid.resolution)
            drawn = paper.distribution_figure({title: mismatch(grid, *place, estimator)}, window)
    else:
        fields = {
            f"{grid.name}: {how(c)}, range {c.estimator.reach:g} m": computing.field(grid, c)
            for c in configs
        }
        if figure == "e":
            drawn = plotting.e_figure(fields, colours)
        elif figure == "ellipses":
            drawn = plotting.ellipses_figure(fields, spacing=wanted.spacing, magnify=wanted.magnify)
        else:
            drawn = plotting.field_figure(next(iter(fields.values())), scalar)
    plotting.save_figure(drawn, output)
    say_written(output)
