"""The command that completes commands and options in a shell."""

from __future__ import annotations

from typing import Annotated, Literal

from cyclopts import Parameter

from locplan.cli._application import application
from locplan.cli._groups import command

app = command(
    "completion",
    "completion bash > ~/.local/share/bash-completion/completions/locplan",
    "completion zsh > ~/.zfunc/_locplan   (a folder in $fpath)",
    "completion fish > ~/.config/fish/completions/locplan.fish",
)


@app.default
def completion(
    shell: Annotated[Literal["bash", "zsh", "fish"], Parameter(help="The shell.")],
) -> None:
    """Print a script by which a shell completes commands and options."""
    print(application().generate_completion(shell=shell))
