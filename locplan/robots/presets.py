"""The presets of AMCL's settings that `check` and `tune` try."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Final

from locplan.robots.amcl import MODELS, Amcl

SAFE, PRECISE = "safe", "precise"
"""Names of the presets."""
UPDATES: Final = {"update_min_d": 0.1, "update_min_a": 0.1}
"""Motions after which the filter updates with the safe preset [m, rad]."""
ALPHA: Final = 0.05
"""Noise of odometry that the precise preset assumes."""
ALPHAS: Final = {f"alpha{n}": ALPHA for n in range(1, 6)}
"""Parameters of the odometry's noise with the precise preset."""
AMCL_PRESETS: Final[dict[str, dict[str, Any]]] = {
    PRECISE: {**ALPHAS, "laser_model_type": MODELS[1]},
    SAFE: dict(UPDATES),
}
"""Values of AMCL's parameters by preset, in the order in which the presets are tried.

With the safe preset the filter updates more often, and all further parameters keep the user's
values. With the precise preset errors are small if odometry and map are sound, but a robot that
gets lost does not recover. Mixtures of both are no safer than the precise one on recorded
drives."""
PRESET_PARAMETERS: Final = tuple(
    {name: None for values in AMCL_PRESETS.values() for name in values}
)
"""Names of the parameters that presets change."""


def with_preset(amcl: Amcl, name: str) -> Amcl:
    """Return a robot's settings with a preset.

    Parameters
    ----------
    amcl : Amcl
        The robot's settings.
    name : str
        A name in `AMCL_PRESETS`.
    """
    changes = AMCL_PRESETS[name]
    if name == SAFE:  # a filter that updates more often than that keeps its own values
        changes = {name: min(value, getattr(amcl, name)) for name, value in changes.items()}
    return replace(amcl, **changes)


def list_applicable_presets(amcl: Amcl) -> dict[str, Amcl]:
    """Return a robot's settings with each preset that changes them, the precise one first.

    Parameters
    ----------
    amcl : Amcl
        The robot's settings.

    Examples
    --------
    >>> [*list_applicable_presets(Amcl())]
    ['precise', 'safe']
    >>> [*list_applicable_presets(Amcl(update_min_d=0.05, update_min_a=0.1))]
    ['precise']
    """
    settings = {name: with_preset(amcl, name) for name in AMCL_PRESETS}
    return {name: preset for name, preset in settings.items() if preset != amcl}


def describe_preset(name: str) -> str:
    """Describe the changes of a preset in words.

    Parameters
    ----------
    name : str
        A name in `AMCL_PRESETS`.

    Examples
    --------
    >>> describe_preset("safe"), describe_preset("precise")
    ('update_min_d 0.1, update_min_a 0.1', 'alphas 0.05, likelihood_field_prob')
    """
    changes = AMCL_PRESETS[name]
    words = [f"alphas {ALPHA:g}"] if changes.items() >= ALPHAS.items() else []
    for parameter, value in changes.items():
        if isinstance(value, str):
            words.append(value)
        elif not (words and parameter in ALPHAS):
            words.append(f"{parameter} {value:g}")
    return ", ".join(words)
