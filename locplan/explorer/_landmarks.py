"""Landmarks for the way shown: where poles or boxes would keep the robot from getting lost."""

from __future__ import annotations

from typing import TYPE_CHECKING

from locplan._util.checks import whole
from locplan.explorer._view import MAX_DRIVES
from locplan.landmarks import PAYING_SHARE, Landmarks, parsed_object, place_landmarks

if TYPE_CHECKING:
    from locplan.explorer._asks import Work
    from locplan.explorer._session import Session
    from locplan.explorer._wire import Ask

MAX_LANDMARKS = 20
"""Greatest number of landmarks that the page can ask for."""
FEW_DRIVES = 16
"""Number of drives before and after by default; `locplan landmarks` makes 100."""


def landmarks(session: Session, ask: Ask, work: Work) -> dict[str, object]:
    """Answer the ask for landmarks along the way shown, verified by drives before and after.

    It is the summary of `Landmarks`, with the verdict and what is doubtful in words. What the lidar
    sees along the way is computed before the first step, and runs out where the work is cancelled.
    """
    view = session.view(ask)
    kind = parsed_object(ask.text("object", "pole:0.2"))
    count = ask.whole("count", 1, MAX_LANDMARKS, 3)
    drives = ask.whole("drives", 0, MAX_DRIVES, FEW_DRIVES)
    if drives:
        whole("drives", drives, 2)
    work.progress(0, count, "planning")
    aware, _ = view.paths()
    threads = session.opening.threads
    made = place_landmarks(
        view.grid,
        kind,
        count,
        paths={"shown": aware},
        robot=view.robot,
        threads=threads,
        progress=work.progress,
    )
    found = None
    if drives and len(made):
        found = made.verify(drives, random_sets=1, threads=threads, progress=work.progress)
    verdict = "not verified: nothing was driven"
    if found is not None:
        verdict = f"{found.verdict} ({found.before.number} drives each; 100 tell more)"
    return {**made.summary(found), "verdict": verdict, "warnings": _warnings(made)}


def _warnings(made: Landmarks) -> list[str]:
    """What is doubtful about a placement, a sentence each."""
    texts = []
    if made.paying < len(made):
        texts.append(
            f"From number {made.paying + 1} on, each lowers the expected deviation by less"
            f" than {PAYING_SHARE:.0%}."
        )
    if made.regular:
        texts.append(f"Careful: {made.regular}, which a filter can mistake for a shift.")
    return texts
