"""The public names of a package: imported when they are first used, with all of their help."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import lazy_loader

from locplan._util.documented import tell_fields


def attach(
    package: str, file: str
) -> tuple[Callable[[str], Any], Callable[[], list[str]], list[str]]:
    """`__getattr__`, `__dir__` and `__all__` of a package whose names stand in its stub."""
    get, names, public = lazy_loader.attach_stub(package, file)

    def found(name: str) -> Any:
        thing = get(name)
        tell_fields(thing)
        return thing

    return found, names, public
