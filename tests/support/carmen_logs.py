"""Lines of CARMEN logs."""

from __future__ import annotations


def format_flaser(pose, robot=None, stamp=0.0, ranges=(1.0, 2.0, 50.0, 50.0)) -> str:
    places = " ".join(map(str, (*pose, *(robot or pose))))
    return f"FLASER {len(ranges)} {' '.join(map(str, ranges))} {places} {stamp} host {stamp}\n"


def format_odom(pose, stamp=0.0) -> str:
    return f"ODOM {' '.join(map(str, pose))} 0 0 0 {stamp} host {stamp}\n"
