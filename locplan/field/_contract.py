"""What an estimator promises of its covariances: their arrays, and the halo that decides them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from locplan._util.checks import shown, whole
from locplan.errors import FieldError
from locplan.field._estimator import Estimator, MapPart, Values
from locplan.maps import FREE

TOLERANCE = 1e-6
"""Rounding that is let pass, of the greatest value beside it."""
MIN_ROUNDING = 1e-9
"""Rounding that is let pass in any case, of the variances of a featureless place."""


def check_values(values: object, estimator: Estimator, part: MapPart) -> None:
    """Raise a FieldError unless values are an estimator's covariances and layers at some cells.

    Parameters
    ----------
    values : object
        What `Estimator.covariances` has returned, and no stop had been asked for.
    estimator : Estimator
        The estimator.
    part : MapPart
        The n cells, and k headings; the levels around them are not read.
    """
    expected = ["covariance", *(layer.name for layer in estimator.layers)]
    if not isinstance(values, dict) or set(values) != set(expected):
        given = _listed(values) if isinstance(values, dict) else shown(values)
        problem = f"covariances() must return a dict with {_listed(expected)}, not {given}"
        raise _wrong(estimator, f"{problem}; name all others in `layers`")
    lattice = estimator.lattice(part.resolution)
    for name in expected:
        axes = (lattice.dimension,) * 2 if name == "covariance" else ()
        _check_array(name, values[name], estimator, part, axes)
    scale = np.sqrt(np.diag(lattice.uniform_covariance + lattice.quantisation))
    covariance = values["covariance"] / np.outer(scale, scale)
    skew = np.abs(covariance - np.swapaxes(covariance, -2, -1)).max(axis=(-2, -1))
    rounding = MIN_ROUNDING + TOLERANCE * np.abs(covariance).max(axis=(-2, -1))
    _refuse(skew > rounding, "a covariance that is not symmetric", estimator, part)
    least = np.linalg.eigvalsh(covariance)[..., 0]
    _refuse(least < -rounding, "a covariance with a negative eigenvalue", estimator, part)


def check_halo(
    estimator: Estimator, part: MapPart, values: Values, levels: NDArray[np.uint8]
) -> None:
    """Raise a FieldError if the map beyond an estimator's halo matters to some cells of a part.

    They are computed again, each alone, with free and occupied cells swapped beyond the halo.

    Parameters
    ----------
    estimator : Estimator
        The estimator.
    part : MapPart
        The cells, at least one.
    values : dict of arrays
        The values of the part, which `check_values` has let pass.
    levels : (H, W) array of uint8
        Levels of the whole map.
    """
    halo = halo_of(estimator, part.resolution, part.map_shape)
    for at in np.unique(np.linspace(0, len(part.rows) - 1, 3).astype(int)):
        again = estimator.covariances(_alone(estimator, part, at, halo, levels))
        if not all(_alike(again[name][0], array[at]) for name, array in values.items()):
            raise _wrong(
                estimator,
                f"the values at {_cell(part, at)} change with the map beyond the halo of {halo}"
                " cells; let halo() reach as far as it looks, and draw no random numbers",
            )


def halo_of(estimator: Estimator, resolution: float, map_shape: tuple[int, int]) -> int:
    """The halo of an estimator [cells]; a ConfigError if it is no whole number."""
    halo = estimator.halo(resolution, map_shape)
    return whole(f"halo() of estimator {shown(estimator.name)}", halo, 0)


def _check_array(
    name: str, array: object, estimator: Estimator, part: MapPart, axes: tuple[int, ...]
) -> None:
    headings = len(part.headings)
    places = (len(part.rows),) if headings == 1 else (len(part.rows), headings)
    shape = (*places, *axes)
    if not isinstance(array, np.ndarray) or array.shape != shape or array.dtype.kind not in "fiu":
        given = shown(array)
        if isinstance(array, np.ndarray):
            given = f"{array.dtype} of shape {array.shape}"
        problem = f"{shown(name)} must be an array of numbers of shape {shape}, not {given}"
        raise _wrong(estimator, problem)
    lost = np.isfinite(array).reshape(*places, -1).min(axis=-1, keepdims=True) == 0
    _refuse(lost, f"a {name} that is not finite", estimator, part)


def _refuse(bad: NDArray[np.bool_], what: str, estimator: Estimator, part: MapPart) -> None:
    """Raise a FieldError that names the first of the bad places, if there are some."""
    if bad.any():
        where = _cell(part, np.argwhere(bad)[0][0])
        raise _wrong(estimator, f"{where} has {what}; correct covariances() there")


def _cell(part: MapPart, at: int) -> str:
    return f"row {part.rows[at]}, column {part.cols[at]} of the map"


def _wrong(estimator: Estimator, problem: str) -> FieldError:
    return FieldError(f"estimator {shown(estimator.name)}: {problem}")


def _listed(names: Iterable[str]) -> str:
    return ", ".join(map(shown, names))


def _alone(
    estimator: Estimator, part: MapPart, at: int, halo: int, levels: NDArray[np.uint8]
) -> MapPart:
    """One cell of a part, with the map up to the halo and a ring of another map around that."""
    row, col = int(part.rows[at]), int(part.cols[at])

    def box(reach: int) -> tuple[slice, slice]:
        rows, cols = (slice(max(0, i - reach), i + reach + 1) for i in (row, col))
        return rows, cols

    # A ring beyond the halo, which must not matter.
    around, outer = FREE - levels, box(halo + 16)
    around[box(halo)] = levels[box(halo)]
    return replace(
        part,
        levels=around[outer],
        rows=part.rows[[at]],
        cols=part.cols[[at]],
        corner=(outer[0].start, outer[1].start),
        prepared=estimator.prepare(around[outer], part.resolution),
        control=np.zeros_like(part.control),
    )


def _alike(one: NDArray[np.float64], other: NDArray[np.float64]) -> bool:
    greatest = np.abs(other).max(initial=MIN_ROUNDING)
    return one.shape == other.shape and bool((np.abs(one - other) <= TOLERANCE * greatest).all())
