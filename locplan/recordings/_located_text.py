"""Sentences about the scans of a drive that were located, and the limits in them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from locplan.recordings._location import LocatedDrive

CERTAIN = 3.0
"""Excess of the second place from which on the best one is certain [nats]."""
NEAR, TURNED = 0.3, float(np.radians(3.0))
"""Distance [m] and angle [rad] from the recorded pose up to which a scan is located rightly."""
AGREE = 0.5
"""Share of the certain scans that are right, or of all that fit, below which the recorded poses
seem to be of another map."""


def drive_sentence(drive: LocatedDrive) -> str:
    """Return how many scans are located, and whether the certain ones are right."""
    count, right, certain, fits = len(drive), drive.right, drive.certain, drive.fits
    limits = f"{NEAR:g} m and {np.degrees(TURNED):.0f}°"
    alone = f"have no second place within {CERTAIN:g} nats"
    if drive.recording.has_poses:
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
