"""The command that lists and clears cached fields and checks."""

from __future__ import annotations

from typing import Annotated

from cyclopts import App, Parameter
from cyclopts.validators import Number

import locplan
from locplan.cli.application import wrap_example
from locplan.cli.arguments import Switch
from locplan.cli.groups import Output

cache = App(name="cache")
cache.help = "\n".join(
    [
        "List, clear or find the fields and trajectories computed before.",
        "",
        "Examples",
        *map(wrap_example, ["cache list", "cache clear --older-than 30", "cache path"]),
    ]
)
Days = Annotated[float, Parameter(metavar="DAYS", validator=Number(gte=0))]


@cache.command(name="list")
def list_entries(*, json: Switch = False) -> None:
    """List the cached results, the last used first.

    Parameters
    ----------
    json
        Print the list as JSON.
    """
    folder = locplan.field.cache_folder(None)
    entries = locplan.field.cache_entries(folder)
    table = locplan.field.cache_table(entries, folder)
    Output(json=json).show([entry.to_json() for entry in entries], table)


@cache.command
def clear(*, older_than: Days = 0.0) -> None:
    """Remove cached results, except those that are being computed.

    Parameters
    ----------
    older_than
        Days for which a removed result was not used.
    """
    from locplan._util.tables import in_bytes

    removed, busy = locplan.field.clear_cache(locplan.field.cache_folder(None), older_than)
    kept = f"; being computed, and kept: {len(busy)}" if busy else ""
    print(f"removed {len(removed)}, {in_bytes(sum(entry.size for entry in removed))}{kept}")


@cache.command
def path() -> None:
    """Print the folder of the cached results."""
    print(locplan.field.cache_folder(None))
