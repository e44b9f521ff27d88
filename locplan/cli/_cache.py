"""The commands about the cache of fields."""

from __future__ import annotations

from typing import Annotated

from cyclopts import Parameter
from cyclopts.validators import Number

from locplan.cli._groups import Json, command
from locplan.cli._options import CacheDir
from locplan.cli._values import show

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
    from locplan.field._cache import cache_folder, cache_limit, entries
    from locplan.field._cache_table import cache_summary, cache_table

    folder, limit = cache_folder(cache_dir), cache_limit()
    found = entries(folder)
    show(json, cache_summary(found), cache_table(found, folder, limit))


@app.command
def clear(*, older_than: Days = 0.0, cache_dir: CacheDir = None) -> None:
    """Remove cached fields, but for those being computed."""
    from locplan.field._cache import cache_folder, remove_older
    from locplan.field._cache_table import cleared

    print(cleared(*remove_older(cache_folder(cache_dir), older_than)))


@app.command
def path(*, cache_dir: CacheDir = None) -> None:
    """Print the folder of the cached fields."""
    from locplan.field._cache import cache_folder

    print(cache_folder(cache_dir))
