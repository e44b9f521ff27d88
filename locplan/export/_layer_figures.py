"""The pictures of a layer: coloured cells, and their legend."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LogNorm, Normalize
from matplotlib.figure import Figure
from numpy.typing import NDArray

from locplan.field import CovarianceField
from locplan.plotting import FIELD_COLOURS, Picture, field_norm, label_plainly

_ROWS = 256


def norm_of(field: CovarianceField, name: str, values: NDArray[np.float64]) -> Normalize:
    """The scale of plots, in the unit of the values (H, W)."""
    factor = field.quantity(name).factor
    ends = np.array(field.anchors(name))
    if np.isfinite(values).any():
        ends = np.array([np.nanmin(values), np.nanmax(values)])
    low, high = _ends(field_norm(field, name, factor * ends))
    return LogNorm(low / factor, high / factor)


def write_coloured(file: Path, values: NDArray[np.float64], norm: Normalize) -> None:
    """Write values (H, W) as coloured cells, the highest row first, transparent where NaN."""
    from PIL import Image

    colours = np.zeros((*values.shape, 4), np.uint8)
    for first in range(0, len(values), _ROWS):
        some = values[::-1][first : first + _ROWS]
        known = np.isfinite(some)
        colours[first : first + _ROWS][known] = FIELD_COLOURS(
            np.asarray(norm(some[known])), bytes=True
        )
    Image.fromarray(colours, "RGBA").save(file, "png", compress_level=3)


def legend_figure(
    field: CovarianceField, norms: Mapping[str, Normalize], units: Mapping[str, str]
) -> Figure:
    """A figure of the colours of some scalars: people's units above each bar, the files' below.

    Parameters
    ----------
    field : CovarianceField
    norms : mapping of str to Normalize
        The scale of each scalar in the files' unit.
    units : mapping of str to str
        The files' units.
    """
    figure = Picture(figsize=(6.4, 0.7 + 1.5 * len(norms)), layout="constrained")
    rows = figure.subplots(len(norms), 1, squeeze=False)[:, 0]
    for axes, (name, norm) in zip(rows, norms.items(), strict=True):
        shown = field.quantity(name)
        colours = ScalarMappable(norm, FIELD_COLOURS)
        bar = figure.colorbar(colours, cax=axes, orientation="horizontal").ax
        bar.set_box_aspect(0.06)
        bar.set_xlabel(f"{name} [{units[name]}] in files")
        both = partial(np.multiply, shown.factor), partial(np.multiply, 1 / shown.factor)
        above = bar.secondary_xaxis("top", functions=both)
        above.set_xlabel(shown.axis)
        label_plainly(bar.xaxis)
        label_plainly(above.xaxis)
    title = f"{field.grid.name or 'map'}; transparent: nothing is known\n{field.config.summary}"
    figure.suptitle(title, fontsize="medium")
    return figure


def _ends(norm: Normalize) -> tuple[float, float]:
    assert norm.vmin is not None
    assert norm.vmax is not None
    return norm.vmin, norm.vmax
