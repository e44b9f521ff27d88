"""Limits of a check's figures: the option `--fail-if`."""

from __future__ import annotations

import operator
import re
from collections.abc import Callable
from dataclasses import dataclass

from locplan._support.checks import short_repr
from locplan._support.intervals import Interval
from locplan.advice.check_result import Check
from locplan.errors import ConfigError

LIMITED_FIGURES: dict[str, Callable[[Check], Interval]] = {
    "reached": lambda check: check.baseline.reached,
    "lost": lambda check: check.baseline.lost,
    "error": lambda check: check.baseline.error,
    "degenerate": lambda check: Interval(*[check.degenerate_share] * 3),
    "faults": lambda check: Interval(*[float(len(check.faults))] * 3),
}
"""Figures with limits: shares, the error of a typical drive [m], and the number of faults."""
SHARES = ("reached", "lost", "degenerate")


@dataclass(frozen=True)
class CheckLimit:
    """A limit of one figure, such as lost > 5%."""

    figure: str
    """"reached", "lost", "error", "degenerate" or "faults"."""
    sign: str
    """">", ">=", "<" or "<="."""
    number: float
    """The number: a share 0..1, an error [m], or a count."""
    text: str
    """The limit as typed."""

    @classmethod
    def parse(cls, text: str) -> CheckLimit:
        """Read a limit such as "lost > 5%".

        Parameters
        ----------
        text : str
            A figure, a comparison and a number, which may end in % or m.

        Raises
        ------
        ConfigError
            If it is none.

        Examples
        --------
        >>> CheckLimit.parse("lost > 5%").number
        0.05
        """
        words = re.fullmatch(r"\s*(\w+)\s*([<>]=?)\s*(\d+(?:\.\d*)?|\.\d+)\s*(%|m)?\s*", text)
        if words is None or words[1] not in LIMITED_FIGURES:
            raise ConfigError(
                f"a limit must be one of {', '.join(LIMITED_FIGURES)}, a comparison and a number,"
                f" such as 'lost > 5%', not {short_repr(text)}"
            )
        name, sign, number, unit = words.groups()
        units = {"error": ("m", None), "faults": (None,)}.get(name, ("%", None))
        if unit not in units:
            raise ConfigError(f"{name} is not in {unit}, as in {short_repr(text)}")
        value = float(number) / (100 if unit == "%" else 1)
        if name in SHARES and value > 1:
            raise ConfigError(f"{name} is a share, 0 to 1 or 0% to 100%, not {short_repr(text)}")
        return cls(name, sign, value, " ".join(text.split()))

    def fails(self, check: Check) -> bool:
        """True if the whole interval of a check's figure is beyond the limit.

        Parameters
        ----------
        check : Check
            The check.
        """
        _, low, high = LIMITED_FIGURES[self.figure](check)
        nearest = low if self.sign.startswith(">") else high
        compared = {">=": operator.ge, "<=": operator.le, ">": operator.gt, "<": operator.lt}
        return bool(compared[self.sign](nearest, self.number))

    def format_result(self, check: Check) -> str:
        """Return the figure with its interval, and the limit.

        Parameters
        ----------
        check : Check
            The check.
        """
        value, low, high = LIMITED_FIGURES[self.figure](check)
        scale, unit = (100, " %") if self.figure in SHARES else (1, "")
        figure_text = f"{scale * value:.3g}{unit} [{scale * low:.3g}, {scale * high:.3g}]"
        result_word = "failed" if self.fails(check) else "passed"
        return f"{result_word}: {self.figure} is {figure_text}; fails if {self.text}"
