"""Figures that show names as they are, their captions and logarithmic ticks.

A notebook shows them by itself. Ticks are plain numbers, as many as tell a scale and have room.
"""

from __future__ import annotations

import math
import textwrap
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colorbar import Colorbar
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from matplotlib.text import Text
from matplotlib.ticker import FuncFormatter, Locator, MaxNLocator, NullFormatter

from locplan._kernels.arrays import Floats
from locplan._util.checks import printable
from locplan._util.public import png_of
from locplan.costs import DEGENERATE, Costmap
from locplan.field import CovarianceField
from locplan.planners import Plan
from locplan.robots import format_radius

MIN_TICKS, MAX_TICKS = 3, 8
"""Number of ticks that tell a scale, and that are read."""
HARMLESS = 1 / 3
"""The u up to which no place of a map is a weak spot."""


class Picture(Figure):
    """A figure of matplotlib that a notebook shows when a cell returns it.

    Its texts are shown as they are, but for the numbers at its axes: a map's name may hold signs
    of formulas, such as $, bytes that are no text, and characters that the font has not.
    """

    _laid_out = False

    def draw(self, renderer: Any) -> None:
        """Draw the figure; matplotlib calls it.

        Parameters
        ----------
        renderer : matplotlib.backend_bases.RendererBase
            The renderer of a backend.
        """
        if not self._laid_out:
            self._show_texts_as_they_are()
        with _any_glyphs():
            super().draw(renderer)

    def savefig(self, fname: Any, **options: Any) -> None:
        """Write the figure as matplotlib does, but draw an image that is cut to size only once.

        Parameters
        ----------
        fname : path or file
            The file; see ``matplotlib.figure.Figure.savefig``.
        **options
            Options of ``matplotlib.figure.Figure.savefig``.
        """
        engine, cut = self.get_layout_engine(), {"format": "png", "bbox_inches": "tight"}
        if engine is None or any(options.get(name) != value for name, value in cut.items()):
            super().savefig(fname, **options)
            return
        # matplotlib draws it all to find its size, and throws that away.
        before, dpi = self.dpi, options.get("dpi", self.dpi)
        try:
            self.dpi = dpi
            canvas: Any = FigureCanvasAgg(self)
            renderer = canvas.get_renderer()
            self._show_texts_as_they_are()
            with _any_glyphs():
                engine.execute(self)
                box = self.get_tightbbox(renderer).padded(options.pop("pad_inches", 0.1))
            # With these settings alone a figure can have no layout engine.
            settings = ("figure.autolayout", "figure.constrained_layout.use")
            with rc_context(dict.fromkeys(settings, False)):  # type: ignore[arg-type]
                self.set_layout_engine(None)
            self._laid_out = True
            super().savefig(fname, **options | {"bbox_inches": box, "dpi": dpi})
        finally:
            self._laid_out = False
            self.dpi = before
            self.set_layout_engine(engine)

    def key(self, handles: Sequence[Artist], ncols: int = 1, at: str = "lower center") -> None:
        """Draw a legend beside all Axes.

        Parameters
        ----------
        handles : sequence of matplotlib.artist.Artist
            What it explains, with labels.
        ncols : int, default 1
            Number of its columns.
        at : str, default "lower center"
            The side of the figure, as matplotlib names it.
        """
        place: Any = f"outside {at}"
        self.legend(handles=handles, loc=place, ncols=ncols, frameon=False)

    def title(self, *lines: str) -> None:
        """Draw a title, whose lines are broken where the figure is narrower.

        Parameters
        ----------
        *lines : str
            Its lines.
        """
        filled = (part for each in lines for part in lines_within(each, self.get_figwidth()))
        self.suptitle("\n".join(filled), fontsize="medium")

    def _show_texts_as_they_are(self) -> None:
        numbers = {id(text) for axis in self.findobj(Axis) for text in _numbers_of(axis)}
        for text in self.findobj(Text):
            if id(text) not in numbers:
                text.set_parse_math(False)
                text.set_text("\n".join(map(printable, text.get_text().split("\n"))))

    def _repr_png_(self) -> bytes:
        return png_of(self)


def lines_within(text: str, width: float) -> list[str]:
    """The lines of a text in a figure, about as long as each other: none has a word left over.

    Parameters
    ----------
    text : str
        The text.
    width : float
        Maximum width of a line [inch].
    """
    most = int(11.5 * width)  # the number of letters that fit within an inch
    count = len(textwrap.wrap(text, most, break_on_hyphens=False))
    longest = max(map(len, text.split()), default=1)
    made = (
        textwrap.wrap(text, letters, break_on_hyphens=False)
        for letters in range(min(longest, most), most + 1)
    )
    return next(lines for lines in made if len(lines) <= count)


@contextmanager
def _any_glyphs() -> Iterator[None]:
    """Keep matplotlib from warning of characters that the font has not."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph .* missing from font", UserWarning)
        yield


def _numbers_of(axis: Any) -> list[Text]:
    """The texts of an axis that matplotlib makes."""
    ticks = [*axis.get_major_ticks(), *axis.get_minor_ticks()]
    labels = [label for tick in ticks for label in (tick.label1, tick.label2)]
    return [*labels, axis.get_offset_text()]


def weak_spots(field: CovarianceField, values: Any, name: str | None = None) -> str:
    """Share of a map's values, in the unit that is shown, whose u is 0.5 or more.

    Where no u is as high, the greatest value; where none is above a third, that nothing is weak.
    """
    shown, name = field.quantity(name), name or field.config.estimator.criterion
    values = np.ma.filled(values, np.nan)
    known = values[np.isfinite(values)]
    if not known.size:
        return "nothing is known"
    low, high = (shown.factor * anchor for anchor in field.anchors(name))

    def value(u: float) -> float:
        return low + u * (high - low) if name in field.layers else low * (high / low) ** u

    unit = f" {shown.unit}" if shown.unit != "1" else ""
    least = value(DEGENERATE)
    share, greatest = float(np.mean(known >= least)), float(known.max())
    if share == 0:
        none = "no weak spot: " if greatest < value(HARMLESS) else ""
        return f"{none}at most {greatest:.2g}{unit}"
    said = "under 1%" if share < 0.01 else f"{share:.0%}"
    return f"{said} weak ({least:.2g}{unit} or more)"


def request(costs: Costmap, plans: Mapping[str, Plan]) -> str:
    """Weight, limits, footprint and robot radius that the plans were made with."""
    asked = [f"weight {costs.weight:g}"]
    for plan in plans.values():
        if plan.budget is not None:
            asked = [f"budget {plan.budget:g} m"]
        if plan.max_e is not None:
            asked.append(f"e at most {plan.max_e:g}")
        if plan.footprint is not None and "footprint" not in asked:
            asked.append("footprint")
    radius = format_radius(costs.robot, costs.robot_radius)
    return ", ".join([*asked, f"robot radius {radius}"])


class RoundNumbers(Locator):
    """Ticks of a logarithmic axis at 1, 2, 5, 10 and so on, or evenly where it is short."""

    def __init__(self, most: int = MAX_TICKS) -> None:
        self.most = most

    def __call__(self) -> Any:
        """Find the ticks of the axis; matplotlib calls it."""
        assert self.axis is not None
        return self.tick_values(*self.axis.get_view_interval())

    def tick_values(self, vmin: float, vmax: float) -> Any:
        """Find the ticks between two values."""
        return round_numbers(min(vmin, vmax), max(vmin, vmax), self.most)


def round_numbers(low: float, high: float, most: int = MAX_TICKS) -> Floats:
    """Round numbers from `low` to `high` for a logarithmic scale, at most `most` of them."""
    if not (0 < low < high and math.isfinite(high)):
        return np.array([low])
    powers = 10.0 ** np.arange(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    within = low * (1 - 1e-9), high * (1 + 1e-9)
    found = np.array([])
    # What the numbers may begin with, few first.
    for digits in ((1,), (1, 3), (1, 2, 5), (1, 1.5, 2, 3, 5, 7)):
        every = np.sort(np.outer(powers, digits).ravel())
        every = every[(within[0] <= every) & (every <= within[1])]
        if len(every) > most:
            # Decades are left out where even they are too many.
            return found if len(found) >= MIN_TICKS else every[:: -(-len(every) // most)]
        found = every
        if len(found) >= MIN_TICKS + 1:
            return found
    for count in range(MIN_TICKS + 1, most + 1):
        if len(found) >= MIN_TICKS:
            break
        found = np.asarray(MaxNLocator(count, steps=[1, 2, 5, 10]).tick_values(low, high))
        found = found[(within[0] <= found) & (found <= within[1])]
    return found


def label_plainly(axis: Axis, max_ticks: int = MAX_TICKS) -> None:
    """Label a logarithmic axis with plain numbers.

    Parameters
    ----------
    axis : matplotlib.axis.Axis
        The axis.
    max_ticks : int, default 8
        Maximum number of ticks.
    """
    axis.set_major_locator(RoundNumbers(max_ticks))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:.6g}"))
    axis.set_minor_formatter(NullFormatter())


def make_logarithmic(axis: Any, max_ticks: int = MAX_TICKS) -> None:
    """Make an axis of matplotlib logarithmic, with plain numbers.

    Parameters
    ----------
    axis : matplotlib.axis.Axis
        The axis.
    max_ticks : int, default 8
        Maximum number of ticks.
    """
    getattr(axis.axes, f"set_{axis.axis_name}scale")("log")
    label_plainly(axis, max_ticks)


def field_bar(figure: Figure, image: AxesImage, axes: Any, label: str, **options: Any) -> Colorbar:
    """The colour bar of a field; deviations have plain numbers at 1, 2 and 5 of each decade."""
    low, high = image.get_clim()
    values = image.get_array()
    beyond = values is not None and high is not None and values.max() > 1.001 * high
    extend = "max" if beyond else "neither"
    bar = figure.colorbar(image, ax=axes, label=label, extend=extend, **options)
    if isinstance(image.norm, LogNorm) and low and high:
        if (low >= 0.1 and high <= 10_000) or high < 500 * low:  # few decades
            label_plainly(bar.ax.yaxis)
        else:
            bar.ax.yaxis.set_major_formatter(FuncFormatter(_power_of_ten))
            bar.ax.yaxis.set_minor_formatter(NullFormatter())
    return bar


def _power_of_ten(value: float, _: object) -> str:
    """10 to a power in plain characters; matplotlib's own formulas take 0.3 s to begin with."""
    raised = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
    return f"10{str(round(math.log10(value))).translate(raised)}"


def draw_number(
    axes: Axes,
    number: int,
    at: tuple[float, float],
    aside: tuple[float, float],
    color: str,
    **style: Any,
) -> None:
    """Draw a number in a circle beside a place, joined to it by a line.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
        The Axes to draw on.
    number : int
        The number.
    at : (x, y)
        World position of the place [m].
    aside : (x, y)
        How far the number stands from it [points].
    color : str
        Colour of the circle and the line.
    **style
        Changes of the text's style, as matplotlib has them.
    """
    centred: dict[str, Any] = {"ha": "center", "va": "center", "fontsize": 7, "zorder": 5} | style
    axes.annotate(
        str(number),
        at,
        aside,
        textcoords="offset points",
        bbox={"boxstyle": "circle,pad=0.15", "facecolor": "white", "edgecolor": color},
        arrowprops={"arrowstyle": "-", "color": color, "linewidth": 0.8, "shrinkA": 0},
        **centred,
    )
