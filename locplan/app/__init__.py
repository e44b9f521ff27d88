"""The programs: the command line and the explorer."""
