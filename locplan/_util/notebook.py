"""Display of objects in a notebook, by figures that a package above draws of them."""

from __future__ import annotations

import io
from importlib import import_module
from typing import ClassVar

DPI = 80


class Pictured:
    """An object whose picture is its display in a notebook."""

    _drawn_by: ClassVar[str]
    """Module and function that make the figure, by name: the object's package draws nothing."""

    def _repr_png_(self) -> bytes | None:
        module, _, name = self._drawn_by.partition(":")
        figure = getattr(import_module(module), name)(self)
        return png_of(figure)


def png_of(figure: object, dpi: int = DPI) -> bytes:
    """PNG image of a figure of matplotlib."""
    written = io.BytesIO()
    save = getattr(figure, "savefig")  # noqa: B009 - matplotlib is not imported for its type
    save(written, format="png", dpi=dpi, bbox_inches="tight", pad_inches=0.1)
    return written.getvalue()
