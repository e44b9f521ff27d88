"""Where a result goes: its folder or file, with its run, and how it is printed."""

# Annotations are objects, not texts: the options are inherited by classes in other modules.

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from locplan._util.progress import working
from locplan._util.runs import write_run_beside
from locplan.cli._groups import heading, option_group
from locplan.errors import one_line

if TYPE_CHECKING:
    from locplan._util.results import Results

Target = Parameter(name=("--output", "-o"), group=heading("Output"))
"""The option that says where results go."""
Json = Annotated[
    bool, Parameter(name="--json", group=heading("Output"), help="Print the result as JSON.")
]


@option_group("Output")
class Output:
    """Where the result goes."""

    output: Annotated[Path | None, Target] = None
    """Folder for pictures, JSON and tables (CSV)."""
    force: bool = False
    """Replace files in the way, whoever wrote them."""
    json: Annotated[bool, Parameter(name="--json")] = False
    """Print the result as JSON."""

    def check(self, files: "Results", *more: str) -> None:
        """Raise a LocplanError if the folder cannot take files of results; before long work."""
        if self.output:
            files.into(self.output, *more, force=self.force)

    def finish(self, result: Any, *about: Any, saved: tuple[Any, ...] | None = None) -> None:
        """Save a result, if a folder or a file was named, and print it.

        Parameters
        ----------
        result : Result
            The result.
        *about
            What belongs to it, such as the drives that verify it.
        saved : tuple, optional
            What belongs to it in its folder, by default the same.
        """
        written = None
        if self.output:
            with working("writing the results"):
                own = about if saved is None else saved
                written = result.save(self.output, *own, force=self.force)
        self.show(result.summary(*about), result.report(*about), *written or [self.output])

    def show(self, about: object, text: object, *written: Path | None) -> None:
        """Print a result that is saved, and write its run beside it."""
        if self.output and self.output in written:
            write_run_beside(self.output)
        show(self.json, about, text, *written)


def show(as_json: bool, about: object, text: object, *written: Path | None) -> None:
    """Print a result as JSON or as text for people, and say on stderr what was written."""
    print(json.dumps(about, indent=2) if as_json else text)
    say_written(*written)


def say_written(*paths: Path | None) -> None:
    """Say on stderr what was written."""
    for path in filter(None, paths):
        print(one_line(f"wrote {path}"), file=sys.stderr)
