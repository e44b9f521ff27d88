"""Lazy imports: public names, docstrings of fields, figures, templates, and extras."""

from __future__ import annotations

import ast
import dataclasses
import inspect
import io
import textwrap
from collections.abc import Callable
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

import lazy_loader

from locplan.errors import LocplanError

if TYPE_CHECKING:
    from jinja2 import Environment


def attach_lazy_names(
    package: str, file: str
) -> tuple[Callable[[str], Any], Callable[[], list[str]], list[str]]:
    """Return `__getattr__`, `__dir__` and `__all__` of a package with a stub file."""
    get, names, public = lazy_loader.attach_stub(package, file)
    return get, names, public


def read_field_docs(kind: type) -> dict[str, str]:
    """Return the docstring of each field in one line, including inherited fields.

    A class without a source file has none.
    """
    docs = dict.fromkeys(_read_field_types(kind), "")
    for base in reversed(kind.__mro__[:-1]):
        try:
            (tree,) = ast.parse(textwrap.dedent(inspect.getsource(base))).body
        except (OSError, TypeError):
            continue
        assert isinstance(tree, ast.ClassDef)
        for statement, docstring in zip(tree.body, tree.body[1:], strict=False):
            match statement, docstring:
                case (
                    ast.AnnAssign(target=ast.Name(id=name)),
                    ast.Expr(value=ast.Constant(value=str(text))),
                ):
                    docs[name] = " ".join(text.split())
    return docs


def _read_field_types(kind: type) -> dict[str, str]:
    """Return the init fields of a class with their types as written."""
    if dataclasses.is_dataclass(kind):
        return {
            dataclass_field.name: str(dataclass_field.type)
            for dataclass_field in dataclasses.fields(kind)
            if dataclass_field.init
        }
    hints = getattr(kind, "__annotations__", {})
    names = getattr(kind, "_fields", ())
    return {name: getattr(hints.get(name), "__forward_arg__", "") for name in names}


class DrawableResult:
    """Object with a figure, shown as its display in a notebook."""

    if TYPE_CHECKING:
        figure: Callable[..., Any]

    @property
    def is_drawable(self) -> bool:
        """True if the figure has content."""
        return True

    def _repr_png_(self) -> bytes | None:
        return render_png(self.figure()) if self.is_drawable else None


def render_png(figure: object, dpi: int = 80) -> bytes:
    """Return the PNG image of a figure of matplotlib."""
    written = io.BytesIO()
    save = getattr(figure, "savefig")  # noqa: B009 - matplotlib is not imported for its type
    save(written, format="png", dpi=dpi, bbox_inches="tight", pad_inches=0.1)
    return written.getvalue()


def load_templates(package: str, **style: Any) -> Environment:
    """Return the Jinja templates in a package's folder `templates`, with strict variables."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    loader = PackageLoader(package)
    return Environment(loader=loader, undefined=StrictUndefined, trim_blocks=True, **style)


def require_extra(library: str, extra: str, feature: str) -> None:
    """Raise a LocplanError if a library of an extra is missing; `feature` needs it.

    It is called before the work whose result the library takes.
    """
    if find_spec(library) is None:
        raise LocplanError(f"{feature} needs {library}: pip install 'locplan[{extra}]'")
