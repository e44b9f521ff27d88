"""Simulation of a route, with the recommendation of `locplan plan`."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from locplan._support.intervals import Interval
from locplan._support.kernels.arrays import Bools
from locplan.app.explorer.plans import read_weight
from locplan.app.explorer.scene import MapScene, read_stops
from locplan.errors import ConfigError
from locplan.field.field import CovarianceField
from locplan.maps.grid import OccupancyGrid
from locplan.planning.path import Path
from locplan.planning.plans import SHORTEST
from locplan.simulation.problem import FieldFunction, RecommendationSettings
from locplan.simulation.race import Candidate
from locplan.simulation.recommendation import RUN_CHECK, Recommendation
from locplan.simulation.recommender import recommend_path

if TYPE_CHECKING:
    from locplan.app.explorer.messages import Question, QuestionJob
    from locplan.app.explorer.session import Session

PAGE_PATH = "shown"
"""Name of the candidate that the page shows."""
TITLES = {PAGE_PATH: "Shown path", SHORTEST: "Shortest"}
"""Titles of candidates whose names are not shown."""
MAX_DRIVES = 64
"""Maximum number of confirming drives of a path."""
MAX_POINTS = 5000
"""Maximum number of points of the shown path."""


def simulate_route(
    session: Session, scene: MapScene, question: Question, job: QuestionJob
) -> dict[str, Any]:
    """Simulate the candidates of a route, and return the recommended one.

    The shown path is a candidate, too. Cancelled work ends after the current drives.
    """
    field = scene.check_field()
    drives = int(question.number("drives", 2, MAX_DRIVES, MAX_DRIVES))
    job.progress(0, drives)
    stops, _ = read_stops(question, scene.parts)
    start, *via, goal = stops
    page_path, weight = question.positions("path", MAX_POINTS), read_weight(question, scene)
    opening, site = session.opening, scene.site
    recommendation = recommend_path(
        site.grid,
        start,
        goal,
        site.robot,
        costs=site.config,
        candidates={PAGE_PATH: Path(page_path)} if page_path else {},
        compute=_make_field_reader(field),
        settings=RecommendationSettings(via=tuple(via), weight=weight, drives=drives),
        zones=site.zones,
        threads=opening.threads,
        progress=job.progress,
    )
    if recommendation.path is None:
        raise ConfigError("no path joins start and goal; move one of them")
    return describe_recommendation(recommendation)


def _make_field_reader(field: CovarianceField) -> FieldFunction:
    """Return a function that returns the field at some of its points."""

    def compute(grid: OccupancyGrid, points: Bools | None = None, /) -> CovarianceField:
        if points is None:
            return field
        values = {name: array.copy() for name, array in field.values.items()}
        for array in values.values():
            array[~points] = np.nan
        return CovarianceField.from_values(values, grid, field.config)

    return compute


def describe_recommendation(recommendation: Recommendation) -> dict[str, Any]:
    """Return a recommendation as the page shows it."""
    recommended, shortest = recommendation.recommended_candidate, recommendation.shortest
    assert recommended is not None
    assert shortest is not None
    headline, *details = recommendation.answer
    return {
        "verdict": headline,
        "evidence": recommendation.reached_text,
        "advice": [
            sentence.removesuffix(RUN_CHECK).rstrip()
            for sentence in details
            if sentence != recommendation.reached_text
        ],
        "recommended": recommended.name,
        "candidates": [
            _describe_candidate(candidate, recommendation)
            for candidate in recommendation.candidates
        ],
        "along": {
            "recommended": _describe_errors(recommended),
            "shortest": _describe_errors(shortest),
        },
    }


def _describe_candidate(candidate: Candidate, recommendation: Recommendation) -> dict[str, Any]:
    path_drives = candidate.driven
    no_interval = Interval(math.nan, math.nan, math.nan)
    error, lost = no_interval, no_interval
    if path_drives is not None:
        error, lost = path_drives.error, path_drives.lost_rate
    return {
        "name": candidate.name,
        "title": TITLES.get(candidate.name, candidate.name.capitalize()),
        "xy": np.round(candidate.path.xy, 3).tolist(),
        "length": candidate.path.length,
        "error": error.value,
        "error_interval": [error.low, error.high],
        "lost": lost.value,
        "lost_interval": [lost.low, lost.high],
        "is_recommended": candidate is recommendation.recommended_candidate,
        "is_shortest": candidate is recommendation.shortest,
    }


def _describe_errors(candidate: Candidate) -> dict[str, list[float]] | None:
    """Return the errors of the drives along a path; None without drives."""
    if candidate.driven is None:
        return None
    distance, median, low, high = candidate.driven.profile.T
    centimetres = {"median_cm": median, "low_cm": low, "high_cm": high}
    return {"s": np.round(distance, 3).tolist()} | {
        name: np.round(100 * values, 2).tolist() for name, values in centimetres.items()
    }
