"""The questions of the page, the functions that answer them, and the lanes for that."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Literal

from locplan.app.explorer import check_reports, edits, plans, sharing, simulations, state
from locplan.app.explorer.requests import Ask, Work
from locplan.app.explorer.session import Session

Lane = Literal["look", "plan", "slow", "edit", "work", "long"]
"""Kinds of work; each has a thread, so that none waits for another kind."""


@dataclass(frozen=True)
class Entry:
    """A kind of questions."""

    handler: Callable[[Session, Ask, Work], Mapping[str, Any]]
    """The function that answers. Its result is fit for JSON; NaN and infinity become null."""
    lane: Lane
    """The lane that answers one question after the other, and never waits for another lane."""
    each: bool = False
    """True if each question is answered; otherwise the newest one waiting wins."""
    is_slow: Callable[[Session, Ask], bool] | None = None
    """True for a question that is answered in the lane "slow"."""

    def answer(self, session: Session, ask: Ask, work: Work) -> dict[str, Any]:
        """The answer to a question."""
        return dict(self.handler(session, ask, work))

    def lane_of(self, session: Session, ask: Ask) -> str:
        """The lane of a question."""
        return "slow" if self.is_slow and self.is_slow(session, ask) else self.lane


QUESTIONS: dict[str, Entry] = {
    "plan": Entry(plans.plan, "plan", is_slow=plans.is_slow),
    "at": Entry(state.at, "look"),
    "idle": Entry(plans.idle, "slow"),
    "configure": Entry(edits.configure, "work"),
    "edit": Entry(edits.edit, "edit", each=True),
    "undo": Entry(edits.step, "edit", each=True),
    "redo": Entry(edits.step, "edit", each=True),
    "save": Entry(edits.save, "edit", each=True),
    "simulate": Entry(simulations.simulate, "long"),
    "checked": Entry(check_reports.checked, "long"),
    "export": Entry(sharing.export, "long"),
    "share": Entry(sharing.share, "long"),
}
"""All kinds of questions by name; "cancel" {of} is answered by the socket itself."""
