"""What a recorded drive holds, before it is checked, and where it comes from."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

from numpy.typing import NDArray

from locplan._util.checks import Settings
from locplan.robots import Lidar

MAX_ARRAY_BYTES = 2**28
"""Greatest size of a file's arrays together, unpacked; reading takes some six times as much."""


@dataclass(frozen=True, kw_only=True, repr=False)
class Source(Settings):
    """Where a recording comes from: its file, and the topics and frames that were used."""

    file: str = ""
    """Name of the file or folder, without its path."""
    scans: str = ""
    """Topic of the scans, or the kind of lines."""
    poses: str = ""
    """Topic of the poses, or the frames that TF relates."""
    odometry: str = ""
    """Topic of the odometry, or the frames that TF relates; empty if there is none."""
    map_frame: str = ""
    """Frame that the poses are in."""
    base_frame: str = ""
    """Frame of the robot, whose poses these are."""
    lidar_frame: str = ""
    """Frame of the lidar."""
    notes: tuple[str, ...] = ()
    """What was assumed or left out, in sentences without a full stop."""


class Contents(NamedTuple):
    """The fields of a `Recording`."""

    ranges: NDArray[Any]
    lidar: Lidar
    poses: NDArray[Any]
    times: NDArray[Any] | None
    odometry: NDArray[Any] | None
    source: Source
