"""The command that lists and clears cached fields and checks."""

from __future__ import annotations

from typing import Annotated

from cyclopts import Parameter
from cyclopts.validators import Number

from locplan.app.cli.application import command
from locplan.app.cli.arguments import Switch
from locplan.app.cli.groups import OutputOptions

Days = Annotated[float, Parameter(metavar="DAYS", validator=Number(gte=0))]


@command("cache list", "cache clear --older-than 30", "cache path")
def cache() -> None:
    """List, clear or find the fields and trajectories computed before."""


cache.default_command = None  # alone it shows its help


@cache.command(name="list")
def list_entries(*, json: Switch = False) -> None:
    """List the cached results, the last used first.

    Parameters
    ----------
    json
        Print the list as JSON.
    """
    from locplan.field.cache import cache_entries, cache_folder, cache_table

    folder = cache_folder(None)
    cached_results = cache_entries(folder)
    table = cache_table(cached_results, folder)
    OutputOptions(json=json).show(
        [cached_result.to_json() for cached_result in cached_results], table
    )


@cache.command
def clear(*, older_than: Days = 0.0) -> None:
    """Remove cached results, except those that are being computed.

    Parameters
    ----------
    older_than
        Days for which a removed result was not used.
    """
    from locplan._support.tables import format_bytes
    from locplan.field.cache import cache_folder, clear_cache

    removed, busy = clear_cache(cache_folder(None), older_than)
    busy_text = f"; being computed, and kept: {len(busy)}" if busy else ""
    print(
        f"removed {len(removed)},"
        f" {format_bytes(sum(cached_result.size for cached_result in removed))}{busy_text}"
    )


@cache.command
def path() -> None:
    """Print the folder of the cached results."""
    from locplan.field.cache import cache_folder

    print(cache_folder(None))
