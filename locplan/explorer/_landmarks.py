"""Landmarks for the way shown: where poles or boxes would keep the robot from getting lost."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from locplan._util.checks import shown, whole
from locplan._util.progress import ProgressCallback
from locplan._util.tables import finite
from locplan.errors import ConfigError
from locplan.explorer._view import MOST_DRIVES, View, given
from locplan.landmarks import (
    PAYING_SHARE,
    Box,
    Landmarks,
    Verification,
    parsed_object,
    place_landmarks,
)

if TYPE_CHECKING:
    from locplan.explorer._asks import Work
    from locplan.explorer._session import Session
    from locplan.explorer._wire import Ask

MOST = 20
"""Greatest number of landmarks that the page can ask for."""
FEW_DRIVES = 16
"""Number of drives before and after by default; `locplan landmarks` makes 100."""
LONGEST_TEXT = 40
"""Greatest length of an object's text [characters]."""


@dataclass(frozen=True, eq=False)
class ProposedLandmarks:
    """Places for landmarks along the way shown."""

    made: Landmarks
    verification: Verification | None
    """Simulated drives without the landmarks and with them; None if none were asked for."""

    @property
    def verdict(self) -> str:
        """What the drives say, or that there were none, in one line."""
        if self.verification is None:
            return "not verified: nothing was driven"
        drives = self.verification.before.number
        return f"{self.verification.verdict} ({drives} drives each; 100 tell more)"

    @property
    def warnings(self) -> list[str]:
        """What is doubtful about the placement, a sentence each."""
        made, texts = self.made, []
        if made.paying < len(made):
            texts.append(
                f"From number {made.paying + 1} on, each lowers the expected deviation by less"
                f" than {PAYING_SHARE:.0%}."
            )
        if made.regular:
            texts.append(f"Careful: {made.regular}, which a filter can mistake for a shift.")
        return texts

    def summary(self) -> dict[str, object]:
        """Places, what each gains, and the verdict, fit for JSON."""
        kind, curve = self.made.setting.kind, 100 * self.made.expected
        box = isinstance(kind, Box)
        about: dict[str, object] = {
            "poses": self.made.poses.tolist(),
            "tool": "box" if box else "pole",
            "size": [kind.length, kind.width] if isinstance(kind, Box) else [kind.diameter],
            "curve": curve.tolist(),
            "gains": (curve[:-1] - curve[1:]).tolist(),
            "paying": self.made.paying,
            "verdict": self.verdict,
            "helps": None if self.verification is None else self.verification.helps,
            "warnings": self.warnings,
        }
        return finite(about)


def landmarks_of(
    view: View,
    *,
    object: str = "pole:0.2",
    count: int = 3,
    drives: int = FEW_DRIVES,
    seed: int = 1,
    threads: int | None = None,
    progress: ProgressCallback | None = None,
) -> ProposedLandmarks:
    """Choose places for landmarks along the aware path of a view, and verify them by drives.

    Parameters
    ----------
    view : View
        The way.
    object : str
        The object, such as pole:0.2 or box:0.6,0.3 [m].
    count : int
        Greatest number of objects, 1 to 20.
    drives : int
        Number of drives before and after, 2 to 100; 0 leaves the verification out.
    seed : int
        Seed of all random numbers.
    threads : int, optional
        Number of threads; all cores by default.
    progress : callable, optional
        Called with (done, total) steps of the search, then with those of the drives; what it raises
        ends the work. What the lidar sees along the way is computed before the first step, and runs
        out.

    Raises
    ------
    LocplanError
        If an argument is out of its range, no path joins the ends, or no object may stand anywhere.
    """
    if not isinstance(object, str) or len(object) > LONGEST_TEXT:
        raise ConfigError(f"the object must be a text such as pole:0.2, not {shown(object)}")
    kind = parsed_object(object)
    whole("count", count, 1, MOST)
    if drives != 0:
        whole("drives", drives, 2, MOST_DRIVES)
    aware, _ = view.paths()
    told = progress or (lambda done, total: None)
    told(0, count)
    made = place_landmarks(
        view.grid,
        kind,
        count,
        paths={"shown": aware},
        robot=view.robot,
        threads=threads,
        progress=told,
    )
    verification = None
    if drives and len(made):
        verification = made.verify(drives, seed=seed, random_sets=1, threads=threads, progress=told)
    return ProposedLandmarks(made, verification)


def landmarks(session: Session, ask: Ask, work: Work) -> dict[str, object]:
    """Answer the ask for landmarks along the way shown."""
    view = session.view(ask)
    drives = given(ask.whole("drives", 0, MOST_DRIVES), FEW_DRIVES)
    count = given(ask.whole("count", 1, MOST), 3)
    object = given(ask.text("object"), "pole:0.2")
    work.progress(0, count, "planning")
    made = landmarks_of(view, object=object, count=count, drives=drives, progress=work.progress)
    return made.summary()
