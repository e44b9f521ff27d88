"""The base class of the estimators of the pose covariance, its settings, and its input."""

from __future__ import annotations

import inspect
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, is_dataclass
from typing import Any, ClassVar, TypeVar, get_args, get_type_hints

import numpy as np

from locplan._support.checks import (
    Settings,
    check_positive,
    checked_setting,
    format_suggestion,
    short_repr,
)
from locplan._support.kernels.arrays import Floats, Ints, Octets
from locplan.errors import ConfigError, FieldError
from locplan.field.search_window import OffsetLattice
from locplan.robots.lidar import Lidar

T = TypeVar("T")
Values = dict[str, Floats]
"""Arrays by name: "covariance", and the layers of an estimator."""


TILE_CELLS = 512
"""Maximum edge length of a tile on the map, which bounds the layout's memory [cells]."""


@dataclass(frozen=True)
class EstimatorLayer:
    """A value that an estimator gives for each place, in addition to the covariance."""

    name: str
    """Name of the layer in files and on the command line, such as "ambiguity"."""
    label: str
    """Label of the layer at a colour bar."""
    unit: str
    """Unit of the values in text; "1" for a plain number."""
    anchors: Callable[[OffsetLattice], tuple[float, float]]
    """Function that gives the layer's value for a perfect match and for a featureless place."""


@dataclass(frozen=True, eq=False, repr=False)
class MapPart:
    """Some cells of a map, with the part of the map that their covariances depend on.

    It is what `Estimator.covariances` works on; only who writes an estimator needs to know it.
    """

    levels: Octets
    """Levels of the part, (h, w); it reaches `Estimator.halo` cells beyond each of the cells."""
    rows: Ints
    """Rows of the cells in the whole map, (n,)."""
    cols: Ints
    """Columns of the cells in the whole map, (n,)."""
    resolution: float
    """Edge of a cell [m]."""
    map_shape: tuple[int, int]
    """Shape of the whole map, about whose centre it is turned."""
    corner: tuple[int, int] = (0, 0)
    """Row and column of the whole map where the part begins."""
    headings: Floats = field(default_factory=lambda: np.zeros(1))
    """Headings of the robot in the grid's own axes, (k,) [rad]."""
    prepared: Any = None
    """Result of `Estimator.prepare` for these levels, or None."""
    control: Ints = field(default_factory=lambda: np.zeros(2, np.int64))
    """Two numbers shared with other threads: 1 to stop early, and the number of cells done.

    With the first one alone the cells are not counted.
    """

    @property
    def heading_axis(self) -> int | slice:
        """Index that takes the headings' axis away if there is only one, and keeps it otherwise."""
        return 0 if len(self.headings) == 1 else slice(None)

    def __repr__(self) -> str:
        return f"MapPart({len(self.rows)} cells, {self.levels.shape} of {self.map_shape})"

    @classmethod
    def from_map(cls, cells: Octets, rows: Ints, cols: Ints, resolution: float) -> MapPart:
        """Return a whole map as a part, with some of its cells; the robot heads along the rows.

        Parameters
        ----------
        cells : (H, W) array of uint8
            Levels of the map, row 0 at the lowest y.
        rows, cols : (n,) arrays of int64
            The cells whose covariances are needed.
        resolution : float
            Edge of a cell [m].
        """
        return cls(cells, rows, cols, resolution, (cells.shape[0], cells.shape[1]))


@dataclass(frozen=True, kw_only=True, repr=False)
class Estimator(Settings, ABC):
    """Base class of the estimators of a pose match's covariance, frozen dataclasses of settings.

    A setting out of its range is a ConfigError when the estimator is made. A new estimator is a
    subclass in a new module and a line in `locplan.field.estimators`.
    """

    name: ClassVar[str]
    """Name of the estimator on the command line and in files."""
    layers: ClassVar[tuple[EstimatorLayer, ...]] = ()
    """Values that the estimator gives for each place besides the covariance."""
    remedy: ClassVar[str] = ""
    """Advice to the user where much of a field is saturated."""
    weight: ClassVar[float] = 4.0
    """Metres of detour accepted per degenerate metre, by default."""
    criterion: ClassVar[str] = "e"
    """Scalar or layer that the degeneracy u is made of, by default."""
    casts_rays: ClassVar[bool] = False
    """True if the estimator simulates a lidar, which must not stand in a wall.

    Its first setting is the lidar.
    """

    noise_level: float = checked_setting(1.0, check_positive, "times Sigma")
    """Factor k on the covariance (Eq. 8), above 0."""

    def __post_init__(self) -> None:
        if not (isinstance(getattr(self, "name", None), str) and self.name.strip()):
            kind = type(self).__name__
            raise ConfigError(f'estimator {kind} has no name; add name = "..." to the class')
        super().__post_init__()

    @abstractmethod
    def lattice(self, resolution: float) -> OffsetLattice:
        """Return the lattice of pose offsets that bounds the covariance.

        Parameters
        ----------
        resolution : float
            Edge of a cell of the map [m].

        Raises
        ------
        ConfigError
            If the cells are too coarse or too fine for the search window.
        """

    @property
    @abstractmethod
    def reach(self) -> float:
        """Maximum distance at which walls affect the estimator [m]."""

    @property
    @abstractmethod
    def title(self) -> str:
        """Name of the estimator, its lidar and range, and its most important settings."""

    def with_lidar(self, lidar: Lidar) -> Estimator:
        """Return this estimator with a different lidar and otherwise equal settings.

        Parameters
        ----------
        lidar : Lidar
            The lidar.

        Raises
        ------
        ConfigError
            If the estimator has nothing to do with a lidar.
        """
        raise ConfigError(f"estimator {self.name} knows no lidar; leave the lidar out")

    @property
    def headings(self) -> int:
        """Default number of headings of a field; 1 if all headings have equal values."""
        return 1

    @abstractmethod
    def covariances(self, part: MapPart) -> Values:
        """Compute the covariance of a pose match at each cell of a part of a map, in the grid's
        axes.

        Parameters
        ----------
        part : MapPart
            The n cells, the levels around them, and k headings of the robot. Its `control` is
            read, so that the computation can be stopped, and counts the cells that are done.

        Returns
        -------
        dict of arrays
            "covariance", (n, d, d), or (n, k, d, d) for several headings, with d = 3 for (x, y,
            theta) [m, m, rad], or d = 2 without turns; each of `layers`, (n,) or (n, k).
            All finite, and the covariances symmetric, without negative eigenvalues; NaN only if the
            computation was stopped early. A cell's values depend only on the map within `halo`. A
            few cells are checked.
        """

    def prepare(self, levels: Octets, resolution: float) -> object:
        """Prepare data from a map or a part of it, for all threads to share.

        Parameters
        ----------
        levels : (h, w) array of uint8
            Levels of the cells, row 0 at the lowest y.
        resolution : float
            Edge of a cell [m].

        Returns
        -------
        object
            What `MapPart.prepared` will be; None where nothing is prepared.
        """
        return None

    @abstractmethod
    def halo(self, resolution: float, map_shape: tuple[int, int]) -> int:
        """Return how far the covariance of a cell depends on the map around it [cells].

        Parameters
        ----------
        resolution : float
            Edge of a cell of the map [m].
        map_shape : (int, int)
            Number of rows and columns of the whole map.
        """

    def memory(self, resolution: float, map_shape: tuple[int, int]) -> float:
        """Return the memory of a tile, or of the result of `prepare` that all tiles share [bytes].

        Parameters
        ----------
        resolution, map_shape
            See `Estimator.halo`.
        """
        return 0.0

    def seconds(self, resolution: float) -> float:
        """Return a rough upper estimate of one thread's time for a place and a heading [s].

        It sets the size of the tiles. Only whole tiles are stored.

        Parameters
        ----------
        resolution : float
            Edge of a cell of the map [m].
        """
        return 1e-3

    def identity(self) -> dict[str, object]:
        """Return the settings that decide the values of a field, fit for JSON."""
        return dict_from_settings(self)

    def perfect(self, lattice: OffsetLattice) -> Floats:
        """Return the greatest covariance of a perfect match, where u is 0, (d, d).

        Parameters
        ----------
        lattice : OffsetLattice
            Lattice of the offsets on the map, which `lattice` gives.
        """
        return lattice.quantisation

    def featureless(self, lattice: OffsetLattice) -> Floats:
        """Return the covariance of a featureless place, where u is 1, (d, d).

        Parameters
        ----------
        lattice
            See `Estimator.perfect`.
        """
        return self.noise_level * lattice.uniform_covariance + self.q(lattice)

    def q(self, lattice: OffsetLattice) -> Floats:
        """Return Q, the variance that the estimator's steps of offset cannot resolve, (d, d).

        Parameters
        ----------
        lattice
            See `Estimator.perfect`.
        """
        return lattice.quantisation

    @property
    def adds_q(self) -> bool:
        """True if the covariances include Q; u is computed from Sigma + Q in any case."""
        return True


def dict_from_settings(owner: Any) -> dict[str, object]:
    """Return settings as JSON restores them; an object begins with its class variable `name`."""
    settings = {"name": type(owner).name} if hasattr(type(owner), "name") else {}
    for attribute in fields(owner):
        value = getattr(owner, attribute.name)
        value = list(value) if isinstance(value, tuple) else value
        settings[attribute.name] = dict_from_settings(value) if is_dataclass(value) else value
    return settings


def list_settings_classes(owner: Any) -> list[type]:
    """List the class of settings, and the classes of all settings in them."""
    values = [getattr(owner, attribute.name) for attribute in fields(owner)]
    inner = [
        kind for value in values if is_dataclass(value) for kind in list_settings_classes(value)
    ]
    return [type(owner), *inner]


def is_from_locplan(owner: Any) -> bool:
    """True if settings, and all settings in them, are of locplan's classes."""
    return all(kind.__module__.startswith("locplan.") for kind in list_settings_classes(owner))


def declared_versions(owner: Any) -> list[str]:
    """List the versions of the user's classes in settings; a FieldError if one has none."""
    user_kinds = [
        kind for kind in list_settings_classes(owner) if not kind.__module__.startswith("locplan.")
    ]
    versions = [getattr(kind, "version", None) for kind in user_kinds]
    for kind, version in zip(user_kinds, versions, strict=True):
        if version is None:
            remedy = "add `version = 1` to the class, and raise it when its values change"
            raise FieldError(f"{kind.__name__} declares no version; {remedy}")
    return [str(version) for version in versions]


def build_settings(kind: type[T], settings: Mapping[str, object]) -> T:
    """Build an object from the result of `dict_from_settings`; missing settings get defaults."""
    arguments = {name: value for name, value in settings.items() if name != "name"}
    hints, parameters = get_type_hints(kind), inspect.signature(kind).parameters
    for name in arguments:
        if name not in parameters:
            owner = getattr(kind, "name", kind.__name__)
            names = f"{', '.join(parameters)}{format_suggestion(name, parameters)}"
            raise ConfigError(f"{owner} has no setting {short_repr(name)}; it has: {names}")
    keywords = {name: _build_nested(name, hints[name], value) for name, value in arguments.items()}
    try:
        return kind(**keywords)
    except TypeError as error:  # a setting without a default is missing
        raise ConfigError(" ".join(str(error).split())) from None


def _build_nested(name: str, hint: Any, value: object) -> object:
    """Build a setting that is an object, or a tuple from a list."""
    if not isinstance(value, Mapping):
        return value
    kinds: list[Any] = [
        candidate for candidate in get_args(hint) or (hint,) if is_dataclass(candidate)
    ]
    matches = [kind for kind in kinds if getattr(kind, "name", None) == value.get("name")]
    if len(matches) != 1:
        raise ConfigError(f"{name} cannot be made of {short_repr(dict(value))}")
    return build_settings(matches[0], value)
