"""The command line as ``python -m locplan``."""

from locplan.cli import main

if __name__ == "__main__":
    main()
