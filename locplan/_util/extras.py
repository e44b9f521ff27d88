"""The libraries of extras, which need not be installed."""

from __future__ import annotations

from importlib.util import find_spec

from locplan.errors import LocplanError


def needed(library: str, extra: str, what: str) -> None:
    """Raise a LocplanError if a library of an extra is missing; `what` needs it.

    It is called before the work whose result the library takes.
    """
    if find_spec(library) is None:
        raise LocplanError(f"{what} needs {library}: pip install 'locplan[{extra}]'")
