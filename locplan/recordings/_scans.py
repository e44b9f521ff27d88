"""Scans as they come from a log, brought into the order of a lidar's beams."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from locplan._util.checks import MAX_RANGE
from locplan.errors import RecordingError
from locplan.robots import MAX_BEAMS, Lidar

FIRST_ROWS = 256
MAX_ROOM = 2**30
"""Greatest size of all ranges together [bytes]; room is made for no more, whatever a log says."""
MIN_ROW_BYTES = 256
"""Least size that a scan counts as: its pose and times take memory, too."""
DIGITS = 4
"""Decimals of angles that were stored in single precision [deg]."""
Limits = tuple[float, float]


def row_bytes(beams: int) -> int:
    """Size that a scan counts as [bytes]."""
    return max(MIN_ROW_BYTES, 4 * beams)


class ScanRows:
    """Scans in one array that grows, each brought to the beams of the first one.

    Beams are kept counter-clockwise. A scan with other angles, as lidars whose motor is not
    regulated have, takes for each beam the nearest of its own, if there is one within a step.
    `expected` is the number of scans, if that is known.
    """

    def __init__(self, range_limits: Limits | None = None, expected: int = 0) -> None:
        self._limits, self._expected = range_limits, expected
        self._rows: NDArray[np.float32] = np.empty((0, 0), np.float32)
        self._count = 0
        self._first, self._step, self._beams = 0.0, 0.0, 0
        self._lidar = Lidar()
        self.resampled = 0

    def __len__(self) -> int:
        """Return the number of scans."""
        return self._count

    def add(
        self,
        first: float,
        step: float,
        ranges: NDArray[np.float32] | Sequence[float],
        least: float,
        greatest: float,
    ) -> None:
        """Take a scan: angle of its first beam, from beam to beam [rad], ranges and limits [m].

        Raises
        ------
        RecordingError
            If it has no beams, or its angles cannot be.
        """
        with np.errstate(over="ignore"):  # beyond single precision lies no lidar's range
            values = np.asarray(ranges, np.float32)
        if not self._count:
            self._begin(first, step, len(values), least, greatest)
        if self._count == (most := MAX_ROOM // row_bytes(self._beams)):
            raise RecordingError(
                f"over {most:,} scans of {self._beams} beams take too much memory; read every n-th"
                " (every=), or a part (window=)"
            )
        if self._count == len(self._rows):
            self._rows.resize((FIRST_ROWS + self._count * 5 // 4, self._beams), refcheck=False)
        if step < 0:
            first, step, values = first + step * (len(values) - 1), -step, values[::-1]
        row = self._rows[self._count]
        off = abs(first - self._first) + abs(step - self._step) * self._beams
        if len(values) >= self._beams and off < self._step / 10:
            row[:] = values[: self._beams]
        else:
            self.resampled += 1
            row[:] = self._resampled(first, step, values)
        row[~self._lidar.has_return(row)] = np.inf
        self._count += 1

    def finish(self, kept: Sequence[int]) -> NDArray[np.float32]:
        """The scans that are kept, in ascending order, (n, beams); nothing can be added after."""
        for to, index in enumerate(kept):
            if to != index:  # in place: a copy would take the memory twice
                self._rows[to] = self._rows[index]
        rows, self._rows = self._rows, np.empty((0, 0), np.float32)
        rows.resize((len(kept), self._beams), refcheck=False)
        self._count = 0
        return rows

    def lidar(self, mount: tuple[float, float, float], upside_down: bool) -> Lidar:
        """The lidar with its pose on the robot [m, m, rad].

        The beams of one that is upside down come clockwise: the rows have to be reversed.
        """
        middle = self._first + self._step * (self._beams - 1) / 2
        yaw = mount[2] + (-middle if upside_down else middle)
        turn = math.degrees((yaw + math.pi) % (2 * math.pi) - math.pi)
        x, y = round(mount[0], 6), round(mount[1], 6)
        return replace(self._lidar, mount_x=x, mount_y=y, mount_yaw_deg=round(turn, DIGITS))

    def _begin(self, first: float, step: float, count: int, least: float, most: float) -> None:
        if not (math.isfinite(first) and math.isfinite(step) and step and 0 < count < MAX_BEAMS):
            raise RecordingError(
                f"its first scan has {count} beams from {first:g} rad on, {step:g} rad apart, which"
                " is no scan"
            )
        if self._limits is not None:
            least, most = self._limits
        elif not 0 < most <= MAX_RANGE:
            raise RecordingError(
                f"its scans name a greatest range of {most:g} m; give the lidar's own as"
                " range_limits=(least, greatest)"
            )
        if step < 0:
            first, step = first + step * (count - 1), -step
        lidar = Lidar.from_scan(
            angle_min=first,
            angle_max=first + step * (count - 1),
            angle_increment=step,
            range_min=min(max(_plain(least), 0.0), 0.999 * most) if math.isfinite(least) else 0.0,
            range_max=_plain(most),
        )
        lidar = replace(lidar, field_of_view_deg=round(lidar.field_of_view_deg, DIGITS))
        self._first, self._step, self._beams, self._lidar = first, step, lidar.beams, lidar
        # Room that is not written yet takes no memory; a damaged file may promise anything.
        room = min(max(self._expected, FIRST_ROWS), max(FIRST_ROWS, MAX_ROOM // 4 // lidar.beams))
        self._rows = np.empty((room, lidar.beams), np.float32)

    def _resampled(
        self, first: float, step: float, values: NDArray[np.float32]
    ) -> NDArray[np.float32]:
        """A scan with other angles, at the beams of the first one; inf where it has none."""
        row = np.full(self._beams, np.inf, np.float32)
        if not (math.isfinite(first) and math.isfinite(step) and step and len(values)):
            return row
        angles = self._first + self._step * np.arange(self._beams)
        turn = 2 * math.pi
        beam = np.rint(((angles - first + step / 2) % turn - step / 2) / step).astype(np.int64)
        seen = (beam >= 0) & (beam < len(values))
        row[seen] = values[beam[seen]]
        return row


def _plain(value: float) -> float:
    """A number without the further digits that single precision gave it."""
    return float(f"{value:.7g}")
