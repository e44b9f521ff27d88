"""The program ``locplan``, also as ``python -m locplan``."""

from __future__ import annotations

import os
import sys


def main() -> None:
    """Run the command line; where there is fork, in a process that Ctrl-C ends within a second."""
    _open_closed_streams()
    try:
        from locplan._util.supervision import supervised

        code = supervised(_work)
    except KeyboardInterrupt:  # before there was a second process
        print("locplan: interrupted", file=sys.stderr)
        code = 130
    sys.exit(code)


def _open_closed_streams() -> None:
    """Let each standard stream that is closed lead nowhere: else the next file takes its number."""
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        if getattr(sys, name) is None:
            os.dup2(os.open(os.devnull, os.O_RDWR), number)  # the same number, if all is well
            os.set_inheritable(number, True)
            setattr(sys, name, os.fdopen(number, "w" if number else "r"))


def _work() -> None:
    from locplan._util.lean import end_lean, start_lean

    start_lean()
    from locplan.cli import main

    try:
        main()
    finally:
        end_lean()


if __name__ == "__main__":
    main()
