"""The exceptions that locplan raises on bad input."""


class LocplanError(Exception):
    """Bad input: one line that says what was wrong, where, and what to do about it."""


class MapError(LocplanError):
    """A map file, or the arrays of an occupancy grid, cannot be used."""


class ConfigError(LocplanError):
    """A setting is out of its range, or does not fit the map."""


class CalibrationError(LocplanError):
    """No noise level puts the deviations of a field in metres."""


class FieldError(LocplanError):
    """A stored covariance field cannot be read, or does not belong to the map."""


class PoseError(LocplanError):
    """A start or a goal lies where the robot cannot stand."""
