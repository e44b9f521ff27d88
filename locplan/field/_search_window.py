"""The search window: the lattice of pose offsets (dx, dy, theta) that are compared at a cell."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from locplan.errors import ConfigError
from locplan.field._config import FieldConfig


@dataclass(frozen=True)
class SearchWindow:
    """Offsets in x and y of ``-half_steps..half_steps`` steps, and the headings compared.

    Along x and y the lattice has ``2 * half_steps + 1`` offsets of ``step_cells`` whole cells.
    With a single heading the poses have two dimensions (x, y), otherwise three (x, y, theta).
    """

    resolution: float
    """Edge of a cell [m]."""
    step_cells: int
    """Spacing of the offsets [cells]."""
    half_steps: int
    """Number of offsets on either side of zero."""
    rotation_step: float
    """Spacing of the headings [rad]."""
    half_rotations: int
    """Number of headings on either side of zero."""

    @classmethod
    def from_config(cls, config: FieldConfig, resolution: float) -> SearchWindow:
        """Round the configured window to whole cells of `resolution` metres.

        Raises
        ------
        ConfigError
            If cells are so large that the window has no offset but zero.
        """
        step_cells = max(1, round(config.step / resolution))
        half_steps = round(config.window / (step_cells * resolution))
        if half_steps < 1:
            raise ConfigError(
                f"cells of {resolution:g} m do not resolve a search window of"
                f" +-{config.window:g} m; set a larger window"
            )
        return cls(
            resolution=resolution,
            step_cells=step_cells,
            half_steps=half_steps,
            rotation_step=math.radians(config.rotation_step_deg),
            half_rotations=math.floor(config.rotation_window_deg / config.rotation_step_deg + 1e-9),
        )

    @property
    def step(self) -> float:
        """Spacing of the offsets [m]."""
        return self.step_cells * self.resolution

    @property
    def offsets(self) -> NDArray[np.float64]:
        """The offsets along x, and along y [m]."""
        return np.arange(-self.half_steps, self.half_steps + 1, dtype=np.float64) * self.step

    @property
    def angles(self) -> NDArray[np.float64]:
        """The headings compared, counter-clockwise [rad]."""
        steps = np.arange(-self.half_rotations, self.half_rotations + 1, dtype=np.float64)
        return steps * self.rotation_step

    @property
    def dimension(self) -> int:
        """Of the poses: 2 without rotation, else 3."""
        return 3 if self.half_rotations else 2

    @property
    def uniform_covariance(self) -> NDArray[np.float64]:
        """Covariance of a featureless place, where all offsets weigh the same (diagonal)."""
        counts = np.array([2 * self.half_steps + 1] * 2 + [2 * self.half_rotations + 1])
        steps = np.array([self.step, self.step, self.rotation_step])
        variances = steps**2 * (counts**2 - 1) / 12
        return np.diag(variances[: self.dimension])

    @property
    def quantisation(self) -> NDArray[np.float64]:
        """Q, the variance within one step of the lattice (diagonal)."""
        steps = np.array([self.step, self.step, self.rotation_step])
        return np.diag(steps[: self.dimension] ** 2 / 12)
