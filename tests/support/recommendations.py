"""Recommendations with their settings as keywords, for short calls in tests."""

from __future__ import annotations

import dataclasses

from locplan.simulation import RecommendationSettings, recommend_path, recommend_paths

FIELDS = frozenset(field.name for field in dataclasses.fields(RecommendationSettings))


def recommend(*arguments, **options):
    """Call `recommend_path` with a settings object made of the keywords that it has."""
    return recommend_path(*arguments, **_gather_settings(options))


def recommend_many(*arguments, **options):
    """Call `recommend_paths` with a settings object made of the keywords that it has."""
    return recommend_paths(*arguments, **_gather_settings(options))


def _gather_settings(options):
    values = {name: value for name, value in options.items() if name in FIELDS}
    others = {name: value for name, value in options.items() if name not in FIELDS}
    return others | {"settings": RecommendationSettings(**values)}
