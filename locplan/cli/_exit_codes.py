"""The exit codes of the program."""

from locplan._util.supervision import INTERRUPTED

SYSTEM_ERROR, WRONG_INPUT, NOT_IN_METRES = 1, 2, 3
EXPLAINED = (
    f"The exit code is 0 for a result, {SYSTEM_ERROR} where the system fails, {WRONG_INPUT} for a"
    f" wrong input, {NOT_IN_METRES} where calibrate finds that deviations cannot be in metres, and"
    f" {INTERRUPTED} after Ctrl-C."
)
