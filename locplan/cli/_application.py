"""The application, the registry of its commands, and its exit codes."""

from __future__ import annotations

from cyclopts import App, Parameter

from locplan import __version__
from locplan._util.supervision import INTERRUPTED
from locplan.cli._groups import GENERAL, Filling

SYSTEM_ERROR, WRONG_INPUT, NOT_IN_METRES = 1, 2, 3
EXPLAINED = (
    f"The exit code is 0 for a result, {SYSTEM_ERROR} where the system fails, {WRONG_INPUT} for a"
    f" wrong input, {NOT_IN_METRES} where calibrate finds that deviations cannot be in metres, and"
    f" {INTERRUPTED} after Ctrl-C."
)
COMMANDS = (
    "cache",
    "calibrate",
    "choose",
    "compare",
    "completion",
    "evaluate",
    "explore",
    "export",
    "features",
    "field",
    "info",
    "landmarks",
    "locate",
    "maps",
    "pareto",
    "plan",
    "plot",
    "simulate",
    "tune",
    "twins",
)
"""Each command is the `app` of the module of its name beside this one."""


def application(*names: str) -> App:
    """The command line with these commands, all of them by default."""
    app = App(
        name="locplan",
        help="Plan paths along which a robot with a 2D lidar can still localize itself.",
        version=f"locplan {__version__}",
        help_flags=("-h", "--help"),
        version_flags="--version",
        help_format="plaintext",
        help_formatter=Filling(),
        help_epilogue=EXPLAINED,
        group_parameters=GENERAL,
        default_parameter=Parameter(
            negative=(), show_default=False, json_list=False, json_dict=False
        ),
        suppress_keyboard_interrupt=False,
        exit_on_error=False,
        print_error=False,
        result_action="return_value",
    )
    for name in names or COMMANDS:
        app.command(f"locplan.cli._{name}:app", name=name)
        _ = app[name]  # imported now, so that the help knows its first sentence
    return app
