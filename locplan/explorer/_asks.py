"""What the page can ask for. A new question is a module with its answer, and a line here."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib import import_module
from typing import TYPE_CHECKING, Any, Literal

from locplan._util.tables import finite
from locplan.explorer._wire import Ask, Cancel

if TYPE_CHECKING:
    from locplan.explorer._session import Session


@dataclass(frozen=True)
class Work:
    """Progress and end of an answer that takes long."""

    progress: Callable[..., None]
    """Function of (done, total) or (done, total, doing) that shows it on the page; it raises
    `Cancelled` once the question was taken back."""
    cancel: Cancel
    """The token that says so."""


Handler = Callable[["Session", Ask, Work], dict[str, Any]]
"""Function that answers a question; what it returns is fit for JSON."""


@dataclass(frozen=True)
class Entry:
    """A kind of questions."""

    handler: str
    """Module and function of the answer; imported when it is first asked for."""
    lane: Literal["look", "plan", "slow", "edit", "work", "long", "drive"]
    """The lane that answers one question after the other, and never waits for another lane."""
    each: bool = False
    """True if each question is answered; otherwise the newest one waiting wins."""
    slow: str = ""
    """Module and function that say whether a question is to be answered in a lane of its own."""

    def load(self) -> Handler:
        """The function that answers."""
        found: Handler = _function(self.handler)
        return found

    def lane_of(self, session: Session, ask: Ask) -> str:
        """The lane of a question."""
        return "slow" if self.slow and _function(self.slow)(session, ask) else self.lane


def _function(name: str) -> Any:
    """The function of a name such as module:function."""
    module, _, name = name.partition(":")
    return getattr(import_module(module), name)


ASKS: dict[str, Entry] = {
    "plan": Entry("locplan.explorer._plans:plan", "plan", slow="locplan.explorer._plans:is_slow"),
    "at": Entry("locplan.explorer._points:at", "look"),
    "idle": Entry("locplan.explorer._plans:idle", "slow"),
    "configure": Entry("locplan.explorer._configure:configure", "work"),
    "edit": Entry("locplan.explorer._edits:edit", "edit", each=True),
    "undo": Entry("locplan.explorer._edits:undo", "edit", each=True),
    "redo": Entry("locplan.explorer._edits:redo", "edit", each=True),
    "save": Entry("locplan.explorer._edits:save", "edit", each=True),
    "front": Entry("locplan.explorer._front:front", "long"),
    "simulate": Entry("locplan.explorer._simulating:simulate", "long"),
    "landmarks": Entry("locplan.explorer._landmarks:landmarks", "long"),
    "twins": Entry("locplan.explorer._twins:twins", "long"),
    "twins_everywhere": Entry("locplan.explorer._twins:twins_everywhere", "long"),
    "export": Entry("locplan.explorer._exporting:export", "long"),
    "match": Entry("locplan.explorer._drives:match", "drive"),
    "share": Entry("locplan.explorer._sharing:share", "long"),
    "reproduce": Entry("locplan.explorer._reproduce:reproduce", "look"),
}
"""All kinds of questions by name; "cancel" {of} is answered by the socket itself."""


def answer(
    session: Session,
    do: str,
    values: Mapping[str, Any],
    progress: Callable[..., None] = lambda *_: None,
) -> dict[str, Any]:
    """The answer to a question, fit for JSON; what `progress` raises ends the work."""
    found = ASKS[do].load()(session, Ask(do, 0, values), Work(progress, Cancel()))
    return finite(found)
