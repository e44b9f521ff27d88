"""The commands about the cache of fields."""

from __future__ import annotations

from typing import Annotated

from cyclopts import Parameter
from cyclopts.validators import Number

import locplan
from locplan.cli._groups import command
from locplan.cli._options import CacheDir
from locplan.cli._output import Json, show

app = command("cache", "cache list", "cache clear --older-than 30")
app.help = "List, clear or find the fields that were computed before."

Days = Annotated[
    float,
    Parameter(
        metavar="DAYS",
        validator=Number(gte=0),
        help="Time for which fields were not used that are removed, in days.",
    ),
]


@app.command(name="list")
def list_(*, cache_dir: CacheDir = None, json: Json = False) -> None:
    """List the cached fields, the last used first."""
    found = locplan.field.FieldCache.of(cache_dir)
    show(json, found.summary(), found.table())


@app.command
def clear(*, older_than: Days = 0.0, cache_dir: CacheDir = None) -> None:
    """Remove cached fields, but for those being computed."""
    from locplan._util.tables import in_bytes

    removed, busy = locplan.field.clear_cache(locplan.field.cache_folder(cache_dir), older_than)
    kept = f"; being computed, and kept: {len(busy)}" if busy else ""
    print(f"removed {len(removed)}, {in_bytes(sum(entry.size for entry in removed))}{kept}")


@app.command
def path(*, cache_dir: CacheDir = None) -> None:
    """Print the folder of the cached fields."""
    print(locplan.field.cache_folder(cache_dir))
