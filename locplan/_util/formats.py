"""Numbers with their intervals as text, for tables and sentences."""

from __future__ import annotations

import numpy as np

from locplan._util.intervals import Interval


def in_degrees(interval: Interval) -> Interval:
    """An interval of an angle [rad] in degrees."""
    return Interval(*np.degrees(interval).tolist())


def in_percent(interval: Interval) -> str:
    """Text of a share, such as 25% [12%, 40%]."""
    return f"{interval.value:.0%} [{interval.low:.0%}, {interval.high:.0%}]"


def plain(value: float, digits: int = 2) -> str:
    """Text of a number such as a correlation: .25, -.25 or 1.25; a dash if it is not known."""
    return "-" if np.isnan(value) else f"{value:.{digits}f}".replace("0.", ".", 1)


def digits_of(length: float) -> int:
    """Digits behind the point of an error [m]: millimetres below 0.1 m, or else centimetres."""
    return 3 if length < 0.0995 else 2


def in_metres(length: float) -> str:
    """Text of an error, such as 0.25 m or 0.025 m."""
    return f"{length:.{digits_of(length)}f} m"


def short(interval: Interval) -> str:
    """Text of a correlation or a ratio, such as .25 [.12, .40]."""
    value, low, high = map(plain, interval)
    return value if np.isnan(interval.low) else f"{value} [{low}, {high}]"


def two_digits(interval: Interval) -> str:
    """Text of a ratio, such as 0.25 [0.12, 0.40]."""
    value, low, high = interval
    return f"{value:.2f}" + ("" if np.isnan(low) else f" [{low:.2f}, {high:.2f}]")


def with_unit(interval: Interval, unit: str) -> str:
    """Text of a quantity, such as 0.25 m [0.12, 0.40]; a dash if it is not known."""
    value, low, high = interval
    if np.isnan(value):
        return "-"
    digits = digits_of(value)
    ends = "" if np.isnan(low) else f" [{low:.{digits}f}, {high:.{digits}f}]"
    return f"{value:.{digits}f} {unit}{ends}"
