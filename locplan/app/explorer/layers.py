"""Layers of a field as the page draws them, with row 0 on top."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from locplan._support.kernels.arrays import Floats, Octets
from locplan.field.covariance import SCALARS
from locplan.field.field import CovarianceField
from locplan.maps.occupancy import FREE, OCCUPIED


@dataclass(frozen=True, eq=False)
class PictureLayer:
    """Picture of a field's values on its lattice, quantised between two ends."""

    name: str
    """Name of the layer."""
    title: str
    """Title for people."""
    unit: str
    """Unit of the values."""
    low: float
    """Value of the first step."""
    high: float
    """Value of the last step, the worst one."""
    scale: str
    """"linear", or "log" if the steps are even in the logarithm."""
    labels: tuple[str, str]
    """Texts for the two ends."""
    texels: Octets
    """Steps from 1 to 255, 0 without a value, row 0 on top."""

    @property
    def facts(self) -> dict[str, object]:
        """All fields except the steps, for JSON."""
        return {name: value for name, value in vars(self).items() if name != "texels"}


def make_layers(field: CovarianceField) -> dict[str, PictureLayer]:
    """Return the layers of a field that the page shows, by name."""
    layers = [_make_degeneracy_layer(field), _make_deviation_layer(field)]
    return {layer.name: layer for layer in layers if layer.high > layer.low}


def _make_degeneracy_layer(field: CovarianceField) -> PictureLayer:
    """Return the layer of the degeneracy u, computed as in costmaps."""
    criterion = field.config.estimator.criterion
    values = field.scalar(criterion, with_q=True)
    u = normalize_values(values, *field.anchors(criterion), is_log=criterion not in field.layers)
    texels = _make_texels(u.mean(axis=2) if u.ndim == 3 else u)
    title = "How well a scan fixes the position"
    return PictureLayer("degeneracy", title, "", 0.0, 1.0, "linear", ("well", "not at all"), texels)


def _make_deviation_layer(field: CovarianceField) -> PictureLayer:
    """Return the layer of the position's standard deviation."""
    scalar = SCALARS["position_std"]
    values, ends = field.scalar("position_std", headings="mean"), field.anchors("position_std")
    low, high = (scalar.factor * end for end in ends)
    labels = f"{low:.2g} {scalar.unit}", f"{high:.2g} {scalar.unit}"
    texels = _make_texels(normalize_values(values, *ends, is_log=True))
    title = "Standard deviation of the position"
    return PictureLayer("deviation", title, scalar.unit, low, high, "log", labels, texels)


def normalize_values(values: Floats, low: float, high: float, *, is_log: bool) -> Floats:
    """Return where values lie between two ends, from 0 to 1; NaN for NaN."""
    with np.errstate(invalid="ignore", divide="ignore"):
        if is_log:
            share = np.log(np.maximum(values, np.finfo(float).tiny) / low) / np.log(high / low)
        else:
            share = (values - low) / (high - low)
    return np.asarray(np.clip(share, 0.0, 1.0))


def _make_texels(shares: Floats) -> Octets:
    steps = 1 + np.rint(254 * shares)
    return np.asarray(np.nan_to_num(steps, nan=0.0)[::-1], np.uint8)


def make_cell_classes(cells: Octets) -> Octets:
    """Return cells as 0 (unknown), 1 (free) or 2 (occupied), with row 0 on top."""
    classes = np.zeros(256, np.uint8)
    classes[FREE], classes[OCCUPIED] = 1, 2
    return np.asarray(classes[cells[::-1]])
