"""The answer that takes long: the simulated choice of the path shown."""

from __future__ import annotations

from typing import TYPE_CHECKING

from locplan.app.explorer.scene import MAX_DRIVES
from locplan.errors import ConfigError
from locplan.planning.path import Path
from locplan.simulation.recommender import choose

SHOWN = "shown path"
"""Name of the candidate that the page shows."""
MAX_POINTS = 5000
"""Maximum number of points of that path."""

if TYPE_CHECKING:
    from locplan.app.explorer.requests import Ask, Work
    from locplan.app.explorer.session import Session


def simulate(session: Session, ask: Ask, work: Work) -> dict[str, object]:
    """Answer the ask for the simulated choice of the way shown by its summary.

    The path that the page shows is a candidate, so that the answer is about it.

    Candidates are driven just as `locplan plan` does with these settings. Of the page's field it
    takes the points that a field for this choice has. Work that is cancelled ends after the drives
    that are under way; the searches before the first drive run out.
    """
    view, drives = session.view(ask), ask.whole("drives", 2, MAX_DRIVES, 64)
    work.progress(0, drives, "planning")
    start, *via, goal = view.stops
    shown = ask.positions("path", MAX_POINTS)
    choice = choose(
        view.grid,
        start,
        goal,
        view.robot,
        costs=view.field.config,
        candidates={SHOWN: Path(shown)} if shown else {},
        compute=view.field_at if view.whole else None,
        via=via,
        drives=drives,
        threads=session.opening.threads,
        progress=work.progress,
        **view.cost_settings,
    )
    if choice.path is None:
        raise ConfigError("no path joins start and goal; move one of them")
    return {**choice.summary(), "driven": choice.driven}
