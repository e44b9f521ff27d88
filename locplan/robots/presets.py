"""Presets of AMCL's settings, which `check` and `tune` simulate on the user's map."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Final

from locplan.robots._amcl import MODELS, Amcl

Changes = dict[str, float | str]
"""Values of AMCL's parameters by their names."""
ALPHAS: Final = (0.05, 0.1, 0.2)
"""Noise of odometry that the presets assume. Each is combined with both laser models."""
SAFE: Final[Changes] = {"update_min_d": 0.1, "update_min_a": 0.1}
"""More frequent updates of the filter. All else stays as the user has it."""


def _assume_noise(alpha: float, model: str) -> Changes:
    return {**dict.fromkeys([f"alpha{n}" for n in range(1, 6)], alpha), "laser_model_type": model}


PRECISE: Final[Changes] = _assume_noise(0.05, MODELS[1])
"""Small errors if odometry and map are sound. A robot that gets lost with it does not return."""
PRESET_NAMES: Final = tuple({**SAFE, **PRECISE})
"""Names of the parameters that presets change."""


def amcl_presets(amcl: Amcl) -> dict[str, Changes]:
    """Return the changes of each preset that changes a robot's settings, by the preset's name.

    Parameters
    ----------
    amcl : Amcl
        The robot's own settings.

    Examples
    --------
    >>> [*amcl_presets(Amcl())][:3]
    ['update_min_a 0.1, update_min_d 0.1', 'alphas 0.05, likelihood_field_prob', 'alphas 0.05']
    """
    models = dict.fromkeys((MODELS[1], amcl.laser_model_type))
    changes = [SAFE, *(_assume_noise(alpha, model) for alpha in ALPHAS for model in models)]
    settings = {describe_changes(amcl, with_changes(amcl, each)): each for each in changes}
    return {name: each for name, each in settings.items() if name}


def with_changes(amcl: Amcl, changes: Changes) -> Amcl:
    """Return settings with other values of some parameters.

    Parameters
    ----------
    amcl : Amcl
        The settings.
    changes : dict of str to float or str
        The values by the parameters' names.
    """
    return replace(amcl, **changes)  # type: ignore[arg-type]


def describe_changes(before: Amcl, after: Amcl) -> str:
    """Return what differs between two settings, such as `alphas 0.05, likelihood_field_prob`.

    Parameters
    ----------
    before, after : Amcl
        The settings.

    Examples
    --------
    >>> describe_changes(Amcl(), Amcl(alpha1=0.1, update_min_d=0.1, update_min_a=0.1))
    'alpha1 0.1, update_min_a 0.1, update_min_d 0.1'
    """
    alphas = {getattr(after, f"alpha{n}") for n in range(1, 6)}
    texts = []
    for name in (each.name for each in fields(Amcl)):
        value = getattr(after, name)
        if value == getattr(before, name):
            continue
        if name == "laser_model_type":
            texts.append(str(value))
        else:
            is_alpha = name.startswith("alpha") and len(alphas) == 1
            texts.append(f"{'alphas' if is_alpha else name} {value:g}")
    return ", ".join(dict.fromkeys(texts))
