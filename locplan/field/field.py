"""The covariance field of a map: evaluated on a lattice, interpolated on the whole map."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal, overload

import numpy as np
from numpy.typing import ArrayLike

from locplan._support.checks import check_file_path
from locplan._support.files import check_writable_file
from locplan._support.kernels.arrays import Array, Bools, Floats
from locplan._support.progress import ProgressCallback
from locplan._support.public import DrawableResult
from locplan._support.saved import EqualByValue
from locplan.errors import FieldError
from locplan.field import files, lattice, tiles
from locplan.field.compute import compute_missing_chunks
from locplan.field.config import FieldConfig
from locplan.field.covariance import QuantityLabel, compute_anchors, find_quantity, scalar
from locplan.field.estimator import Values
from locplan.field.poses import interpolate_at_poses
from locplan.field.search_window import OffsetLattice
from locplan.maps.grid import OccupancyGrid, check_grid

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from xarray import Dataset


@dataclass(frozen=True, eq=False, repr=False)
class CovarianceField(DrawableResult, EqualByValue):
    """Covariances of a pose match over a map.

    Lattice point ``(i, j)`` is the centre of cell ``(i * stride, j * stride)``.

    Parameters
    ----------
    covariance : (h, w, d, d) or (h, w, n, d, d) array of float64
        Covariances of (x, y, theta) [m, m, rad] in the world frame, or of (x, y) without rotation
        (d = 2); n headings of the robot (`config.heading_angles`) if the config has several. NaN
        where not evaluated.
    grid : OccupancyGrid
        The map, (H, W) cells.
    config : FieldConfig
        The settings that the covariances were computed with.
    layers : dict of (h, w) or (h, w, n) arrays
        The estimator's additional values by name, see `Estimator.layers`.
    """

    covariance: Floats
    grid: OccupancyGrid
    config: FieldConfig
    layers: Mapping[str, Floats] = field(default_factory=dict)

    @classmethod
    def from_values(
        cls, values: Values, grid: OccupancyGrid, config: FieldConfig
    ) -> CovarianceField:
        """Make a field from its arrays by name.

        Parameters
        ----------
        values : dict of arrays
            "covariance", and the layers by their names, shaped as in the class.
        grid, config
            See `CovarianceField`.
        """
        layers = {name: array for name, array in values.items() if name != "covariance"}
        return cls(values["covariance"], grid, config, layers)

    @property
    def values(self) -> Values:
        """All arrays by name, "covariance" first."""
        return {"covariance": self.covariance, **self.layers}

    def __repr__(self) -> str:
        e = self.e[self.is_evaluated]
        median = f", median e {np.median(e):.3g} {self.e_unit}" if e.size else ""
        return (
            f"CovarianceField({self.grid.name or 'map'}: {int(self.is_evaluated.sum())} cells every"
            f" {self.stride * self.grid.resolution:g} m, {self.config.estimator.title}{median})"
        )

    @property
    def stride(self) -> int:
        """Spacing of the lattice [cells]."""
        return lattice.stride_cells(self.config.stride, self.grid.resolution)

    @cached_property
    def is_evaluated(self) -> Bools:
        """Mask of the lattice points with a covariance, (h, w)."""
        return tiles.find_computed_points(self.values)

    @cached_property
    def is_interpolated(self) -> Bools:
        """Mask of the lattice points that are interpolated from their neighbours, (h, w).

        There are none unless only some points were asked for; see `load_or_compute`.
        """
        return lattice.select_evaluated_points(self.grid.free, self.stride) & ~self.is_evaluated

    @property
    def window(self) -> OffsetLattice:
        """Lattice of the offsets that were compared at each cell."""
        return self.config.estimator.lattice(self.grid.resolution)

    @cached_property
    def e(self) -> Floats:
        """sqrt(det Sigma) (Eq. 10), (h, w) or (h, w, n) [m^2 rad]; NaN where not evaluated."""
        e = np.full(self.covariance.shape[:-2], np.nan)
        e[self.is_evaluated] = scalar(self.covariance[self.is_evaluated], "e")
        return e

    def scalar(
        self, name: str, *, headings: Literal["mean", "worst"] | None = None, with_q: bool = False
    ) -> Floats:
        """Return a scalar on the lattice, (h, w), or (h, w, n) for n headings.

        Parameters
        ----------
        name : str
            "e", "position_std", "position_rms" or "heading_std", see `locplan.field.scalar`,
            or one of `layers`; another name is a ConfigError.
        headings : "mean" or "worst", optional
            One value for all headings, (h, w): for "mean" from the mean information (of a layer,
            the mean), for "worst" the greatest.
        with_q : bool, default False
            True to use Sigma + Q, as u does, even if the estimator has not added Q.
        """
        if name in self.layers:
            values = self.layers[name]
            values = values.mean(axis=2) if values.ndim == 3 and headings == "mean" else values
        else:
            covariance = self.quantised_covariance if with_q else self.covariance
            if headings == "mean":
                is_stored = covariance is self.covariance
                covariance = (
                    self.average_headings
                    if is_stored
                    else lattice.merge_headings(covariance, self.is_evaluated)
                )
            has_cached_e = name == "e" and covariance is self.covariance
            values = self.e if has_cached_e else scalar(covariance, name)
        return values.max(axis=2) if values.ndim == 3 and headings == "worst" else values

    @cached_property
    def average_headings(self) -> Floats:
        """Covariance of the mean information over the headings, (h, w, d, d)."""
        return lattice.merge_headings(self.covariance, self.is_evaluated)

    @property
    def quantised_covariance(self) -> Floats:
        """The covariance that u is computed from: Sigma + Q, shaped like `covariance`."""
        estimator = self.config.estimator
        return self.covariance if estimator.adds_q else self.covariance + estimator.q(self.window)

    def anchors(self, name: str = "e") -> tuple[float, float]:
        """Return the values of a scalar or layer for a perfect match and for a featureless place.

        Parameters
        ----------
        name : str, default "e"
            See `scalar`; the estimator itself defines the anchors of its layers.
        """
        return compute_anchors(self.config.estimator, self.window, name)

    @property
    def saturated_share(self) -> float:
        """Share of the evaluated points whose scalar is within 5 % of the perfect match's.

        The scalar is the estimator's criterion. At these points better matches have no effect. Zero
        for an empty field.
        """
        criterion = self.config.estimator.criterion
        values = self.scalar(criterion, with_q=True)[
            lattice.select_points_evenly(self.is_evaluated, self.is_interpolated)
        ]
        perfect_value, _ = self.anchors(criterion)
        return float(np.mean(values <= 1.05 * perfect_value)) if values.size else 0.0

    @property
    def e_unit(self) -> str:
        """Unit of e; without the angle if poses have no heading."""
        return "m² rad" if self.window.dimension == 3 else "m²"

    def quantity(self, name: str | None = None) -> QuantityLabel:
        """Return label and unit of a scalar or a layer, and the factor to that unit.

        Parameters
        ----------
        name : str, optional
            See `scalar`; by default it is the estimator's criterion, which u is made of.
        """
        return find_quantity(self.config.estimator, self.e_unit, name)

    def e_map(self) -> Floats:
        """`e` on the map's free cells, (H, W) or (H, W, n) [m^2 rad], bilinear in ln e, or NaN."""
        return self.interpolate_on_map(self.e)

    def interpolate_on_map(
        self, values: Floats, *, logarithmic: bool = True, cells: Sequence[Array] | None = None
    ) -> Floats:
        """Interpolate values to the map's free cells, (H, W) or (H, W, n); NaN elsewhere.

        A corner without a value leaves its weight to the remaining corners.

        Parameters
        ----------
        values : (h, w) or (h, w, n) array
            Values on the lattice, such as `scalar` gives.
        logarithmic : bool, default True
            True to interpolate the logarithm of positive values, as for e; False to interpolate the
            values themselves, as for layers.
        cells : (rows, cols), optional
            The cells to read instead, broadcast together; they may lie between cells, free or not.
        """
        if values.ndim == 3:
            layers = np.empty((values.shape[2], *self.grid.shape))
            for k, layer in enumerate(layers):
                layer[:] = self.interpolate_on_map(values[:, :, k], logarithmic=logarithmic)
            return np.moveaxis(layers, 0, 2)
        if logarithmic:
            values = np.log(np.maximum(values, np.finfo(float).tiny))
        lattice_values = values
        if self.is_interpolated.any():
            lattice_values = lattice.fill_lacking_points(
                values, self.is_evaluated, self.is_interpolated
            )
        if cells is None:
            result = lattice.interpolate_lattice_on_map(lattice_values, self.grid.free, self.stride)
        else:
            result = lattice.interpolate_lattice_at_cells(lattice_values, self.stride, *cells)
        return np.exp(result, out=result) if logarithmic else result

    @overload
    def at(self, poses: ArrayLike, name: None = None) -> dict[str, Floats]: ...
    @overload
    def at(self, poses: ArrayLike, name: str) -> Floats: ...
    def at(self, poses: ArrayLike, name: str | None = None) -> Any:
        """Return the values at poses, interpolated between lattice points and between headings.

        Covariances are interpolated in the matrix logarithm, so that ln e is bilinear, and layers
        as they are. In cells that are not free and outside the map all values are NaN. Poses that
        are not finite are a PoseError, and an unknown name is a ConfigError.

        Parameters
        ----------
        poses : (n, 2) or (n, 3) array, or one (x, y) or (x, y, heading)
            Poses in the world [m, m, rad]. If they have no heading, all headings count together.
        name : str, optional
            "covariance" (n, d, d) [m, m, rad], "e" [m^2 rad], "position_std" [m], "position_rms"
            [m], "heading_std" [rad], see `locplan.field.scalar`, or a layer, (n,) each. By default
            all of them are returned by name. The values of one pose have no first axis.

        Examples
        --------
        >>> from locplan import covariance_field, Sad
        >>> grid = OccupancyGrid(np.full((30, 30), 254), resolution=0.1)
        >>> field = covariance_field(grid, Sad(range=0.5))
        >>> field.at([[1.0, 1.5], [1.2, 1.5], [9.0, 9.0]], "position_std").round(2).tolist()
        [1.13, 1.12, nan]
        """
        return interpolate_at_poses(self, poses, name)

    def to_xarray(self) -> Dataset:
        """Return all arrays with their coordinates as an xarray.Dataset.

        Raises
        ------
        LocplanError
            If xarray is not installed.
        """

        return tiles.build_dataset(self.values, self.e, self.e_unit, self.grid, self.config)

    def update(
        self,
        grid: OccupancyGrid,
        *,
        points: Bools | None = None,
        threads: int | None = None,
        executor: Executor | None = None,
        progress: ProgressCallback | None = None,
    ) -> CovarianceField:
        """Return the field of an edited map; recompute only values that the edit can change.

        It equals `covariance_field` of the new map bit for bit.

        Parameters
        ----------
        grid : OccupancyGrid
            The new map, of the same shape, resolution and origin.
        points, threads, executor, progress
            See `covariance_field`; unchanged points stay, even if `points` lacks them.

        Raises
        ------
        FieldError
            If the maps differ in more than their cells.
        """
        check_grid(grid)
        same = tiles.find_unchanged_points(self.grid, grid, self.config)
        values = tiles.make_empty_values(grid, self.config)
        for name, array in self.values.items():
            values[name][same] = array[same]
        arguments = grid, self.config, threads, executor, progress
        for _ in compute_missing_chunks(
            values, *arguments, tiles.find_required_points(*arguments[:2], points)
        ):
            pass
        return CovarianceField.from_values(values, grid, self.config)

    def save(
        self, path: str | os.PathLike[str], *, extra_arrays: Mapping[str, Array] | None = None
    ) -> None:
        """Write the field with its map and config into a file, for `load`.

        ``numpy.load`` also reads it: "covariance", the layers, the levels "cells" of the map, and
        "about", JSON with the map's resolution and origin and the config.

        Parameters
        ----------
        path : path
            The file, named ``*.npz``. An existing file is replaced.
        extra_arrays : mapping of str to array, optional
            Further arrays, for use by your programs.

        Raises
        ------
        LocplanError
            If points are lacking, the estimator is not registered, or the file cannot be written.
        """
        target = check_file_path("a field", path)
        check_writable_file(target, files.FIELD_SUFFIX)
        files.check_readable(self.values, self.grid, self.config)
        if self.is_interpolated.any():
            raise FieldError(f"{self!r} has some of its points only; compute all to save it")
        metadata = files.make_metadata(self.grid, self.config)
        files.write_field(target, self.values, self.grid, metadata, extra_arrays)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> CovarianceField:
        """Read a field written by `save`.

        Parameters
        ----------
        path : path
            The file; a LocplanError if it is missing, damaged or no field.
        """
        return cls.from_values(*files.read_field(check_file_path("a field", path)))

    def figure(self, name: str | None = None) -> Figure:
        """Draw the map with one scalar of its field as a heat map.

        Parameters
        ----------
        name : str, optional
            "e", "position_std", "position_rms" or "heading_std", see `locplan.field.scalar`, or
            one of the field's layers; by default the estimator's criterion. For several headings,
            the mean information is drawn. Deviations are shown in cm and degrees.
        """
        from locplan.field.figures import field_figure

        return field_figure(self, name)
