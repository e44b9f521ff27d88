"""Where a result goes: its folder, and how it is printed."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from locplan.cli._groups import OUTPUT, Force, Json, option_group, results
from locplan.cli._values import show

if TYPE_CHECKING:
    from locplan._util.results import Results


@option_group(OUTPUT)
class Output:
    """Where the result goes."""

    output: Annotated[Path | None, results("Folder for pictures, JSON and tables (CSV).")] = None
    force: Force = False
    json: Json = False

    def check(self, files: Results, *more: str) -> None:
        """Raise a LocplanError if the folder cannot take files of results; before long work."""
        if self.output:
            files.into(self.output, *more, force=self.force)

    def finish(self, result: Any, *about: Any, saved: tuple[Any, ...] | None = None) -> None:
        """Save a result, if a folder was named, and print it.

        Parameters
        ----------
        result : Reported
            The result.
        *about
            What belongs to it, such as the drives that verify it.
        saved : tuple, optional
            What belongs to it in its folder, by default the same.
        """
        from locplan._util.progress import working

        if self.output:
            with working("writing the results"):
                result.save(self.output, *(about if saved is None else saved), force=self.force)
        show(self.json, result.summary(*about), result.report(*about), self.output)
