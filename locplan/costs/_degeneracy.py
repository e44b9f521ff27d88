"""Degeneracy of places: a scalar of one or several fields, between absolute anchors."""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
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
    """Settings of the degeneracy u of a costmap; see `Costmap.from_fields`."""

    law: str
    criterion: str
    fuse: str
    headings: str
    configs: tuple[FieldConfig, ...]
    """The settings of the fields."""

    def to_json(self) -> dict[str, object]:
        """All settings, fit for JSON."""
        about: dict[str, object] = {
            name: getattr(self, name) for name in ("law", "criterion", "fuse", "headings")
        }
        return about | {"configs": [config.to_json() for config in self.configs]}


def check_criterion(criterion: str, config: FieldConfig) -> None:
    """Raise a ConfigError unless fields of this config have the scalar."""
    layers = [layer.name for layer in config.estimator.layers]
    one_of("criterion", criterion, [*SCALARS, *layers])


def degeneracy(
    fields: Sequence[CovarianceField],
    criterion: str,
    law: str,
    fuse: str,
    headings: Literal["mean", "worst"] | None,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """u and e of all fields together, (H, W), or without `headings` of each one, (n, H, W)."""
    us, es, values = [], [], []
    anchors = [_anchors(field, criterion) for field in fields]
    for field, (least, greatest) in zip(fields, anchors, strict=True):
        layer = criterion in field.layers
        found = field.scalar(criterion, headings=headings, with_q=True)
        found = _headings_first(field.on_map(found, logarithmic=not layer), headings)
        values.append(found)
        us.append(_degeneracy_of(found, least, greatest, "layer" if layer else law))
        e = field.on_map(field.scalar("e", headings=headings))
        es.append(_headings_first(e, headings))
    if len(fields) == 1:
        return us[0], es[0]
    if fuse == "max":
        return functools.reduce(np.maximum, us), functools.reduce(np.maximum, es)
    if criterion in fields[0].layers:
        return _mean(us), _geometric_mean(es)
    least, greatest = np.exp(np.log(anchors).mean(axis=0))
    return _degeneracy_of(_geometric_mean(values), least, greatest, law), _geometric_mean(es)


def _anchors(field: CovarianceField, criterion: str) -> tuple[float, float]:
    check_criterion(criterion, field.config)
    least, greatest = field.anchors(criterion)
    if not greatest > least:
        raise ConfigError(f"criterion {shown(criterion)} says nothing in a field without rotation")
    return least, greatest


def _headings_first(values: NDArray[Any], headings: str | None) -> NDArray[np.float64]:
    """Move headings to the front, (n, H, W); without `headings`, (H, W) becomes (1, H, W)."""
    if values.ndim == 3:
        return np.moveaxis(values, 2, 0)
    return values if headings else values[None]


def _mean(arrays: Sequence[NDArray[Any]]) -> NDArray[np.float64]:
    return sum(arrays[1:], arrays[0]) / len(arrays)


def _geometric_mean(arrays: Sequence[NDArray[Any]]) -> NDArray[np.float64]:
    return np.exp(_mean([np.log(np.maximum(one, np.finfo(float).tiny)) for one in arrays]))


def _degeneracy_of(values: NDArray[Any], least: float, greatest: float, law: str) -> NDArray[Any]:
    if law == "logarithmic":
        u = np.log(values / least) / math.log(greatest / least)
    elif law == "layer":
        u = (values - least) / (greatest - least)
    else:
        u = values / greatest
        u = np.cbrt(u) if law == "cube-root" else u
    return np.clip(u, 0.0, 1.0)
