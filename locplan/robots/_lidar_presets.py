"""Common 2D lidars by their makers' data sheets, as plain numbers: no numpy is imported here.

Ranges are those for bright targets, as walls are. Where a maker prints no standard deviation of a
range, its bound of the error stands for it, or 0.03 m where there is none.
"""

from __future__ import annotations

from typing import NamedTuple


class Preset(NamedTuple):
    """The values of a data sheet."""

    range: float
    """Greatest distance that is measured [m]."""
    least_range: float
    """Least distance that is measured [m]."""
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
        10.0,
        0.12,
        360.0,
        720,
        0.035,
        "YDLIDAR, X4 data sheet v1.2, 2024; 3.5 % at 1 m",
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
