"""Degeneracy of places: a scalar of a field, between absolute anchors."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from locplan._util.checks import one_of, shown
from locplan.errors import ConfigError
from locplan.field import SCALARS, CovarianceField, FieldConfig

LAWS = ("logarithmic", "linear", "cube-root")


@dataclass(frozen=True)
class CostSettings:
    """Settings of the degeneracy u of a costmap; see `Costmap.from_field`."""

    law: str
    criterion: str
    headings: str
    config: FieldConfig
    """The settings of the field."""

    def to_json(self) -> dict[str, object]:
        """All settings, fit for JSON."""
        return {**vars(self), "config": self.config.to_json()}


def check_criterion(criterion: str, config: FieldConfig) -> None:
    """Raise a ConfigError unless fields of this config have the scalar."""
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
    layer = criterion in field.layers
    found = field.scalar(criterion, headings=headings, with_q=True)
    values = field.on_map(found, logarithmic=not layer)
    u = _degeneracy_of(values, least, greatest, "layer" if layer else law)
    e = field.on_map(field.scalar("e", headings=headings))
    return (u, e) if headings else (np.moveaxis(u, 2, 0), np.moveaxis(e, 2, 0))


def _degeneracy_of(values: NDArray[Any], least: float, greatest: float, law: str) -> NDArray[Any]:
    if law == "logarithmic":
        u = np.log(values / least) / math.log(greatest / least)
    elif law == "layer":
        u = (values - least) / (greatest - least)
    else:
        u = values / greatest
        u = np.cbrt(u) if law == "cube-root" else u
    return np.clip(u, 0.0, 1.0)
