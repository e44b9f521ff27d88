"""The search window: pose offsets (dx, dy, theta) to compare the map with itself."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from locplan._support.checks import Settings, check_positive, checked_setting
from locplan._support.kernels.arrays import Floats, Ints
from locplan.errors import ConfigError

MAX_STEPS = 1000
"""Maximum number of steps from the centre of the search window to its edge."""


@dataclass(frozen=True, kw_only=True, repr=False)
class SearchWindow(Settings):
    """Pose offsets around a place to search for a match; the defaults are the paper's.

    Raises
    ------
    ConfigError
        If a value is out of its range.

    Examples
    --------
    >>> SearchWindow().to_lattice(resolution=0.1).offsets.size
    21
    """

    half_width: float = checked_setting(2.0, check_positive, "m")
    """Maximum offset in x and in y [m], from `step` to 1000 times it.

    A larger one finds look-alike places farther away, in a time that grows with its square.
    """
    step: float = checked_setting(0.2, check_positive, "m")
    """Spacing of the offsets [m], above 0; the lidar's estimators round it to whole cells.

    Half of it resolves smaller deviations, in four times the time.
    """
    half_rotation_deg: float = checked_setting(60.0, 0.0, 180.0)
    """Maximum turn [deg], 0 to 180; 0 compares positions only, and then e has the unit m^2."""
    rotation_step_deg: float = checked_setting(10.0, check_positive, "deg")
    """Spacing of the turns [deg], above 0 up to `half_rotation_deg`."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.step > self.half_width:
            raise ConfigError(
                f"step ({self.step} m) must not exceed half_width ({self.half_width} m)"
            )
        for half, step in (("half_width", "step"), ("half_rotation_deg", "rotation_step_deg")):
            if getattr(self, half) > MAX_STEPS * getattr(self, step):
                raise ConfigError(f"{half} must be at most {MAX_STEPS} times {step}")
        if 0 < self.half_rotation_deg < self.rotation_step_deg:
            raise ConfigError(
                f"rotation_step_deg ({self.rotation_step_deg}) must not exceed"
                f" half_rotation_deg ({self.half_rotation_deg}); 0 compares positions only"
            )

    def to_lattice(self, resolution: float, *, exact: bool = False) -> OffsetLattice:
        """Return the lattice of the window's offsets on a map.

        Parameters
        ----------
        resolution : float
            Edge of a cell of the map [m].
        exact : bool, default False
            True to keep the step and round each offset to whole cells; False to round the step. A
            step below a cell becomes a cell in any case.

        Raises
        ------
        ConfigError
            If the cells are so large that zero is the window's only offset, or it has too many.
        """
        step_cells = max(1, round(self.step / resolution))
        step = step_cells * resolution
        # Up to a millionth aside of whole cells a step is still the same.
        exact &= resolution <= self.step and abs(step - self.step) > 1e-6 * step
        half_steps = round(self.half_width / (self.step if exact else step))
        if half_steps < 1:
            raise ConfigError(
                f"cells of {resolution:g} m do not resolve a search window of"
                f" +-{self.half_width:g} m; set a larger window"
            )
        lattice = OffsetLattice(
            resolution=resolution,
            step_cells=step_cells,
            half_steps=half_steps,
            rotation_step=math.radians(self.rotation_step_deg),
            half_rotations=math.floor(self.half_rotation_deg / self.rotation_step_deg + 1e-9),
            exact_step=self.step if exact else None,
        )
        if lattice.size > 10**7:  # each takes memory in each thread
            raise ConfigError(
                f"a search window of {lattice.size} offsets takes too much memory; set larger steps"
            )
        return lattice


@dataclass(frozen=True)
class OffsetLattice:
    """A search window on a map: offsets of ``-half_steps..half_steps`` steps, and turns.

    Along x and y the lattice has ``2 * half_steps + 1`` offsets, `step` apart. With a single turn
    the poses have two dimensions (x, y), otherwise three (x, y, theta).
    """

    resolution: float
    """Edge of a cell [m]."""
    step_cells: int
    """Spacing of the offsets [cells]."""
    half_steps: int
    """Number of offsets on either side of zero."""
    rotation_step: float
    """Spacing of the turns [rad]."""
    half_rotations: int
    """Number of turns on either side of zero."""
    exact_step: float | None = None
    """Spacing of the offsets where it is no whole number of cells, near `step_cells` [m]."""

    @property
    def step(self) -> float:
        """Spacing of the offsets [m]."""
        cell_step = self.step_cells * self.resolution
        return cell_step if self.exact_step is None else self.exact_step

    @property
    def cell_offsets(self) -> Ints:
        """Offsets along x, and likewise along y, each rounded to whole cells."""
        return np.rint(self.offsets / self.resolution).astype(np.int64)

    @property
    def reach(self) -> int:
        """Maximum offset in x and in y [cells]."""
        return int(self.cell_offsets[-1])

    @property
    def cell_lattice(self) -> OffsetLattice:
        """Lattice in steps of whole cells that encloses this one."""
        if self.exact_step is None:
            return self
        return replace(self, half_steps=-(-self.reach // self.step_cells), exact_step=None)

    @property
    def cell_lattice_places(self) -> Floats:
        """Places of the rounded offsets on `cell_lattice`, from 0 on [its steps]."""
        return self.cell_offsets / self.step_cells + self.cell_lattice.half_steps

    @property
    def steps(self) -> Floats:
        """Spacing along x, y and theta, (3,) [m, m, rad]."""
        return np.array([self.step, self.step, self.rotation_step])

    @property
    def offsets(self) -> Floats:
        """Offsets along x, and likewise along y [m]."""
        return np.arange(-self.half_steps, self.half_steps + 1, dtype=np.float64) * self.step

    @property
    def angles(self) -> Floats:
        """Angles of the turns, counter-clockwise [rad]."""
        steps = np.arange(-self.half_rotations, self.half_rotations + 1, dtype=np.float64)
        return steps * self.rotation_step

    @property
    def size(self) -> int:
        """Number of all offsets (dx, dy, theta)."""
        return (2 * self.half_steps + 1) ** 2 * (2 * self.half_rotations + 1)

    @property
    def dimension(self) -> int:
        """Number of dimensions of the poses: 2 without turns, otherwise 3."""
        return 3 if self.half_rotations else 2

    @property
    def uniform_covariance(self) -> Floats:
        """Covariance of a featureless place, where all offsets weigh the same (diagonal)."""
        counts = np.array([2 * self.half_steps + 1] * 2 + [2 * self.half_rotations + 1])
        variances = self.steps**2 * (counts**2 - 1) / 12
        return np.diag(variances[: self.dimension])

    @property
    def quantisation(self) -> Floats:
        """Q, the variance within one step of the lattice (diagonal)."""
        return np.diag(self.steps[: self.dimension] ** 2 / 12)
