"""The command that repeats a run."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from locplan._util.runs import Run
from locplan.cli._groups import command
from locplan.cli._output import Output
from locplan.errors import LocplanError

app = command("run", "run planned/run.yaml -o again", "run planned")


@app.default
def run(
    file: Annotated[
        Path,
        Parameter(help="Run of some results: their folder, its run.yaml, or FILE.run.yaml."),
    ],
    /,
    *,
    out: Output = Output(),
) -> int | None:
    """Repeat the command that wrote results, to the same numbers.

    Results replace those of the run, unless --output names another folder or file.
    """
    from locplan.cli._launcher import launched  # which imports commands

    before = Run.read(file)
    if before.command in ("run", "explore", "completion"):  # they write no results of their own
        raise LocplanError(f"{file}: {before.command} is not one that is repeated")
    words = [*before.words(), f"--output={out.output or Run.home(file)}"]
    words += ["--force"] * out.force + ["--json"] * out.json
    code, now = launched(words)
    for line in before.changes(now) if now else ():
        print(f"locplan: warning: {line}", file=sys.stderr)
    return code
