"""OMPL's planners and their settings, by name."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

from locplan._util.checks import number, shown
from locplan.errors import ConfigError
from locplan.planners.ompl._bindings import base, geometric

REWIRE_FACTOR = 0.25
"""Rewire factor of RRTstar and its variants: fewer neighbours, more iterations, a better J."""
SAMPLES_PER_BATCH = 1000
"""Batch of BITstar in "R2": larger ones than its own 100 give a better J on large maps."""
_NO_PLAIN_VALUE = (
    *("setName", "setProblemDefinition", "setProjectionEvaluator"),
    *("setDefaultConnectionStrategy", "setup"),
)
"""Setters that take no plain value."""
_CRASH = ("setOrderedSampling", "setFocusSearch", "setInformedSampling", "setNearestK")
"""Setters that end the process at another value than the planner's own."""


def planner_of(
    name: str, information: base.SpaceInformation, settings: Mapping[str, Any]
) -> base.Planner:
    """One of OMPL's planners with our defaults and these settings; a ConfigError if it cannot."""
    kind = getattr(geometric, name)
    planner = kind(information)
    if issubclass(kind, geometric.RRTstar):
        planner.setRewireFactor(REWIRE_FACTOR)
    if kind is geometric.BITstar and information.getStateDimension() == 2:
        planner.setSamplesPerBatch(SAMPLES_PER_BATCH)
    setters = _setters(name)
    for setting, value in settings.items():
        try:
            getattr(planner, setters[setting])(value)
        except (TypeError, RuntimeError) as error:
            signature = getattr(kind, setters[setting]).__doc__.strip().splitlines()[0]
            expected = signature.rpartition(": ")[2].partition(")")[0]
            why = f"it must be {expected}" if isinstance(error, TypeError) else error
            raise ConfigError(f"{name} does not take {setting}={shown(value)}: {why}") from None
    return planner


def check_settings(planner: str, settings: Mapping[str, Any]) -> None:
    """Raise a ConfigError unless the planner has all these settings."""
    known = _setters(planner)
    if not isinstance(settings, Mapping):
        raise ConfigError(
            f"settings must be a dict, such as {{'range': 2.0}}, not {shown(settings)}"
        )
    for name, value in settings.items():
        if name not in known:
            raise ConfigError(f"{planner} has no setting {shown(name)}; it has: {', '.join(known)}")
        if isinstance(value, (int, float)) and not isinstance(value, bool):
            number(f"{planner}'s setting {name}", value, 1 if isinstance(value, int) else 0)


def _setters(planner: str) -> dict[str, str]:
    """The names of a planner's setters by the settings' names, such as "goal_bias"."""
    setters = {}
    for name in dir(getattr(geometric, planner)):
        if name.startswith("set") and name not in _NO_PLAIN_VALUE + _CRASH:
            setters[re.sub("(?<=[a-z])(?=[A-Z])", "_", name[3:]).lower()] = name
    return setters
