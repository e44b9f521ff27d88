"""Figures that show names as they are, and that a notebook shows by itself."""

from __future__ import annotations

import warnings
from typing import Any

from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.text import Text

from locplan._util.checks import printable
from locplan._util.notebook import png_of


class Picture(Figure):
    """A figure of matplotlib that a notebook shows when a cell returns it.

    Its texts are shown as they are, but for the numbers at its axes: a map's name may hold signs
    of formulas, such as $, bytes that are no text, and characters that the font has not.
    """

    def draw(self, renderer: Any) -> None:
        """Draw the figure; matplotlib calls it."""
        numbers = {id(text) for axis in self.findobj(Axis) for text in _numbers_of(axis)}
        for text in self.findobj(Text):
            if id(text) not in numbers:
                text.set_parse_math(False)
                text.set_text("\n".join(map(printable, text.get_text().split("\n"))))
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", "Glyph .* missing from font", UserWarning)
            super().draw(renderer)

    def _repr_png_(self) -> bytes:
        return png_of(self)


def _numbers_of(axis: Any) -> list[Text]:
    """The texts of an axis that matplotlib makes."""
    ticks = [*axis.get_major_ticks(), *axis.get_minor_ticks()]
    labels = [label for tick in ticks for label in (tick.label1, tick.label2)]
    return [*labels, axis.get_offset_text()]
