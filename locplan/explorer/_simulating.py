"""The simulated choice for the way shown: which path keeps the robot from getting lost."""

from __future__ import annotations

from typing import TYPE_CHECKING

from locplan._util.progress import ProgressCallback
from locplan._util.tables import finite
from locplan.errors import ConfigError
from locplan.explorer._view import MAX_DRIVES, View, rounded
from locplan.simulation import Candidate, Choice, choose

if TYPE_CHECKING:
    from locplan.explorer._asks import Work
    from locplan.explorer._session import Session
    from locplan.explorer._wire import Ask


def simulated(
    view: View,
    *,
    drives: int = 64,
    seed: int = 1,
    threads: int | None = None,
    progress: ProgressCallback | None = None,
) -> Choice:
    """Choose among candidates that are driven, just as `locplan plan` does with these settings.

    Of the page's field it takes the points that a field for this choice has. Work that is cancelled
    ends after the drives that are under way; the searches before the first drive run out.

    Parameters
    ----------
    view : View
        The way.
    drives : int
        Greatest number of confirming drives.
    seed : int
        Seed of all random numbers.
    threads : int, optional
        Number of threads; all cores by default.
    progress : callable, optional
        Called with (done, total) drives; what it raises ends the work.

    Raises
    ------
    LocplanError
        If a setting is out of its range, or no path leads to the goal.
    """
    found = choose(
        view.grid,
        view.start,
        view.goal,
        view.robot,
        costs=view.field.config,
        compute=view.field_at if view.whole else None,
        via=view.via,
        drives=drives,
        seed=seed,
        threads=threads,
        progress=progress,
        **view.cost_settings,
    )
    if found.path is None:
        raise ConfigError("no path joins start and goal; move one of them")
    return found


def simulate(session: Session, ask: Ask, work: Work) -> dict[str, object]:
    """Answer the ask for the simulated choice of the way shown."""
    view = session.view(ask)
    drives = ask.whole("drives", 2, MAX_DRIVES, 64)
    work.progress(0, drives, "planning")
    threads = session.opening.threads
    return answer_of(simulated(view, drives=drives, threads=threads, progress=work.progress))


def answer_of(choice: Choice) -> dict[str, object]:
    """A choice for the page, in its own words and figures, fit for JSON."""
    about: dict[str, object] = {
        "verdict": " ".join([f"{choice.sentence}.", *choice.advice, f"({choice.driven})"]),
        "chosen": choice.chosen.name if choice.chosen else None,
        "candidates": [_candidate(each) for each in choice.candidates],
        "drives": choice.settings.drives,
    }
    return finite(about)


def _candidate(each: Candidate) -> dict[str, object]:
    """A candidate with its figures and the error along it."""
    assert each.driven is not None, "the page drives all candidates"
    distance, median, _, high = each.driven.profile.T
    return {
        "name": each.name,
        "label": each.name,
        "xy": rounded(each.path.xy),
        "length": each.path.length,
        "error_m": list(each.driven.error),
        "ratio": list(each.driven.ratio),
        "lost": list(each.driven.lost_rate),
        "profile": {
            "s": distance.round(2).tolist(),
            "median_cm": (100 * median).round(2).tolist(),
            "p90_cm": (100 * high).round(2).tolist(),
        },
    }
