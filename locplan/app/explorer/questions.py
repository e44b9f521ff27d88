"""The questions of the page, and the functions that answer them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Literal

from locplan.app.explorer import check_reports, exports, plans, sharing, simulations, sites, state
from locplan.app.explorer.messages import Question, QuestionJob
from locplan.app.explorer.scene import MapScene
from locplan.app.explorer.session import Session

Lane = Literal["look", "plan", "change", "long"]
"""Kinds of work. Each has its thread, so that no kind waits for another."""
Handler = Callable[[Session, MapScene, Question, QuestionJob], Mapping[str, Any]]
"""Function that answers on a scene; NaN and infinity in its answer become null."""


@dataclass(frozen=True)
class QuestionHandler:
    """Handler of one kind of question."""

    handler: Handler
    """The function that answers."""
    lane: Lane
    """Lane that answers the questions one after the other."""
    is_queued: bool = False
    """True answers all questions; otherwise only the newest waiting one."""
    follow_up: Callable[[Session, MapScene, Question, QuestionJob], None] | None = None
    """Function that prepares the next answer until a question of this kind arrives."""

    def answer(self, session: Session, question: Question, job: QuestionJob) -> dict[str, Any]:
        """Return the answer to a question, with digests of the state that it is valid for."""
        scene = session.scene
        basis = {**scene.basis, "route": question.text("route", None)}
        return {"basis": basis, **self.handler(session, scene, question, job)}


def apply_page_changes(
    session: Session, scene: MapScene, question: Question, job: QuestionJob
) -> dict[str, Any]:
    """Apply the page's whole list of changes to the original map, robot and zones."""
    changes = sites.read_changes(question)
    return {"basis": session.apply_changes(changes).basis, "changes": list(changes)}


QUESTIONS: dict[str, QuestionHandler] = {
    "plan": QuestionHandler(plans.plan_route, "plan", follow_up=plans.prepare_searches),
    "at": QuestionHandler(state.describe_place, "look"),
    "change": QuestionHandler(apply_page_changes, "change", is_queued=True),
    "simulate": QuestionHandler(simulations.simulate_route, "long"),
    "report": QuestionHandler(check_reports.describe_report, "long"),
    "export": QuestionHandler(exports.export_masks, "long"),
    "share": QuestionHandler(sharing.share_page, "long"),
}
"""Handlers by kind of question. The socket itself answers "cancel"."""
