"""Settings of localizability fields that are quick to compute."""

from __future__ import annotations

from dataclasses import replace

from locplan.field import FieldConfig, Sad, SearchWindow


def change_estimator(config: FieldConfig, **settings) -> FieldConfig:
    """The same with other settings of its estimator."""
    return replace(config, estimator=replace(config.estimator, **settings))


QUICK_FIELD = FieldConfig(Sad(range=0.6, window=SearchWindow(half_width=0.4)))
"""Two by two tiles of the map below."""
