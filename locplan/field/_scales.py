"""The scales of a field's scalars and layers: their anchors, labels and units."""

from __future__ import annotations

from locplan.field._covariance import SCALARS, Quantity, scalar
from locplan.field._estimator import Estimator
from locplan.field._search_window import OffsetLattice


def anchors_of(estimator: Estimator, window: OffsetLattice, name: str) -> tuple[float, float]:
    """Values of a scalar or a layer at which u is 0 and 1, see `CovarianceField.anchors`."""
    for layer in estimator.layers:
        if layer.name == name:
            return layer.anchors(window)
    least, greatest = estimator.perfect(window), estimator.featureless(window)
    return float(scalar(least, name)), float(scalar(greatest, name))


def quantity_of(estimator: Estimator, e_unit: str, name: str | None) -> Quantity:
    """Label and unit of a scalar or of a layer, see `CovarianceField.quantity`."""
    name = name or estimator.criterion
    if name == "e":
        return Quantity(SCALARS["e"].label, e_unit)
    layers = {each.name: each for each in estimator.layers}
    return Quantity(layers[name].label, layers[name].unit) if name in layers else SCALARS[name]
