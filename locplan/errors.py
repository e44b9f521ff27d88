"""The exceptions that locplan raises on bad input."""

MAX_MESSAGE = 1000
"""Maximum length of an error's message [characters]; the middle of a longer one is left out."""


class LocplanError(Exception):
    """Error about bad input: one line with the fault, its place and the remedy.

    The message is always one printable line, even if values or file names in it are not.

    Parameters
    ----------
    message : str
        The line; of more than 1000 characters the middle is left out.
    """

    def __init__(self, message: str = "") -> None:
        super().__init__(format_one_line(message))


class MapError(LocplanError):
    """An unusable map file or array of an occupancy grid."""


class ConfigError(LocplanError):
    """A setting that is out of its range or does not fit the map."""


class FieldError(LocplanError):
    """A covariance field that cannot be computed, stored or read, or belongs to another map."""


class RecordingError(LocplanError):
    """A recorded drive that cannot be read or holds nothing usable."""


class PoseError(LocplanError):
    """A start or a goal that the robot cannot occupy."""


def format_one_line(text: str) -> str:
    """Return a text as one line of limited length; unprintable characters become "?"."""
    if len(text) > MAX_MESSAGE:
        text = f"{text[: MAX_MESSAGE - 150]} ... {text[-140:]}"
    return "".join(c if c.isprintable() else "?" for c in text)
