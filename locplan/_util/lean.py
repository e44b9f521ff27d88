"""A lean start of the command line's own process, where no other code runs.

Of the libraries that are imported some do work that is of no use here: it is left out. What they
compute stays the same, and where a library has changed, the work is done as always.
"""

from __future__ import annotations

import gc
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, suppress
from importlib import import_module
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec, PathFinder, SourceFileLoader
from types import ModuleType
from typing import Any

OBJECTS = 200_000
"""Number of new objects after which Python looks for cycles among them, instead of 700."""


def start_lean() -> None:
    """Look for cyclic garbage rarely, and import libraries without what nobody uses."""
    gc.set_threshold(OBJECTS, 20, 50)
    sys.meta_path.insert(0, _Lean())


def end_lean() -> None:
    """Let Python end without a last search for garbage, which takes a third of a second.

    OMPL's bindings report leaks on standard error unless there is one.
    """
    if "ompl" not in sys.modules:
        gc.disable()
        gc.freeze()


@contextmanager
def _without_signatures(artists: ModuleType) -> Iterator[None]:
    """Let matplotlib list no properties in the help texts of its artists: a third of its start."""
    yield
    artist: Any = getattr(artists, "Artist", None)
    if hasattr(artist, "_update_set_signature_and_docstring"):
        artist._update_set_signature_and_docstring = classmethod(lambda _: None)


@contextmanager
def _without_scipy(arrays: ModuleType) -> Iterator[None]:
    """Let numba not import scipy.linalg just to see that it is there; np.dot still imports it."""
    linalg: Any = None
    with suppress(Exception):  # another numba may import its modules in another order
        linalg = import_module("numba.np.linalg")
    look = getattr(linalg, "ensure_blas", None)
    if look is None:
        yield
        return
    linalg.ensure_blas = lambda: None
    try:
        yield
    finally:
        linalg.ensure_blas = look
        if hasattr(arrays, "ensure_blas"):
            vars(arrays)["ensure_blas"] = look


AROUND: dict[str, Callable[[ModuleType], AbstractContextManager[None]]] = {
    "matplotlib.artist": _without_signatures,
    "numba.np.arraymath": _without_scipy,
}
"""What is done around the import of a module."""


class _Lean(MetaPathFinder):
    """A finder that puts `AROUND` around the modules that Python itself finds."""

    def find_spec(
        self, name: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        around = AROUND.get(name)
        spec = PathFinder.find_spec(name, path, target) if around else None
        # Such a loader is the module's own, and always has this method.
        if around and spec and isinstance(spec.loader, SourceFileLoader):
            execute = spec.loader.exec_module

            def execute_around(module: ModuleType) -> None:
                with around(module):
                    execute(module)

            spec.loader.exec_module = execute_around  # type: ignore[method-assign]
        return spec
