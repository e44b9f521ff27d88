"""The command `cache`: list and clear cached results."""

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
    """List or clear cached results, or print their folder."""


cache.default_command = None  # without a subcommand, show the help


@cache.command(name="list")
def list_entries(*, json: Switch = False) -> None:
    """List cached results, the most recently used first.

    Parameters
    ----------
    json
        Print the list as JSON.
    """
    from locplan.field.cache import cache_folder, format_cache_table, list_cache_entries

    folder = cache_folder(None)
    cached_results = list_cache_entries(folder)
    table = format_cache_table(cached_results, folder)
    OutputOptions(json=json).show(
        [cached_result.to_json() for cached_result in cached_results], table
    )


@cache.command
def clear(*, older_than: Days = 0.0) -> None:
    """Remove cached results that are not being computed.

    Parameters
    ----------
    older_than
        Remove only results unused for this many days.
    """
    from locplan._support.tables import format_bytes
    from locplan.field.cache import cache_folder, clear_cache

    removed, busy = clear_cache(cache_folder(None), older_than)
    busy_text = f"; kept {len(busy)} that are being computed" if busy else ""
    print(
        f"removed {len(removed)},"
        f" {format_bytes(sum(cached_result.size for cached_result in removed))}{busy_text}"
    )


@cache.command
def path() -> None:
    """Print the cache folder."""
    from locplan.field.cache import cache_folder

    print(cache_folder(None))
