"""The degeneracy u of a field between absolute anchors, and its e, on the map's cells."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np

from locplan._kernels.arrays import Floats
from locplan._util.checks import one_of, shown
from locplan.errors import ConfigError
from locplan.field import SCALARS, CovarianceField, FieldConfig


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
) -> tuple[Floats, Floats]:
    """u and e of a field, (H, W), or without `headings` of each one, (n, H, W)."""
    check_criterion(criterion, field.config)
    if not np.less(*field.anchors(criterion)):
        raise ConfigError(f"criterion {shown(criterion)} says nothing in a field without rotation")
    values, of_e = field.scalar(criterion, with_q=True), field.scalar("e")
    if values.ndim == 2:
        return _degeneracy(field, criterion, law, values, of_e)
    count = values.shape[2]
    if headings is None:
        both = np.empty((2, count, *field.grid.shape))
        for k in range(count):
            both[:, k] = _degeneracy(field, criterion, law, values[..., k], of_e[..., k])
        return both[0], both[1]
    # One heading at a time, since all of a large map take much memory.
    joined = np.zeros((2, *field.grid.shape))
    join = np.add if headings == "mean" else np.maximum
    for k in range(count):
        join(joined, _degeneracy(field, criterion, law, values[..., k], of_e[..., k]), out=joined)
    u, e = joined / count if headings == "mean" else joined
    return u, e


def _degeneracy(
    field: CovarianceField, criterion: str, law: str, values: Floats, of_e: Floats
) -> tuple[Floats, Floats]:
    """u and e, (H, W), of the criterion and of e on the lattice, (h, w)."""
    least, greatest = field.anchors(criterion)
    e = field.on_map(of_e)
    if criterion in field.layers:
        u = field.on_map((values - least) / (greatest - least), logarithmic=False)
    elif law == "logarithmic" and np.shares_memory(values, of_e):
        u = e / least
        u = np.log(u, out=u)
        u /= math.log(greatest / least)
    elif law == "logarithmic":
        values = np.log(np.maximum(values, np.finfo(float).tiny) / least)
        u = field.on_map(values / math.log(greatest / least), logarithmic=False)
    else:
        u = field.on_map(values / greatest)
        u = np.cbrt(u, out=u) if law == "cube-root" else u
    return np.clip(u, 0.0, 1.0, out=u), e
