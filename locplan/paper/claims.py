"""The paper's experiments on our maps: seven models in one dimension, and claims about places.

Source: "Localizability estimation using correlation on occupancy grid maps", ROBOMECH Journal 10
(2023), doi 10.1186/s40648-023-00256-w.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from locplan._support.kernels.arrays import Bools, Floats, Ints, Octets
from locplan.field.covariance import position_axes, scalar
from locplan.field.estimator import MapPart
from locplan.field.sad import Sad
from locplan.maps import environments
from locplan.maps.grid import OccupancyGrid
from locplan.maps.occupancy import FREE, OCCUPIED, UNKNOWN
from locplan.paper.template_matching import (
    DIFFERENCES,
    compare_models_along_strip,
    compute_mismatch_areas,
)

PLACES = {"A": "places", "B": "places", "C": "places", "D": "places", "E": "hall"}
"""The environment in which each of the paper's places lies, see `environments.landmarks`."""

_FREE_ROOM = ((FREE, 6.0),)
_HALF_ROOM = ((FREE, 3.0), (OCCUPIED, 3.0))
_STRIPS = (
    ("free on free | occupied", _FREE_ROOM, ((FREE, 7.5), (OCCUPIED, 7.5))),
    ("free on free | unknown", _FREE_ROOM, ((FREE, 7.5), (UNKNOWN, 7.5))),
    (
        "free | occupied on free | occupied | unknown",
        _HALF_ROOM,
        ((FREE, 5.0), (OCCUPIED, 5.0), (UNKNOWN, 5.0)),
    ),
)
_HEIGHT = 6.0  # height of templates and strips [m]


@dataclass(frozen=True, eq=False, repr=False)
class TemplateSlide:
    """A template slid along a strip of map (Figs. 4-11)."""

    title: str
    """Levels of the template and of the strip as text."""
    template: Octets
    """Levels of the template's cells, 6 m x 6 m, (h, w)."""
    strip: Octets
    """Levels of the strip's cells, 15 m x 6 m, (h, W)."""
    shift: Floats
    """Distance of the template's left edge from the strip's, (n,) [m]."""
    curves: Mapping[str, Floats]
    """Values of each of the seven models by its name, (n,); NaN where a model is undefined."""

    def __repr__(self) -> str:
        return f"Slide({self.title}, {len(self.shift)} shifts)"

    def is_constant_until(self, model: str, shift: float) -> bool:
        """True if a model is defined, and constant, for all shifts from 0 to `shift`.

        Parameters
        ----------
        model : str
            Name of a model, see `locplan.paper.template_matching.MODELS`.
        shift : float
            The last shift that counts [m], >= 0.
        """
        values = self.curves[model][self.shift <= shift + 1e-9]
        return bool((values == values[0]).all())

    def find_peaks(self, model: str) -> Floats:
        """Return the shifts of a model's best value, (k,) [m]; none if all values are equal.

        Parameters
        ----------
        model : str
            Name of a model, see `locplan.paper.template_matching.MODELS`.
        """
        values = self.curves[model] * (-1 if model in DIFFERENCES else 1)
        if np.isnan(values).all() or np.nanmax(values) == np.nanmin(values):
            return np.empty(0)
        return np.asarray(self.shift[values == np.nanmax(values)])


def compare_models_along_strips(resolution: float = 0.05) -> tuple[TemplateSlide, ...]:
    """Compute the seven models for templates slid along strips of map (Figs. 4-11).

    Templates of 6 m x 6 m, free or half free and half occupied, are slid by 9 m along strips of
    15 m x 6 m whose levels change at halves or thirds.

    Parameters
    ----------
    resolution : float, default 0.05
        Edge of a cell [m], above 0; the slides have a shift for each cell.

    Examples
    --------
    >>> [float(slide.find_peaks("SAD").max()) for slide in compare_models_along_strips()]
    [1.5, 1.5, 2.0]
    """
    slides = []
    for title, room, parts in _STRIPS:
        template, strip = (_make_strip(widths, resolution) for widths in (room, parts))
        curves = compare_models_along_strip(template, strip)
        shift = np.arange(len(curves["SAD"]), dtype=np.float64) * resolution
        slides.append(TemplateSlide(title, template, strip, shift, curves))
    return tuple(slides)


def _make_strip(parts: tuple[tuple[int, float], ...], resolution: float) -> Octets:
    """Make a strip of map from levels and widths [m], side by side."""
    levels = [np.full(round(width / resolution), level, np.uint8) for level, width in parts]
    return np.tile(np.concatenate(levels), (round(_HEIGHT / resolution), 1))


Covariances = Mapping[str, Floats]
"""Covariances by place, at the same offsets from each, (n, 3, 3)."""


ClaimTest = Callable[[Covariances], Bools]


def _make_lower_test(lower: str, upper: str, name: str = "e") -> ClaimTest:
    """Return a test that a scalar is lower at each of the places `lower` than at any of `upper`."""

    def is_lower(covariances: Covariances) -> Bools:
        low, high = (np.array([scalar(covariances[k], name) for k in ks]) for ks in (lower, upper))
        return np.asarray(1.01 * low.max(axis=0) < high.min(axis=0))

    return is_lower


def _lies_along_x(covariances: Covariances) -> Bools:
    """True for covariances whose largest standard deviation is along x."""
    major, minor, direction = position_axes(covariances["B"])
    return np.asarray((abs(direction) < np.radians(5)) & (major > 2 * minor))


CLAIMS: dict[str, ClaimTest] = {
    "A, the complex room, has the least e": _make_lower_test("A", "BCDE"),
    "B, the corridor, is above A": _make_lower_test("A", "B"),
    "the ellipse at B lies along the corridor": _lies_along_x,
    "C, the round room, has the largest heading deviation of A-D": _make_lower_test(
        "ABD", "C", "heading_std"
    ),
    "D, the repeating corridor, is above A": _make_lower_test("A", "D"),
    "E, open beyond the range, has the largest e": _make_lower_test("ABCD", "E"),
}
"""The paper's claims about its places (Figs. 29-32), as tests on the covariances there."""


def draw_place_maps(
    *, resolution: float = 0.05, boundary_noise: float = 0.0, seed: int = 0
) -> dict[str, OccupancyGrid]:
    """Draw the maps of the paper's places, by name.

    Parameters
    ----------
    resolution, boundary_noise, seed
        See `locplan.maps.environments.make`.

    Raises
    ------
    ConfigError
        If a value is out of its range.
    """
    make = partial(environments.make, resolution=resolution, boundary_noise=boundary_noise)
    return {name: make(name, seed=seed) for name in dict.fromkeys(PLACES.values())}


def compute_place_mismatch(maps: Mapping[str, OccupancyGrid], place: str, estimator: Sad) -> Floats:
    """Compute the mismatch at a place at every offset of the window, (dx, dy, theta) [m^2].

    Parameters
    ----------
    maps : mapping of str to OccupancyGrid
        The maps, from `draw_place_maps`.
    place : str
        The place, "A" to "E".
    estimator : Sad
        The estimator, whose template and search window are taken.
    """
    grid = maps[PLACES[place]]
    return compute_mismatch_areas(
        grid, *environments.place_positions(PLACES[place])[place], estimator
    )


def compute_place_covariances(
    maps: Mapping[str, OccupancyGrid], estimator: Sad, *, around: float = 0.4
) -> Covariances:
    """Compute the covariances at the places A-E.

    Parameters
    ----------
    maps : mapping of str to OccupancyGrid
        The maps, from `draw_place_maps`.
    estimator : Sad
        The estimator of the covariances; the claims use `Sad.paper`.
    around : float, default 0.4
        Distance along x and y of eight more poses on a square around each place [m], >= 0; 0 adds
        none.

    Returns
    -------
    mapping of str to (n, 3, 3) array
        Covariances by place; n is 1, or 9 with those around.
    """
    shifts = np.unique([-around, 0.0, around])
    dx, dy = (axis.ravel() for axis in np.meshgrid(shifts, shifts))
    covariances = {}
    for place, name in PLACES.items():
        x, y = environments.place_positions(name)[place]
        rows, cols = np.floor(maps[name].world_to_grid(x + dx, y + dy)).astype(np.int64)
        covariances[place] = _compute_covariances(maps[name], rows, cols, estimator)
    return covariances


def compute_claim_shares(
    maps: Mapping[str, OccupancyGrid], estimator: Sad, *, around: float = 0.4
) -> dict[str, float]:
    """Compute the share of the poses at which each claim holds, 0..1, by the claim's text.

    Parameters
    ----------
    maps, estimator, around
        See `compute_place_covariances`.
    """
    covariances = compute_place_covariances(maps, estimator, around=around)
    return {claim: float(holds(covariances).mean()) for claim, holds in CLAIMS.items()}


def compute_share_smaller_with_range(
    grid: OccupancyGrid, estimator: Sad, longer: float = 8.0, *, spacing: float = 1.0
) -> float:
    """Compute the share of poses whose e does not grow with a longer range, 0..1.

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    estimator : Sad
        The estimator with the shorter range.
    longer : float, default 8.0
        The longer range [m].
    spacing : float, default 1.0
        Distance of the poses along x and y [m], at least a cell.
    """
    step = round(spacing / grid.resolution)
    is_sampled = np.zeros(grid.shape, bool)
    is_sampled[step // 2 :: step, step // 2 :: step] = True
    rows, cols = np.nonzero(is_sampled & grid.free)
    estimators = estimator, replace(estimator, range=longer)
    shorter, further = (
        scalar(_compute_covariances(grid, rows, cols, ranged_estimator), "e")
        for ranged_estimator in estimators
    )
    return float(np.mean(further <= shorter * (1 + 1e-9)))


def _compute_covariances(grid: OccupancyGrid, rows: Ints, cols: Ints, estimator: Sad) -> Floats:
    """Compute the covariances at some cells."""
    part = MapPart.from_map(grid.cells, rows, cols, grid.resolution)
    return estimator.covariances(part)["covariance"]
