"""Maps and layers of fields as bytes, row 0 on top, as the page draws them."""

from __future__ import annotations

import gzip
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from locplan.field import SCALARS, CovarianceField
from locplan.maps import FREE, OCCUPIED


@dataclass(frozen=True, eq=False)
class Texture:
    """A layer of a field on its lattice, as the page shows it."""

    name: str
    """Name of the layer."""
    title: str
    """Title for people."""
    unit: str
    """Unit of what is shown."""
    factor: float
    """Number of shown units in one of the values'."""
    decimals: int
    """Number of decimals to show."""
    logarithmic: bool
    """Whether the steps are even in the logarithm."""
    anchors: tuple[float, float]
    """Values of the first and the last step; the last one is the worst."""
    values: NDArray[np.float64]
    """Values on the lattice in SI units, row 0 at the lowest y; NaN where there are none."""
    note: str = ""
    """What the values say, for people; empty where the title suffices."""
    digest: str = ""
    """Digest of what it is made of; empty for a layer of the field, which has one."""

    @property
    def texels(self) -> NDArray[np.uint8]:
        """Steps from 1 to 255 between the anchors, 0 where there is no value, row 0 on top."""
        steps = 1 + np.rint(254 * share_between(self.values, self.anchors, self.logarithmic))
        return np.asarray(np.nan_to_num(steps, nan=0.0)[::-1], np.uint8)

    @cached_property
    def present(self) -> list[float]:
        """Values that nearly all on this map lie between; the anchors where there are none."""
        known = self.values[np.isfinite(self.values)]
        if not known.size:
            return list(self.anchors)
        ends: list[float] = np.quantile(known, (0.02, 0.98)).tolist()
        return ends if self.anchors[0] < self.anchors[1] else ends[::-1]

    def to_json(self) -> dict[str, object]:
        """All but the values, fit for JSON."""
        return {
            "name": self.name,
            "title": self.title,
            "unit": self.unit,
            "scale": "log" if self.logarithmic else "linear",
            "anchors": list(self.anchors),
            "present": self.present,
            "decimals": self.decimals,
            "factor": self.factor,
            "note": self.note,
            "digest": self.digest or None,
        }


def cells_of(cells: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Cells of a map as 0 for unknown, 1 for free, 2 for occupied ones, row 0 on top."""
    classes = np.zeros(256, np.uint8)
    classes[FREE], classes[OCCUPIED] = 1, 2
    return classes[cells[::-1]]


def textures_of(field: CovarianceField) -> dict[str, Texture]:
    """The layers of a field that the page shows, by name."""
    made = [
        _scalar(field, "sigma", "position_std", "Position deviation", 1),
        _scalar(field, "heading", "heading_std", "Heading deviation", 1),
        Texture("degeneracy", "Degeneracy u", "1", 1.0, 2, False, (0.0, 1.0), degeneracy_of(field)),
        _scalar(field, "e", "e", "Pose uncertainty e", 4),
    ]
    return {each.name: each for each in made if each.anchors[1] > each.anchors[0]}


def degeneracy_of(field: CovarianceField) -> NDArray[np.float64]:
    """u of the estimator's own criterion on the lattice, (h, w), as costmaps have it."""
    criterion = field.config.estimator.criterion
    values = field.scalar(criterion, headings="mean", with_q=True)
    return share_between(values, field.anchors(criterion), criterion not in field.layers)


def share_between(
    values: NDArray[np.float64], anchors: tuple[float, float], logarithmic: bool
) -> NDArray[np.float64]:
    """Where values lie between two anchors, 0..1; NaN where they are NaN."""
    low, high = anchors
    with np.errstate(invalid="ignore", divide="ignore"):
        if logarithmic:
            share = np.log(np.maximum(values, np.finfo(float).tiny) / low) / np.log(high / low)
        else:
            share = (values - low) / (high - low)
    return np.asarray(np.clip(share, 0.0, 1.0))


def packed(array: NDArray[np.uint8], level: int = 3) -> bytes:
    """An array's bytes, compressed as gzip does."""
    return gzip.compress(np.ascontiguousarray(array).tobytes(), level, mtime=0)


def _scalar(field: CovarianceField, name: str, scalar: str, title: str, decimals: int) -> Texture:
    shown = SCALARS[scalar]
    unit = field.e_unit if scalar == "e" else shown.unit
    values, anchors = field.scalar(scalar, headings="mean"), field.anchors(scalar)
    return Texture(name, title, unit, shown.factor, decimals, True, anchors, values)
