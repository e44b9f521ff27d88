"""Degeneracy of places: a scalar of a field, between absolute anchors."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from locplan._util.checks import one_of, shown
from locplan.costs._density import sealed
from locplan.errors import ConfigError
from locplan.field import SCALARS, CovarianceField, FieldConfig

LAWS = ("logarithmic", "linear", "cube-root")


@dataclass(frozen=True)
class CostSettings:
    """Settings of the degeneracy u of a costmap; see `Costmap.from_field`."""

    law: str
    """Law that makes u of the criterion: "logarithmic", "linear" or "cube-root"."""
    criterion: str
    """Scalar or layer of the field that u is made of, such as "e" or "position_std"."""
    headings: str
    """Value that counts where the robot's heading is not known: "mean" or "worst"."""
    config: FieldConfig
    """The settings of the field."""
    whole_field: bool = True
    """False if the field has values at some lattice points only, as near paths."""

    def to_json(self) -> dict[str, object]:
        """All settings, fit for JSON."""
        return {**vars(self), "config": self.config.to_json()}


def check_criterion(criterion: str, config: FieldConfig) -> None:
    """Check that fields have a scalar, before they are computed.

    Parameters
    ----------
    criterion : str
        The scalar or layer that degeneracy is to be made of, see `Costmap.from_field`.
    config : FieldConfig
        Settings of the fields.

    Raises
    ------
    ConfigError
        If they have none of this name.
    """
    layers = [layer.name for layer in config.estimator.layers]
    one_of("criterion", criterion, [*SCALARS, *layers])


def degeneracy(
    field: CovarianceField, criterion: str, law: str, headings: Literal["mean", "worst"] | None
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """u and e of a field, (H, W), or without `headings` of each one, (n, H, W)."""
    check_criterion(criterion, field.config)
    least, greatest = field.anchors(criterion)
    if not greatest > least:
        raise ConfigError(f"criterion {shown(criterion)} says nothing in a field without rotation")
    values = field.scalar(criterion, headings=headings, with_q=True)
    of_e = field.scalar("e", headings=headings)
    e = field.on_map(of_e)
    if criterion in field.layers:
        u = field.on_map((values - least) / (greatest - least), logarithmic=False)
    elif law == "logarithmic" and values is of_e:
        u = e / least
        u = np.log(u, out=u)
        u /= math.log(greatest / least)
    elif law == "logarithmic":
        values = np.log(np.maximum(values, np.finfo(float).tiny) / least)
        u = field.on_map(values / math.log(greatest / least), logarithmic=False)
    else:
        u = field.on_map(values / greatest)
        u = np.cbrt(u, out=u) if law == "cube-root" else u
    u = np.clip(u, 0.0, 1.0, out=u)
    return (u, e) if headings else (np.moveaxis(u, 2, 0), np.moveaxis(e, 2, 0))


@dataclass(frozen=True, eq=False)
class HeadingLayers:
    """u and e for each heading of the robot, read from a field when they are first asked for."""

    read: Callable[[], tuple[NDArray[np.floating], NDArray[np.floating]]]
    """It returns u, 0..1, and e [m^2 rad] for n headings, (n, H, W) each."""

    @classmethod
    def of(cls, field: CovarianceField, settings: CostSettings) -> HeadingLayers | None:
        """Layers of the headings that a field has; None if they are alike."""
        if field.config.headings == 1:
            return None
        return cls(partial(degeneracy, field, settings.criterion, settings.law, None))

    @cached_property
    def both(self) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """u and e, (n, H, W) each, read-only."""
        u, e = (np.array(layer, np.float32) for layer in self.read())
        return sealed(u), sealed(e)

    def __getstate__(self) -> dict[str, Any]:
        # What has been read needs no field any more, which is large.
        both = vars(self).get("both")
        return {"read": partial(tuple, both), "both": both} if both else vars(self)

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        for layer in state.get("both", ()):
            sealed(layer)
