"""Generate the API pages of all public names from their docstrings.

Run: pip install 'locplan[docs]' && python examples/api.py [FOLDER]
"""

from __future__ import annotations

import dataclasses
import importlib
import inspect
import sys
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from types import FunctionType, ModuleType
from typing import get_type_hints

import pdoc

import locplan
from locplan._support import public

PACKAGES = ("locplan", "locplan.planning.ompl")
"""The package, and the one that it does not export because it imports OMPL."""


def main(folder: str = "api") -> None:
    """Write FOLDER/index.html, and a page per public package next to it."""
    public.tell_fields = lambda thing: None  # pdoc shows fields itself
    for package in map(importlib.import_module, PACKAGES):
        for thing in public_things(package):
            resolve_fields(thing)
            copy_inherited_members(thing)
    footer = f"locplan {locplan.__version__}"
    pdoc.render.configure(docformat="numpy", footer_text=footer)
    pdoc.pdoc(*PACKAGES, output_directory=Path(folder))
    print(f"wrote {Path(folder) / 'index.html'}")


def public_things(package: ModuleType) -> Iterator[object]:
    """Yield the names in the `__all__` of a package and of its public packages."""
    for name in package.__all__:
        thing = getattr(package, name)
        yield thing
        if inspect.ismodule(thing) and hasattr(thing, "__all__"):
            yield from public_things(thing)
        elif inspect.ismodule(thing):  # a plain module, such as the verdict
            yield from (
                member
                for name, member in vars(thing).items()
                if getattr(member, "__module__", "") == thing.__name__ and name[0] != "_"
            )


def resolve_fields(thing: object) -> None:
    """Replace the names of types in the signature of a dataclass or NamedTuple by the types.

    pdoc looks types up in the module of the class, even for inherited fields.
    """
    if inspect.isclass(thing) and hasattr(thing, "_fields"):  # a NamedTuple
        thing.__new__.__annotations__ |= get_type_hints(thing)
    if not (inspect.isclass(thing) and dataclasses.is_dataclass(thing)):
        return
    signature = thing.__init__.__annotations__
    for base in thing.__mro__:
        names = vars(sys.modules[base.__module__])
        for field, kind in inspect.get_annotations(base).items():
            if isinstance(signature.get(field), str):
                with suppress(NameError):  # a type for the checker only is shown by its name
                    signature[field] = eval(kind, dict(names))


def copy_inherited_members(thing: object) -> None:
    """Copy members of private base classes into a class, such as `save` of results."""
    for base in thing.__mro__[1:] if inspect.isclass(thing) else ():
        for name, member in vars(base).items():
            public_name = base.__module__.startswith("locplan._support.") and not name.startswith(
                "_"
            )
            kept = isinstance(member, (FunctionType, classmethod, property))
            if public_name and kept and inspect.getattr_static(thing, name) is member:
                setattr(thing, name, member)


if __name__ == "__main__":
    main(*sys.argv[1:2])
