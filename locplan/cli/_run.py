"""The command that repeats a run."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from locplan.cli._groups import Folder, Force, Json, command
from locplan.errors import LocplanError

NOT_REPEATED = ("run", "explore", "completion")
"""Commands that write no folder of results of their own."""

app = command("run", "run planned/run.yaml -o again", "run planned")


@app.default
def run(
    file: Annotated[Path, Parameter(help="The run.yaml of a folder of results, or the folder.")],
    /,
    *,
    output: Folder = None,
    force: Force = False,
    json: Json = False,
) -> int | None:
    """Repeat the command that wrote a folder of results, to the same numbers.

    Results replace those of the run, unless --output names another folder.
    """
    from locplan._util.runs import Run
    from locplan.cli._launcher import launched

    before = Run.read(file)
    if before.command in NOT_REPEATED:
        raise LocplanError(f"{file}: {before.command} is not one that is repeated")
    home = file if file.is_dir() else file.parent
    words = [*before.words(), f"--output={output or home}"]
    words += ["--force"] * force + ["--json"] * json
    code, now = launched(words)
    for line in before.changes(now) if now else ():
        print(f"locplan: warning: {line}", file=sys.stderr)
    return code
