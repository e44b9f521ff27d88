"""The scales of a field's scalars and layers: their anchors, labels and units."""

from __future__ import annotations

from locplan.field._config import FieldConfig
from locplan.field._covariance import SCALARS, Quantity, scalar
from locplan.field._search_window import OffsetLattice
from locplan.maps import OccupancyGrid


class Scales:
    """What the map and the config alone say of a field's scalars and layers."""

    grid: OccupancyGrid
    config: FieldConfig

    @property
    def window(self) -> OffsetLattice:
        """Lattice of the offsets that were compared at each cell."""
        return self.config.estimator.lattice(self.grid.resolution)

    @property
    def e_unit(self) -> str:
        """Unit of e, without the angle where poses have no heading."""
        return "m² rad" if self.window.dimension == 3 else "m²"

    def anchors(self, name: str = "e") -> tuple[float, float]:
        """Values of a scalar for a perfect match and for a featureless place.

        The estimator itself defines the anchors of its layers.

        Parameters
        ----------
        name : str
            "e", "position_std", "position_rms" or "heading_std", see `locplan.field.scalar`, or
            a layer of the estimator.

        Returns
        -------
        (float, float)
            The values at which u is 0 and 1, in the scalar's own unit.

        Raises
        ------
        ConfigError
            If there is no such scalar or layer.
        """
        for layer in self.config.estimator.layers:
            if layer.name == name:
                return layer.anchors(self.window)
        estimator = self.config.estimator
        least, greatest = estimator.perfect(self.window), estimator.featureless(self.window)
        return float(scalar(least, name)), float(scalar(greatest, name))

    def quantity(self, name: str | None = None) -> Quantity:
        """Label and unit of a scalar or of a layer, for pictures and tables.

        Parameters
        ----------
        name : str, optional
            A name as `anchors` takes it; by default the estimator's criterion, which degeneracy
            is made of.

        Returns
        -------
        Quantity
            Its `label`, its `unit` for people, and the `factor` that turns values into it, such as
            100 for a deviation in cm.
        """
        name = name or self.config.estimator.criterion
        if name == "e":
            return Quantity(SCALARS["e"].label, self.e_unit)
        layers = {each.name: each for each in self.config.estimator.layers}
        return Quantity(layers[name].label, layers[name].unit) if name in layers else SCALARS[name]
