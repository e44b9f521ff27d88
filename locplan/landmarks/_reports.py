"""The report of landmarks: text for people."""

from __future__ import annotations

from locplan._util.tables import wrapped
from locplan.landmarks._landmarks import PAYING_SHARE, Landmarks
from locplan.landmarks._verification import Verification


def landmarks_report(made: Landmarks, verification: Verification | None = None) -> str:
    """What the drives say, then the landmarks in order of gain, and what was refused."""
    setting = made.setting
    lines = ["not verified: nothing was driven"]
    if verification:
        (before, high), (later, high_after) = verification.match_deviations.tolist()
        lines = [
            verification.verdict,
            f"deviation of single matches on the way (scan): median {before:.2f} -> {later:.2f} m,"
            f" 95 % below {high:.2f} -> {high_after:.2f} m",
        ]
    lines.append(f"with {setting.robot.title}")
    after = [
        f"{len(made)} x {setting.kind.title}, in order of gain; {made.measure.title} without any:"
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
        counts = ", ".join(f"{count} {reason}" for reason, count in made.reasons().items())
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
