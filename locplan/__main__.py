"""The program ``locplan``, also as ``python -m locplan``."""

from __future__ import annotations

import sys


def main() -> None:
    """Run the command line; where there is fork, in a process that Ctrl-C ends within a second."""
    try:
        from locplan._util.supervision import supervised

        code = supervised(_work)
    except KeyboardInterrupt:  # before there was a second process
        print("locplan: interrupted", file=sys.stderr)
        code = 130
    sys.exit(code)


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
