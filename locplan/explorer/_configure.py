"""Changing the estimator, the lidar and its range in place."""

from __future__ import annotations

import dataclasses
from concurrent.futures import CancelledError
from typing import TYPE_CHECKING, Any

from locplan._util.checks import MAX_RANGE
from locplan.explorer._session import Session
from locplan.explorer._upkeep import Upkeep
from locplan.explorer._wire import Ask, Cancelled
from locplan.field import ESTIMATORS, FieldConfig, estimator_class
from locplan.robots import PRESETS, Lidar

if TYPE_CHECKING:
    from locplan.explorer._asks import Work

MAX_HEADINGS = 36
"""Greatest number of headings that the page can ask for."""


def config_of(session: Session, ask: Ask) -> FieldConfig:
    """The settings of a field that are asked for; what is not given stays as it is.

    Raises
    ------
    ConfigError
        If a value is unknown or out of its range.
    """
    now = session.config
    name = ask.one_of("estimator", ESTIMATORS, now.estimator.name)
    preset = ask.one_of("lidar", PRESETS)
    reach = ask.number("range", 0.1, MAX_RANGE)
    headings = ask.whole("headings", 0, MAX_HEADINGS, 0) or 0
    lidar = Lidar.preset(preset) if preset else _present_lidar(session, ask)
    kind: Any = estimator_class(name or now.estimator.name)
    same = kind is type(now.estimator)
    if lidar is not None and reach is not None:
        lidar = dataclasses.replace(lidar, range=reach)
    if kind.casts_rays:
        if lidar is None:
            lidar = _assumed(reach)
        estimator = now.estimator.with_lidar(lidar) if same else kind.of(lidar)
    else:
        estimator = now.estimator if same else kind()
        if lidar is not None and (preset or not same or reach is not None):
            estimator = estimator.with_lidar(lidar)
        elif reach is not None:
            estimator = dataclasses.replace(estimator, range=reach)
    return FieldConfig(estimator, stride=now.stride, headings=headings)


def configure(session: Session, ask: Ask, work: Work) -> dict[str, Any]:
    """Compute the field with other settings; the old one stays until it is there."""
    config, before = config_of(session, ask), session.config
    work.cancel.check()
    session.config = config
    try:
        _await_field(session.upkeep, work)
    except BaseException:
        session.config = before
        session.upkeep.begin()
        raise
    return {"ok": True}


def _await_field(upkeep: Upkeep, work: Work) -> None:
    """Begin to compute the field, and wait for it, also where edits begin that anew."""
    upkeep.listener = work.progress
    try:
        task = upkeep.begin()
        while True:
            try:
                return task.result()
            except (Cancelled, CancelledError):
                latest = upkeep.latest
                if work.cancel.cancelled or latest is None or latest is task:
                    raise Cancelled from None
                task = latest  # an edit came in between
    finally:
        upkeep.listener = None


def _present_lidar(session: Session, ask: Ask) -> Lidar | None:
    """The lidar to go on with where none is named; None where null says that there is none."""
    return None if "lidar" in ask.values else session.lidar


def _assumed(reach: float | None) -> Lidar:
    """The lidar of an estimator that needs one where none is named."""
    from locplan.field import SHORT_LIDAR

    lidar = dataclasses.replace(SHORT_LIDAR, model="no lidar named, one assumed")
    return lidar if reach is None else dataclasses.replace(lidar, range=reach)
