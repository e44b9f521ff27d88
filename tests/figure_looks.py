"""What figures look like, in words: titles, axes, colours, widths and limits, but no pixels.

`check_looks` compares a figure with what `figure_looks.json` has below its name. After a change
that is meant, LOOKS=new in the environment lets the tests write that anew.
"""

from __future__ import annotations

import difflib
import itertools
import json
import numbers
import os
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.colors import to_hex

FILE = Path(__file__).with_suffix(".json")
NUMBER = re.compile(r"[-+]?(\d+(\.\d+)?|\.\d+)(e[-+]?\d+)?%?|\bnan\b|\binf\b")
STYLES = ("linewidth", "linestyle", "marker", "fontsize", "ha", "va", "rotation")
COLOURS = ("color", "facecolor", "edgecolor")
OF_MARKERS = ("markersize", "markeredgecolor", "markerfacecolor")


def check_looks(figure: Any, name: str) -> None:
    """Raise an AssertionError if a figure looks other than the one that is known by this name."""
    words = [*words_of(figure)]
    limits = [f"{low:.4g} {high:.4g}" for low, high in limits_of(figure)]
    looks = json.loads(FILE.read_text())
    if os.environ.get("LOOKS") == "new":
        looks[name] = {"words": words, "limits": limits}
        FILE.write_text(json.dumps(dict(sorted(looks.items())), indent=1) + "\n")
    known = looks[name]["words"]
    assert words == known, "\n".join(difflib.unified_diff(known, words, name, "now", lineterm=""))
    for pair in zip(looks[name]["limits"], limits, strict=True):
        (low, high), own = (tuple(map(float, each.split())) for each in pair)
        # What is simulated may differ a little from one machine to another.
        assert own == pytest.approx((low, high), abs=0.05 * abs(high - low) + 1e-4), name


def words_of(figure: Any) -> Iterator[str]:
    """A line for each thing in a figure, and one for those alike."""
    for part in (figure, *figure.subfigs):
        yield f"figure of {len(part.axes)} axes: {masked(part.get_suptitle())}"
        texts = (text for legend in part.legends for text in legend.get_texts())
        yield from (f"legend: {masked(text.get_text())}" for text in texts)
    for axes in figure.axes:
        yield from dict.fromkeys(words_of_axes(axes))


def words_of_axes(axes: Any) -> Iterator[str]:
    """A line for the titles of some axes, each axis and each artist."""
    titles = (axes.get_title(loc=side) for side in ("left", "center", "right"))
    yield f"axes: {', '.join(masked(title) for title in titles)}"
    for axis, label in ((axes.xaxis, axes.get_xlabel()), (axes.yaxis, axes.get_ylabel())):
        ticks = axis.get_major_formatter(), axis.get_major_locator()
        kinds = " ".join(type(each).__name__ for each in ticks)
        grid = {style(line) for line in axis.get_gridlines() if line.get_visible()}
        yield f" axis {masked(label)} {axis.get_scale()} {kinds} {' '.join(sorted(grid))}"
    for artist in artists_of(axes):
        label, kind = str(artist.get_label()), type(artist).__name__
        text = artist.get_text() if hasattr(artist, "get_text") else label
        text = "" if text.startswith("_") else text
        yield f" {kind} {style(artist)} {masked(text)}"
    if axes.get_legend():
        texts = axes.get_legend().get_texts()
        yield from (f" legend: {masked(text.get_text())}" for text in texts)


def artists_of(axes: Any) -> Iterator[Any]:
    """What is drawn on some axes."""
    return itertools.chain(axes.lines, axes.patches, axes.collections, axes.images, axes.texts)


def limits_of(figure: Any) -> Iterator[tuple[float, float]]:
    """The limits of each axis and of the values that colours stand for, and sizes of shapes."""
    for axes in figure.axes:
        yield from (axes.get_xlim(), axes.get_ylim())
        for artist in artists_of(axes):
            if has_values(artist) and None not in artist.get_clim():
                yield artist.get_clim()
            if hasattr(artist, "get_width"):
                yield from ((0.0, artist.get_width()), (0.0, artist.get_height()))


def has_values(artist: Any) -> bool:
    """Whether colours of an artist stand for values."""
    return hasattr(artist, "get_clim") and artist.get_array() is not None


def style(artist: Any) -> str:
    """Height, opacity, widths and colours of an artist."""
    alpha, found = artist.get_alpha(), [f"zorder={artist.get_zorder():g}"]
    names = [*STYLES, *([] if has_values(artist) else COLOURS)]
    if getattr(artist, "get_marker", lambda: "None")() not in ("None", None, ""):
        names += OF_MARKERS
    if has_values(artist):
        found.append(f"{artist.get_cmap().name} {type(artist.norm).__name__}")
    if alpha is not None and not np.ndim(alpha):
        found.append(f"alpha={alpha:g}")
    for name in names:
        value = getattr(artist, f"get_{name}", lambda: None)()
        if value is not None and not (hasattr(value, "__len__") and len(value) == 0):
            found.append(f"{name}={colours(value) if 'color' in name else shown(value)}")
    return " ".join(found)


def colours(value: Any) -> str:
    """A colour, or the different ones of a collection."""
    several = not isinstance(value, str) and np.ndim(value) == 2
    return ",".join(sorted({to_hex(each, True) for each in (value if several else [value])}))


def shown(value: Any) -> str:
    """A width or a style, or the different ones of a collection."""
    several = [value] if isinstance(value, (numbers.Real, str)) else value
    widths = [f"{each:.3g}" for each in several if isinstance(each, numbers.Real)]
    words = [each for each in several if isinstance(each, str)]
    dashes = [f"dashes of {len(each[1] or ())}" for each in several if isinstance(each, tuple)]
    return ",".join(sorted({*widths, *words, *dashes}))


def masked(text: str) -> str:
    """A text in one line with # for its numbers."""
    return NUMBER.sub("#", " ".join(text.split()))
