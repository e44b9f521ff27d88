"""Figures of results, drawn by a package above, and their display in a notebook."""

from __future__ import annotations

import io
from importlib import import_module
from typing import Any, ClassVar


class Pictured:
    """An object with a figure, which is its display in a notebook."""

    _drawn_by: ClassVar[str]
    """Module and function that make the figure, by name: the object's package draws nothing."""

    @property
    def drawable(self) -> bool:
        """Whether there is anything to draw."""
        return True

    def figure(self, *about: Any, **options: Any) -> Any:
        """The figure of matplotlib that shows it.

        Parameters
        ----------
        *about, **options
            Further arguments of the function that draws it.
        """
        return called(self._drawn_by, self, *about, **options)

    def _repr_png_(self) -> bytes | None:
        return png_of(self.figure()) if self.drawable else None


def called(function: str, *arguments: Any, **options: Any) -> Any:
    """What a function returns that is named as package.module:function, which is imported now."""
    module, _, name = function.partition(":")
    return getattr(import_module(module), name)(*arguments, **options)


def png_of(figure: object, dpi: int = 80) -> bytes:
    """PNG image of a figure of matplotlib."""
    written = io.BytesIO()
    save = getattr(figure, "savefig")  # noqa: B009 - matplotlib is not imported for its type
    save(written, format="png", dpi=dpi, bbox_inches="tight", pad_inches=0.1)
    return written.getvalue()
