# Copyright 2026 locplan developers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""
The covariance field of a map, read from a file with numpy alone.

ROS's messages are compiled for one major version of numpy, and Humble has Python 3.10. The node
therefore needs only numpy, and runs where locplan cannot be installed.
"""

from __future__ import annotations

from dataclasses import dataclass
import json
import math
from zipfile import BadZipFile

import numpy as np

VERSION = 1
"""Newest version of locplan's field files that this package reads."""
FREE = 254
"""Level of free cells in a file's "cells"."""
MAX_BYTES = 2**32
"""Maximum size of a file's arrays together, unpacked."""
MIN_VARIANCE = 1e-12
"""Variance that is added before covariances are inverted [m^2, rad^2], as locplan does."""


@dataclass(frozen=True, eq=False)
class FieldFile:
    """Covariances of a pose match over a map, in the map's world frame."""

    covariance: np.ndarray
    """Covariances of (x, y, theta), or (x, y), on the lattice: (h, w, d, d), or (h, w, n, d, d)
    for n headings [m, m, rad]; NaN if there is no value."""
    u: np.ndarray
    """Degeneracy of the map's cells, 0..1, (H, W); NaN if there is no value."""
    free: np.ndarray
    """Mask of the free cells, (H, W)."""
    resolution: float
    """Edge of a cell [m]."""
    origin: tuple[float, float, float]
    """World position of the corner of cell (0, 0) [m], and the yaw of the map [rad]."""
    stride: int
    """Spacing of the lattice [cells]."""

    @classmethod
    def load(cls, path: str) -> FieldFile:
        """
        Read a file that ``locplan field MAP.yaml -o FIELD.npz`` wrote.

        Raise a ValueError if it is no such file.
        """
        try:
            with np.load(path, allow_pickle=False) as arrays:
                if sum(entry.file_size for entry in arrays.zip.infolist()) > MAX_BYTES:
                    raise ValueError(f'its arrays take over {MAX_BYTES / 1e9:.1f} GB')
                names = ('covariance', 'u_map', 'cells', 'about')
                covariance, u, cells, text = (arrays[name] for name in names)
            about = json.loads(str(text))
            version = int(about['version'])
            x, y, yaw = (float(value) for value in about['origin'])
            resolution = float(about['resolution'])
            stride = max(1, round(float(about['config']['stride']) / resolution))
        except (AttributeError, OSError, ValueError, KeyError, TypeError, BadZipFile) as error:
            raise ValueError(
                f'{path!r} is no field: {error}; write one by locplan field MAP.yaml -o field.npz'
            ) from error
        if version > VERSION:
            raise ValueError(
                f'{path!r} is of a newer locplan (version {version} of a field, this node reads '
                f'{VERSION}); update locplan_ros'
            )
        return cls(covariance, u, cells == FREE, resolution, (x, y, yaw), stride)

    def at(self, x: float, y: float, heading: float | None = None) -> tuple[float, np.ndarray]:
        """
        Return u and the covariance (d, d) at a world position [m].

        The covariance is interpolated in the matrix logarithm. If the field has several headings,
        it is that of `heading` [rad]. Both are NaN in cells that are not free, and off the map.
        """
        cell = self._find_free_cell(x, y)
        if not cell:
            return math.nan, np.full(self.covariance.shape[-2:], np.nan)
        return float(self.u[cell]), self._interpolate(x, y, heading)

    def _interpolate(self, x: float, y: float, heading: float | None) -> np.ndarray:
        row, col = self._world_to_grid(x, y)
        neighbours = [
            (self.covariance[i, j], a * b)
            for i, a in self._list_neighbours(row, 0)
            for j, b in self._list_neighbours(col, 1)
            if a * b > 0 and np.isfinite(self.covariance[i, j]).all()
        ]
        if not neighbours:
            return np.full(self.covariance.shape[-2:], np.nan)
        covariances = [_select_heading(covariance, heading) for covariance, _ in neighbours]
        weights = np.array([weight for _, weight in neighbours])
        return _compute_mean(np.array(covariances), weights)

    def positions(self, spacing: float) -> np.ndarray:
        """Return world positions of free lattice points about `spacing` apart [m], (n, 2)."""
        step = max(1, round(spacing / (self.stride * self.resolution)))
        known = np.isfinite(self.covariance).reshape(*self.covariance.shape[:2], -1).all(axis=2)
        known &= self.free[:: self.stride, :: self.stride]
        chosen = np.zeros_like(known)
        chosen[::step, ::step] = known[::step, ::step]
        rows, cols = (index * self.stride + 0.5 for index in np.nonzero(chosen))
        x0, y0, yaw = self.origin
        along, up = cols * self.resolution, rows * self.resolution
        x = x0 + math.cos(yaw) * along - math.sin(yaw) * up
        y = y0 + math.sin(yaw) * along + math.cos(yaw) * up
        return np.stack([x, y], axis=1)

    def _world_to_grid(self, x: float, y: float) -> tuple[float, float]:
        """Return the continuous row and column of a world position."""
        x0, y0, yaw = self.origin
        dx, dy = x - x0, y - y0
        up = math.cos(yaw) * dy - math.sin(yaw) * dx
        along = math.cos(yaw) * dx + math.sin(yaw) * dy
        return up / self.resolution, along / self.resolution

    def _find_free_cell(self, x: float, y: float) -> tuple[int, int] | None:
        """Return row and column of the cell at a world position; None if it is not free."""
        if not (math.isfinite(x) and math.isfinite(y)):
            return None
        row, col = (math.floor(value) for value in self._world_to_grid(x, y))
        inside = 0 <= row < self.free.shape[0] and 0 <= col < self.free.shape[1]
        return (row, col) if inside and self.free[row, col] else None

    def _list_neighbours(self, position: float, axis: int) -> list[tuple[int, float]]:
        """Return the lattice indices on either side of a row or column, with their weights."""
        last = self.covariance.shape[axis] - 1
        position = min(max((position - 0.5) / self.stride, 0.0), float(last))
        low = math.floor(position)
        part = position - low
        return [(low, 1.0 - part), (min(low + 1, last), part)]


def _select_heading(covariance: np.ndarray, heading: float | None) -> np.ndarray:
    """Return a lattice point's covariance for a heading [rad], or for the mean information."""
    if covariance.ndim == 2:
        return covariance
    if heading is None:
        extended = covariance + MIN_VARIANCE * np.eye(covariance.shape[-1])
        return np.linalg.inv(np.linalg.inv(extended).mean(axis=0))
    position = heading / (2 * math.pi) * len(covariance)
    low, part = math.floor(position), position % 1
    neighbours = covariance[[low % len(covariance), (low + 1) % len(covariance)]]
    return _compute_mean(neighbours, np.array([1 - part, part]))


def _compute_mean(covariances: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Return the weighted mean of covariances (n, d, d) in the matrix logarithm."""
    values, vectors = np.linalg.eigh(covariances)
    logs = np.log(np.maximum(values, np.finfo(float).tiny))
    parts = (vectors * logs[:, None, :]) @ np.swapaxes(vectors, 1, 2)
    values, vectors = np.linalg.eigh(np.einsum('n,nij->ij', weights / weights.sum(), parts))
    return (vectors * np.exp(values)) @ vectors.T
