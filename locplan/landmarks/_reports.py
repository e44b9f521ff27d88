"""The reports of landmarks and of key features: text for people."""

from __future__ import annotations

import dataclasses

from locplan._util.tables import wrapped
from locplan.landmarks._features import KeyFeatures, in_cm
from locplan.landmarks._landmarks import PAYING_SHARE, Landmarks
from locplan.landmarks._outcomes import FeatureDrives, Verification


def landmarks_report(made: Landmarks, verification: Verification | None = None) -> str:
    """What the drives say, then the landmarks in order of gain, and what was refused."""
    setting = made.setting
    lines = ["not verified: nothing was driven"]
    if verification:
        (before, high), (later, high_after) = verification.match_deviations.tolist()
        lines = [
            verification.verdict,
            f"deviation of a match of one scan alone: median {before:.2f} -> {later:.2f} m,"
            f" 95 % of the way below {high:.2f} -> {high_after:.2f} m",
        ]
    lines.append(f"with {setting.robot.title}")
    after = [
        f"{len(made)} x {setting.kind.title}, in order of gain; {made.measure.heading} without any:"
        f" {made.expected[0]:.3f}"
    ]
    if setting.region is not None:
        area = float(setting.region.sum()) * made.grid.resolution**2
        routes = f"{len(setting.routes)} routes lead across it"
        after.append(f"the robot can be in {area:.0f} m2 of the region, and {routes}")
    after += _driven_beside(made)
    after += _number_that_pays(made, verification)
    if made.existing:
        after.append(f"{made.kept} of {made.existing} existing objects stay where they are")
    after += [f"{shift}" for shift in made.shifts]
    if made.regular:
        after.append(
            f"careful: {made.regular}, which a filter can mistake for a shift; move one of them"
        )
    if made.rejected:
        counts = ", ".join(f"{reason} ({count})" for reason, count in made.reasons().items())
        after.append(f"places refused: {counts}")
    parts = [str(verification.table())] if verification else []
    return "\n".join([*parts, *wrapped(lines), str(made.table()), *wrapped(after)])


def _number_that_pays(made: Landmarks, verification: Verification | None) -> list[str]:
    """From which number on landmarks gain little, if there is one."""
    if made.paying == len(made):
        return []
    if made.paying == 0:
        known = "whether they help is what the drives say" if verification else "drive them to know"
        return [f"each lowers it by less than {PAYING_SHARE:.0%}: {known}"]
    return [
        f"from number {made.paying + 1} on each lowers it by less than {PAYING_SHARE:.0%}:"
        f" {made.paying} may do; drive them to know"
    ]


def _driven_beside(made: Landmarks) -> list[str]:
    """How the places were chosen, and which others were driven beside them."""
    if not made.trials:
        return [f"chosen by: {made.chosen_by}"]
    said = [
        f"{each.chosen_by} ({each.lost} of {each.drives} lost, error {each.error:.2f} m)"
        for each in made.trials
    ]
    return [f"of {len(said)} placements that were driven, this one is kept: {said[0]}"] + [
        f"beaten: {each}" for each in said[1:]
    ]


def features_report(found: KeyFeatures, drives: FeatureDrives | None = None) -> str:
    """The verdicts, then the features with the greatest loss."""
    said = drives.verdict if drives else "not verified: nothing was driven"
    lines = wrapped([found.verdict, said, f"with {found.robot.title}"])
    parts = [str(drives.table()), *lines] if drives else lines
    if not found.features:
        return "\n".join(parts)
    table = found.table()
    # Number of features in the table.
    listed = {*range(1, 11), *found.together}
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
