"""The exceptions that locplan raises on bad input."""

MAX_MESSAGE = 1000
"""Maximum length of an error's message [characters]; the middle of a longer one is left out."""


class LocplanError(Exception):
    """Bad input: one line that says what was wrong, where, and what to do about it.

    Whatever the values and the names of files in it, the message is one line that can be printed.

    Parameters
    ----------
    message : str
        The line; of more than 1000 characters the middle is left out.
    """

    def __init__(self, message: str = "") -> None:
        super().__init__(one_line(message))


class MapError(LocplanError):
    """A map file, or the arrays of an occupancy grid, cannot be used."""


class ConfigError(LocplanError):
    """A setting is out of its range, or does not fit the map."""


class FieldError(LocplanError):
    """A covariance field cannot be made, stored or read, or does not belong to the map."""


class RecordingError(LocplanError):
    """A recorded drive cannot be read, or holds nothing that can be used."""


class PoseError(LocplanError):
    """A start or a goal lies where the robot cannot stand."""


def one_line(text: str) -> str:
    """Text in one line of limited length; what cannot be printed becomes "?"."""
    if len(text) > MAX_MESSAGE:
        text = f"{text[: MAX_MESSAGE - 150]} ... {text[-140:]}"
    return "".join(c if c.isprintable() else "?" for c in text)
