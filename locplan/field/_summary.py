"""A field in a few numbers, as a table, and as JSON."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from locplan._util.tables import finite, table
from locplan.field._config import FieldConfig
from locplan.field._field import CovarianceField

SATURATED = 1 / 3
"""A larger saturated share makes the table suggest what would resolve it."""


@dataclass(frozen=True)
class FieldSummary:
    """How many cells were evaluated, and how e is distributed over them and all headings."""

    map: str
    """Name of the map."""
    config: FieldConfig
    """Settings of the field."""
    cells_evaluated: int
    """Number of cells with a covariance."""
    e_percentile_10: float
    """e that a tenth of the cells stays below [m^2 rad]; NaN without cells."""
    e_median: float
    """Median of e [m^2 rad]; NaN without cells."""
    e_percentile_90: float
    """e that a tenth of the cells exceeds [m^2 rad]; NaN without cells."""
    saturated_share: float
    """Share of the cells whose e is at its least value, 0..1."""
    e_unit: str
    """Unit of e: without rotation in the search window it is m^2."""

    @classmethod
    def of(cls, field: CovarianceField) -> FieldSummary:
        """The summary of a field."""
        e = field.e[field.evaluated]
        low, mid, high = np.percentile(e, (10, 50, 90)).tolist() if e.size else [math.nan] * 3
        name, count, saturated = field.grid.name, int(field.evaluated.sum()), field.saturated_share
        return cls(name, field.config, count, low, mid, high, saturated, field.e_unit)

    def to_json(self) -> dict[str, Any]:
        """The summary, fit for JSON."""
        numbers = {name: value for name, value in vars(self).items() if name != "e_unit"}
        return {**finite(numbers), "config": self.config.to_json()}

    def table(self) -> str:
        """The summary for people, and what would resolve a saturated field."""
        values = self.e_percentile_10, self.e_median, self.e_percentile_90
        estimator, headings = self.config.estimator, self.config.headings
        several = "" if headings == 1 else f", {headings} headings"
        text = table(
            [],
            [
                ["map", self.map],
                ["estimator", f"{estimator.summary}, range {estimator.reach:g} m{several}"],
                ["cells evaluated", f"{self.cells_evaluated:,}"],
                ["e, 10 % / median / 90 %", f"{' / '.join(map(shown, values))} {self.e_unit}"],
                [
                    "saturated",
                    f"{self.saturated_share:.0%} of the cells: e + Q is least",
                ],
            ],
        )
        resolved = self.saturated_share <= SATURATED
        return text if resolved else f"{text}\n{estimator.remedy}"


def shown(e: float) -> str:
    """A value of e for people, a dash where there is none."""
    return "–" if math.isnan(e) else f"{e:.3g}"
