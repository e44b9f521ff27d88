"""Figures of matplotlib: their style, captions, logarithmic ticks, and images of many cells."""

from __future__ import annotations

import math
import os
import re
import textwrap
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path as FilePath
from typing import Any, NamedTuple

import matplotlib.patheffects as effects
import numpy as np
from matplotlib import colormaps, rc_context
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colorbar import Colorbar
from matplotlib.colors import ListedColormap, LogNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from matplotlib.text import Text
from matplotlib.ticker import FuncFormatter, Locator, MaxNLocator, NullFormatter
from matplotlib.transforms import Affine2D, Bbox, IdentityTransform

from locplan._support.checks import make_printable
from locplan._support.files import PICTURES, check_writable_file
from locplan._support.kernels.arrays import Floats, Octets
from locplan._support.output import replace_file
from locplan._support.public import render_png
from locplan._support.records import FILE_DPI

BLUE, VERMILION, GREEN, PURPLE = "#0072b2", "#d55e00", "#009e73", "#cc79a7"
ORANGE, SKY, YELLOW = "#e69f00", "#56b4e9", "#f0e442"
RED, AMBER, TEAL = "#c62828", "#b26a00", "#00796b"
"""Colours that colour-blind people can tell apart (Okabe and Ito), and three darker ones."""
RECOMMENDED = BLUE
"""Colour of the recommended path."""


class LineStyle(NamedTuple):
    """Colour and dashes of a line, as matplotlib takes them."""

    color: Any
    linestyle: Any = "-"


PATH_STYLES: tuple[LineStyle, ...] = (
    LineStyle("black", (0, (4, 1.5))),
    LineStyle(RECOMMENDED),
    LineStyle(GREEN, (0, (1, 1))),
    LineStyle(PURPLE, (0, (6, 1, 1, 1))),
)
"""Line styles of several paths in turn, the shortest first; they differ in dashes and colour."""
ZONE_STYLES: dict[str, dict[str, Any]] = {
    "no-go": {"edgecolor": RED, "facecolor": (RED, 0.25), "hatch": "////", "linewidth": 0.8},
    "slow": {"edgecolor": AMBER, "fill": False, "linestyle": (0, (4, 2)), "linewidth": 1.8},
    "prefer": {"edgecolor": TEAL, "fill": False, "linestyle": (0, (1, 1.2)), "linewidth": 1.8},
}
"""Styles of zones by their kind; they differ in filling, dashes and colour."""
MAP_COLOURS = ListedColormap(["black", "0.82", "white", "0.6"])
"""Colours of occupied, unknown and free cells, and of the inside of what is solid."""
LIGHT_MAP_COLOURS = ListedColormap(["0.45", "0.9", "white", "0.7"])
"""The colours of `MAP_COLOURS`, lighter, for maps below much that is drawn."""
PALE_MAP_COLOURS = ListedColormap(["0.72", "0.92", "white", "0.72"])
"""The colours of `MAP_COLOURS`, paler than thin lines on them."""
FIELD_COLOURS = ListedColormap(colormaps["magma_r"](np.linspace(0.0, 0.8, 256)))
"""Colours of fields, never as dark as a wall; `theme.js` of the explorer's page has them, too."""
ERROR_COLOURS = ListedColormap(colormaps["magma_r"](np.linspace(0.2, 0.85, 256)))
"""Colours of lines by their error; dark is bad, as in fields, and none is pale on white."""
MIN_ERROR = 0.02
"""Smallest error with a colour of its own; smaller ones are drawn in the same colour [m]."""
PREVIEW_DPI = 110
"""Pixels an inch of the pictures beside exported files."""


def make_white_outline(width: float = 4) -> list[Any]:
    """Return the effects of a white outline around a line or a text.

    Parameters
    ----------
    width : float, default 4
        Width of line and outline together [points].

    Returns
    -------
    list of matplotlib.patheffects.AbstractPathEffect
        The effects of a line or a text.
    """
    return [effects.Stroke(linewidth=width, foreground="white"), effects.Normal()]


MIN_TICKS, MAX_TICKS = 3, 8
"""Number of ticks that tell a scale, and that are read."""


class NotebookFigure(Figure):
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
        with _ignore_missing_glyphs():
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
            if engine is not None and not options.get("bbox_inches"):
                # One layout leaves the title of a map with a colour bar above the picture's edge.
                with _ignore_missing_glyphs():
                    self._show_texts_as_they_are()
                    engine.execute(self)
            super().savefig(fname, **options)
            return
        # matplotlib draws it all to find its size, and throws that away.
        before, dpi = self.dpi, options.get("dpi", self.dpi)
        try:
            self.dpi = dpi
            canvas: Any = FigureCanvasAgg(self)
            renderer = canvas.get_renderer()
            self._show_texts_as_they_are()
            with _ignore_missing_glyphs():
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

    def key(
        self,
        handles: Sequence[Artist],
        ncols: int = 1,
        at: str = "lower center",
        caption: Sequence[str] = (),
    ) -> None:
        """Draw a legend outside all Axes.

        Parameters
        ----------
        handles : sequence of matplotlib.artist.Artist
            The explained artists, with labels.
        ncols : int, default 1
            Number of its columns.
        at : str, default "lower center"
            The side of the figure, as matplotlib names it.
        caption : sequence of str, default ()
            Lines above it, wrapped to the figure's width.
        """
        place: Any = f"outside {at}"
        title = self._wrap_lines(caption)
        self.legend(handles=handles, loc=place, ncols=ncols, frameon=False, title=title)

    def title(self, *lines: str) -> None:
        """Draw a title, with lines wrapped to the figure's width.

        Parameters
        ----------
        *lines : str
            Its lines.
        """
        self.suptitle(self._wrap_lines(lines), fontsize="medium")

    def _wrap_lines(self, lines: Sequence[str]) -> str:
        return "\n".join(part for line in lines for part in break_title(line, self.get_figwidth()))

    def _show_texts_as_they_are(self) -> None:
        numbers = {id(text) for axis in self.findobj(Axis) for text in _find_tick_texts(axis)}
        for text in self.findobj(Text):
            if id(text) not in numbers:
                text.set_parse_math(False)
                text.set_text("\n".join(map(make_printable, text.get_text().split("\n"))))

    def _repr_png_(self) -> bytes:
        return render_png(self)


UNIT_SPACE = re.compile(r"(?<=\d) (?=(?:m|cm|s|deg|%)(?!\w))|(?<=%) (?=\[)|(?<=\d,) (?=-?\d+\])")
"""Spaces before a unit, before an interval, and in an interval."""


def break_title(text: str, width: float) -> list[str]:
    """Wrap a text to lines of about equal length; a number stays with its unit and its interval.

    Parameters
    ----------
    text : str
        The text.
    width : float
        Maximum width of a line [inch].
    """
    max_letters = int(11.5 * width)  # the number of letters that fit within an inch
    text = UNIT_SPACE.sub("\u00a0", text)
    count = len(textwrap.wrap(text, max_letters, break_on_hyphens=False))
    longest = max(1, *map(len, text.split(" ")))
    broken_titles = (
        textwrap.wrap(text, letters, break_on_hyphens=False)
        for letters in range(min(longest, max_letters), max_letters + 1)
    )
    lines = next(lines for lines in broken_titles if len(lines) <= count)
    return [line.replace("\u00a0", " ") for line in lines]


@contextmanager
def _ignore_missing_glyphs() -> Iterator[None]:
    """Suppress matplotlib's warnings of characters that the font lacks."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph .* missing from font", UserWarning)
        yield


def _find_tick_texts(axis: Any) -> list[Text]:
    """Return the texts of an axis that matplotlib creates."""
    ticks = [*axis.get_major_ticks(), *axis.get_minor_ticks()]
    labels = [label for tick in ticks for label in (tick.label1, tick.label2)]
    return [*labels, axis.get_offset_text()]


class RoundNumberLocator(Locator):
    """Ticks of a logarithmic axis at 1, 2, 5, 10 and so on; evenly spaced on short axes."""

    def __init__(self, max_ticks: int = MAX_TICKS) -> None:
        self.max_ticks = max_ticks

    def __call__(self) -> Any:
        """Find the ticks of the axis; matplotlib calls it."""
        assert self.axis is not None
        return self.tick_values(*self.axis.get_view_interval())

    def tick_values(self, vmin: float, vmax: float) -> Any:
        """Find the ticks between two values."""
        return choose_round_ticks(min(vmin, vmax), max(vmin, vmax), self.max_ticks)


def choose_round_ticks(low: float, high: float, max_ticks: int = MAX_TICKS) -> Floats:
    """Return at most `max_ticks` round numbers from `low` to `high` for a logarithmic scale."""
    if not (0 < low < high and math.isfinite(high)):
        return np.array([low])
    powers = 10.0 ** np.arange(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    within = low * (1 - 1e-9), high * (1 + 1e-9)
    ticks = np.array([])
    # What the numbers may begin with, few first.
    for digits in ((1,), (1, 3), (1, 2, 5), (1, 1.5, 2, 3, 5, 7)):
        round_values = np.sort(np.outer(powers, digits).ravel())
        round_values = round_values[(within[0] <= round_values) & (round_values <= within[1])]
        if len(round_values) > max_ticks:
            # Decades are left out where even they are too many.
            return (
                ticks
                if len(ticks) >= MIN_TICKS
                else round_values[:: -(-len(round_values) // max_ticks)]
            )
        ticks = round_values
        if len(ticks) >= MIN_TICKS + 1:
            return ticks
    for count in range(MIN_TICKS + 1, max_ticks + 1):
        if len(ticks) >= MIN_TICKS:
            break
        ticks = np.asarray(MaxNLocator(count, steps=[1, 2, 5, 10]).tick_values(low, high))
        ticks = ticks[(within[0] <= ticks) & (ticks <= within[1])]
    return ticks


def label_with_plain_numbers(axis: Axis, max_ticks: int = MAX_TICKS) -> None:
    """Label a logarithmic axis with plain numbers.

    Parameters
    ----------
    axis : matplotlib.axis.Axis
        The axis.
    max_ticks : int, default 8
        Maximum number of ticks.
    """
    axis.set_major_locator(RoundNumberLocator(max_ticks))
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
    label_with_plain_numbers(axis, max_ticks)


def draw_field_bar(
    figure: Figure, image: AxesImage, axes: Any, label: str, **options: Any
) -> Colorbar:
    """Draw the colour bar of a field, with ticks at 1, 2 and 5 of each decade."""
    low, high = image.get_clim()
    values = image.get_array()
    has_larger_values = values is not None and high is not None and values.max() > 1.001 * high
    extend = "max" if has_larger_values else "neither"
    bar = figure.colorbar(image, ax=axes, label=label, extend=extend, **options)
    if isinstance(image.norm, LogNorm) and low and high:
        if (low >= 0.1 and high <= 10_000) or high < 500 * low:  # few decades
            label_with_plain_numbers(bar.ax.yaxis)
        else:
            bar.ax.yaxis.set_major_formatter(FuncFormatter(_format_power_of_ten))
            bar.ax.yaxis.set_minor_formatter(NullFormatter())
    return bar


def _format_power_of_ten(value: float, _: object) -> str:
    """Return a power of ten in plain characters, since matplotlib's formulas take 0.3 s."""
    superscripts = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
    return f"10{str(round(math.log10(value))).translate(superscripts)}"


def draw_number(
    axes: Axes,
    number: int,
    position: tuple[float, float],
    offset: tuple[float, float],
    color: str,
    **style: Any,
) -> None:
    """Draw a number in a circle next to a position, connected by a line.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
        The Axes to draw on.
    number : int
        The number.
    position : (x, y)
        World position of the place [m].
    offset : (x, y)
        Distance of the number from it [points].
    color : str
        Colour of the circle and the line.
    **style
        Text properties of matplotlib.
    """
    centred: dict[str, Any] = {"ha": "center", "va": "center", "fontsize": 7, "zorder": 5} | style
    axes.annotate(
        str(number),
        position,
        offset,
        textcoords="offset points",
        bbox={"boxstyle": "circle,pad=0.15", "facecolor": "white", "edgecolor": color},
        arrowprops={"arrowstyle": "-", "color": color, "linewidth": 0.8, "shrinkA": 0},
        **centred,
    )


class CellImage(AxesImage):
    """An image of matplotlib that is coloured cell by cell, and then scaled by OpenCV.

    Matplotlib scales four times as many bytes, several times over, in ten times the time.
    """

    def get_window_extent(self, renderer: Any = None) -> Bbox:
        """Bounds of the image in pixels, whichever way the map is turned."""
        x0, x1, y0, y1 = self.get_extent()
        corners = self.get_transform().transform([(x0, y0), (x1, y0), (x0, y1), (x1, y1)])
        return Bbox([corners.min(axis=0), corners.max(axis=0)])

    def make_image(
        self, renderer: Any, magnification: float = 1.0, unsampled: bool = False
    ) -> tuple[Any, float, float, Any]:
        """Scale the image to the pixels of the Axes; matplotlib calls it."""
        import cv2

        colours = self._compute_cell_colours()
        visible_box = Bbox.intersection(self.get_window_extent(), self.axes.bbox)
        if unsampled or colours is None or visible_box is None:
            return super().make_image(renderer, magnification, unsampled)
        (left, bottom), (right, top) = magnification * visible_box.get_points()
        left, bottom = math.floor(left + 0.5), math.ceil(bottom - 0.5)
        size = math.floor(right + 0.5) - left, math.ceil(top - 0.5) - bottom
        if min(size) < 1:
            return None, 0, 0, None
        # From the centre of a pixel to the centre of a cell, both counted from those of the first.
        x0, x1, y0, y1 = self.get_extent()
        height, width = colours.shape[:2]
        to_pixels = (
            Affine2D()
            .translate(0.5, 0.5)
            .scale((x1 - x0) / width, (y1 - y0) / height)
            .translate(x0, y0)
            + self.get_transform()
            + Affine2D().scale(magnification).translate(-left - 0.5, -bottom - 0.5)
        )
        to_cells = to_pixels.inverted().get_matrix()
        nearest = cv2.INTER_NEAREST | cv2.WARP_INVERSE_MAP
        pixels = cv2.warpAffine(colours, to_cells[:2], size, flags=nearest)
        cells_a_pixel = float(np.hypot(*to_cells[0, :2]))
        # Cells of three pixels and more have sharp edges.
        if self.get_interpolation() != "nearest" and cells_a_pixel > 1 / 3:
            cells = round(cells_a_pixel)
            mixed = cv2.blur(colours, (cells, cells)) if cells > 1 else colours
            to_cells[:2, 2] += 0.5 * (cells % 2 == 0)  # a mean of two cells stands at the second
            smooth = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
            around = cv2.BORDER_REPLICATE
            mixed = cv2.warpAffine(mixed, to_cells[:2], size, flags=smooth, borderMode=around)
            # The darker of both: no pixel of a wall is lighter beside a field that has sharp edges.
            pixels[..., :3] = np.minimum(mixed, pixels)[..., :3]
        return pixels, left / magnification, bottom / magnification, IdentityTransform()

    def _compute_cell_colours(self) -> Octets | None:
        """Colours of the cells, (h, w, 4); None where matplotlib is to find them itself."""
        values, (low, high) = self.get_array(), self.get_clim()
        if values is None or values.ndim != 2 or low is None or high is None:
            return None
        if values.dtype == np.uint8:
            byte_colours = self.to_rgba(np.arange(256), bytes=True)
            words = byte_colours.view(np.uint32)[:, 0][np.ma.getdata(values)]
            return np.asarray(words.view(np.uint8).reshape(*values.shape, 4))
        shares = np.ma.filled(values.astype(np.float32), np.nan)
        if type(self.norm) is LogNorm:
            with np.errstate(divide="ignore", invalid="ignore"):
                np.log(shares, out=shares)
            low, high = math.log(low), math.log(high)
        elif type(self.norm) is not Normalize:
            return None
        shares -= np.float32(low)
        shares *= np.float32(1 / (high - low)) if high > low else np.float32(0)
        return np.asarray(self.cmap(shares, bytes=True))


def save_figure(figure: Figure, path: str | os.PathLike[str], *, dpi: int = FILE_DPI) -> None:
    """Write a figure, whole or not at all.

    Parameters
    ----------
    figure : matplotlib.figure.Figure
        The figure.
    path : path
        The file, whose suffix chooses the format: .png, .pdf or .svg. One that is there is
        replaced.
    dpi : int, default 130
        Pixels an inch of a .png; more make a larger and sharper picture.

    Raises
    ------
    LocplanError
        If the suffix is another, or the file cannot be written.
    """
    check_writable_file(FilePath(path), *PICTURES)
    suffix = FilePath(path).suffix.lower().lstrip(".")
    with replace_file(path) as temporary:
        # matplotlib's writer of PDFs hides an error of the disk behind one of its own
        target = BytesIO() if suffix == "pdf" else temporary
        figure.savefig(target, dpi=dpi, format=suffix, bbox_inches="tight", pad_inches=0.1)
        if isinstance(target, BytesIO):
            temporary.write_bytes(target.getvalue())
