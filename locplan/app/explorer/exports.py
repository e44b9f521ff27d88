"""The export for Nav2 that the page writes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from locplan.app.explorer.scene import Scene
from locplan.errors import ConfigError

if TYPE_CHECKING:
    from locplan.app.explorer.messages import Job, Question
    from locplan.app.explorer.session import Session


def export(session: Session, scene: Scene, question: Question, job: Job) -> dict[str, Any]:
    """Write the masks, the parameters, the zones and an edited map into one folder."""
    raise ConfigError("the export is not there yet")
