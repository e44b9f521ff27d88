"""Lidars that are known: by their makers' data sheets, and by robots' descriptions.

The presets are plain numbers: no numpy is imported here. Ranges are those for bright targets, as
walls are. Where a maker prints no standard deviation of a range, its bound of the error stands for
it, or 0.03 m where there is none.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from locplan._util.checks import shown
from locplan._util.reading import MAX_BYTES, read_bytes
from locplan.errors import ConfigError

if TYPE_CHECKING:
    from xml.etree.ElementTree import Element


class Preset(NamedTuple):
    """The values of a data sheet."""

    range: float
    """Maximum distance that is measured [m]."""
    min_range: float
    """Minimum distance that is measured [m]."""
    field_of_view_deg: float
    """Angle that the beams cover [deg]."""
    beams: int
    """Number of beams in the field of view, at the usual rate."""
    range_sigma: float
    """Standard deviation of a measured distance [m]."""
    source: str
    """Document that has these values."""


_A1 = Preset(12.0, 0.15, 360.0, 360, 0.03, "Slamtec, RPLIDAR A1M8 data sheet, 2016; no error given")
_LDS_02 = Preset(8.0, 0.16, 360.0, 360, 0.03, "ROBOTIS e-Manual, LDS-02; 3 % of the range at 1 m")

PRESETS: dict[str, Preset] = {
    "rplidar-a1": _A1,
    "rplidar-a2": Preset(
        12.0, 0.2, 360.0, 1600, 0.03, "Slamtec, RPLIDAR A2M12 data sheet LD310, 2022; no error"
    ),
    "rplidar-a3": Preset(
        25.0, 0.2, 360.0, 1600, 0.03, "Slamtec, RPLIDAR A3M1 data sheet v1.3, 2019; no error given"
    ),
    "rplidar-s2": Preset(
        30.0, 0.05, 360.0, 3200, 0.03, "Slamtec, RPLIDAR S2M1-R2 data sheet rev. 2.3, 2024"
    ),
    "rplidar-c1": Preset(
        12.0, 0.05, 360.0, 500, 0.03, "Slamtec, RPLIDAR C1M1 data sheet rev. 1.1, 2024"
    ),
    "ld19": Preset(12.0, 0.02, 360.0, 450, 0.01, "LDROBOT, LD19 data sheet v2.5, 2022"),
    "ydlidar-x4": Preset(
        10.0, 0.12, 360.0, 720, 0.035, "YDLIDAR, X4 data sheet v1.2, 2024; 3.5 % at 1 m"
    ),
    "lds-01": Preset(
        3.5, 0.12, 360.0, 360, 0.035, "ROBOTIS e-Manual, LDS-01; 3.5 % of the range at 1 m"
    ),
    "lds-02": _LDS_02,
    "turtlebot3": _LDS_02,
    "turtlebot4": _A1,
    "tim571": Preset(25.0, 0.05, 270.0, 811, 0.02, "SICK, TiM571 data sheet; driver sick_scan_xd"),
    "lms111": Preset(20.0, 0.5, 270.0, 541, 0.012, "SICK, LMS111 product data, at 50 Hz"),
    "lms291": Preset(80.0, 0.0, 180.0, 361, 0.01, "SICK, LMS291 technical description"),
    "ust-10lx": Preset(10.0, 0.06, 270.0, 1081, 0.03, "Hokuyo, UST-10LX manual MRS-0020D, 2015"),
    "utm-30lx": Preset(
        30.0, 0.1, 270.0, 1081, 0.03, "Hokuyo, UTM-30LX data sheet; 10 mm below 10 m, 30 mm beyond"
    ),
    "urg-04lx": Preset(
        5.6, 0.02, 240.0, 682, 0.03, "Hokuyo, URG-04LX-UG01 data sheet; 30 mm to 1 m, 3 % beyond"
    ),
}
"""The presets by name; robots stand beside lidars, with the lidar that they carry."""


class Sensor(NamedTuple):
    """What a file says of a planar lidar, in the words of `Lidar.from_scan`."""

    angle_min: float
    angle_max: float
    angle_increment: float
    range_min: float
    range_max: float
    mount: tuple[float, float, float]
    range_sigma: float | None
    model: str

    @property
    def beams(self) -> int:
        """The number of beams, those at both ends included."""
        return round((self.angle_max - self.angle_min) / self.angle_increment) + 1


def read_sensor(file: Path) -> Sensor:
    """The only planar lidar that a file describes; see `Lidar.from_file`."""
    if file.suffix.lower() in (".yaml", ".yml"):
        raise ConfigError(
            f"{file}: parameters name no lidar, their ranges only limit one; name a lidar of"
            " locplan.robots.PRESETS, or give the robot's URDF or SDF"
        )
    kinds = ("ray", "gpu_ray", "lidar", "gpu_lidar")  # in the words of all versions of Gazebo
    sensors = [each for each in _root(file).iter("sensor") if each.get("type") in kinds]
    planar = [each for each in sensors if _number(each, ".//vertical/samples", 1.0, file) <= 1]
    if len(planar) != 1:
        names = ", ".join(shown(each.get("name")) for each in planar[:5])
        what = f"has {len(planar)} planar lidars ({names})" if planar else "has no planar lidar"
        raise ConfigError(f"{file}: {what}; leave one sensor of type ray or lidar in the file")
    return _described(planar[0], file)


def _described(sensor: Element, file: Path) -> Sensor:
    first = _number(sensor, ".//horizontal/min_angle", None, file)
    last = _number(sensor, ".//horizontal/max_angle", None, file)
    samples = _number(sensor, ".//horizontal/samples", None, file)
    beams = int(samples * _number(sensor, ".//horizontal/resolution", 1.0, file))
    if beams < 2:
        raise ConfigError(f"{file}: its lidar has {beams} beams; there must be 2 at least")
    x, y, _, roll, pitch, yaw = _pose(sensor, file)
    if max(abs(math.sin(roll)), abs(math.sin(pitch))) > 0.1 or math.cos(pitch) < 0:
        raise ConfigError(f"{file}: its lidar is tilted; locplan knows horizontal ones only")
    if math.cos(roll) < 0:  # it is mounted upside down
        first, last = -last, -first
    noise = sensor.find(".//noise")
    kind = "" if noise is None else noise.get("type") or noise.findtext("type") or ""
    gaussian = kind.strip().startswith("gaussian")
    sigma = _number(sensor, ".//noise/stddev", 0.0, file) if gaussian else 0.0
    return Sensor(
        angle_min=first,
        angle_max=last,
        angle_increment=(last - first) / (beams - 1),
        range_min=_number(sensor, ".//range/min", 0.0, file),
        range_max=_number(sensor, ".//range/max", None, file),
        mount=(x, y, yaw),
        range_sigma=sigma or None,
        model=sensor.get("name") or "",
    )


def _root(file: Path) -> Element:
    from xml.etree import ElementTree

    try:
        content = read_bytes(file, MAX_BYTES)
    except OSError as error:
        raise ConfigError(f"{file}: cannot be read ({error.strerror or error})") from None
    if b"<!ENTITY" in content:
        raise ConfigError(f"{file}: is no robot's description; name a URDF or SDF file")
    try:
        return ElementTree.fromstring(content)
    except (ElementTree.ParseError, ValueError, LookupError):
        raise ConfigError(f"{file}: is no XML; name a URDF or SDF file, not a .xacro") from None


def _pose(sensor: Element, file: Path) -> tuple[float, ...]:
    text = sensor.findtext("pose") or "0 0 0 0 0 0"
    try:
        values = tuple(map(float, text.split()))
    except ValueError:
        values = ()
    if len(values) != 6 or not all(map(math.isfinite, values)):
        raise ConfigError(f"{file}: the lidar's pose must be six numbers, not {shown(text)}")
    pose = sensor.find("pose")
    if pose is not None and pose.get("degrees") in ("true", "1"):
        return (*values[:3], *map(math.radians, values[3:]))
    return values


def _number(sensor: Element, where: str, default: float | None, file: Path) -> float:
    text = sensor.findtext(where)
    name = where.removeprefix(".//")
    if text is None and default is None:
        raise ConfigError(f"{file}: its lidar has no {name}")
    try:
        value = float(text) if text is not None else float(default or 0.0)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise ConfigError(
            f"{file}: {name} must be a number, not {shown(text)}; run xacro on a .xacro file first"
        )
    return value
