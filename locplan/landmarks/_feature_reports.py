"""The report of key features: text for people."""

from __future__ import annotations

import dataclasses

from locplan._util.tables import wrapped
from locplan.landmarks._feature_drives import FeatureDrives
from locplan.landmarks._features import KeyFeatures, in_cm

LISTED = 10
"""Number of features in the table."""


def features_report(found: KeyFeatures, drives: FeatureDrives | None = None) -> str:
    """The verdicts, then the features with the greatest loss."""
    said = drives.verdict if drives else "not verified: nothing was driven"
    lines = wrapped([found.verdict, said, f"with {found.robot.title}"])
    parts = [str(drives.table()), *lines] if drives else lines
    if not found.features:
        return "\n".join(parts)
    table = found.table()
    listed = {*range(1, LISTED + 1), *found.together}
    rows = (row for n, row in enumerate(table.rows, 1) if n in listed)
    shown = dataclasses.replace(table, rows=tuple(rows))
    after = [
        f"rise: of the expected deviation of the position, {in_cm(float(found.deviations[0]))}"
        " with all, as the feature goes; worst: at the place where it rises most",
        f"moved: error of the position if the feature is {100 * found.shift:.0f} cm off and the"
        " map does not show it, to first order",
    ]
    if len(found) > len(shown):
        after.append(f"{len(found)} features are seen; features.csv lists all of them")
    if len(found.together) > 1:
        steps = ", ".join(
            f"{number}: {in_cm(each)}"
            for number, each in zip(found.together, found.deviations[1:].tolist(), strict=True)
        )
        after.append(f"expected deviation as they go one after the other: without {steps}")
    return "\n".join([*parts, str(shown), *wrapped(after)])
