"""Advice for a site: check, tune, repair, and landmarks."""

from locplan.advice.check_result import Check
from locplan.advice.checkup import check
from locplan.advice.landmark_objects import Box, Pole
from locplan.advice.landmarks import place_landmarks, verify_landmarks
from locplan.advice.map_repair import repair
from locplan.advice.tuning import Tuning, tune, tune_on_drive

__all__ = [
    "Box",
    "Check",
    "Pole",
    "Tuning",
    "check",
    "place_landmarks",
    "repair",
    "tune",
    "tune_on_drive",
    "verify_landmarks",
]
