"""Figures that a notebook shows by itself."""

from __future__ import annotations

from matplotlib.figure import Figure

from locplan._util.notebook import png_of


class Picture(Figure):
    """A figure of matplotlib that a notebook shows when a cell returns it."""

    def _repr_png_(self) -> bytes:
        return png_of(self)
