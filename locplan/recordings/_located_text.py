"""Sentences about the scans of a drive that were located, and the limits in them."""

from __future__ import annotations

import numpy as np

from locplan._kernels.arrays import Bools

CERTAIN = 3.0
"""Excess of the second place from which on the best one is certain [nats]."""
NEAR, TURNED = 0.3, float(np.radians(3.0))
"""Distance [m] and angle [rad] from the recorded pose up to which a scan is located rightly."""
AGREE = 0.5
"""Share of the certain scans that are right, or of all that fit, below which the recorded poses
seem to be of another map."""


def drive_sentence(certain: Bools, fits: Bools, right: Bools | None) -> str:
    """Return how many scans are located, and whether the certain ones are right.

    The masks are those of `LocatedDrive`; without recorded poses no scan is known to be right.
    """
    count = len(certain)
    limits = f"{NEAR:g} m and {np.degrees(TURNED):.0f}°"
    alone = f"have no second place within {CERTAIN:g} nats"
    if right is not None:
        text = (
            f"{int(right.sum())} of {count} scans are located within {limits} of the recorded pose."
            f" {int(certain.sum())} {alone}, and {int((right & certain).sum())} of these are right."
        )
        if certain.any() and right[certain].mean() < AGREE:
            return text + (
                " The recorded poses hardly agree with the map: check that they are in its frame,"
                " and how the lidar is mounted."
            )
    else:
        text = f"{int(certain.sum())} of {count} scans {alone}. The drive has no poses on the map."
    if fits.mean() < AGREE:
        text += (
            f" Careful: only {int(fits.sum())} of {count} scans have most of their returns at"
            " walls: people, changes, or the map of another place."
        )
    return text
