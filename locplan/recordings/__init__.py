"""Recorded drives of real robots: ground truth, noise, replays, and scan matching."""

from locplan.recordings.evaluation import DriveEvaluation, evaluate_drive
from locplan.recordings.files import read_recording
from locplan.recordings.location import locate
from locplan.recordings.map_fit import find_misfits, fit_to_map
from locplan.recordings.recording import Recording
from locplan.recordings.replays import Replay, replay
from locplan.recordings.simulated import record_drive
from locplan.recordings.study import RecordingReport, study_recording
from locplan.recordings.trajectory import Trajectory

__all__ = [
    "DriveEvaluation",
    "Recording",
    "RecordingReport",
    "Replay",
    "Trajectory",
    "evaluate_drive",
    "find_misfits",
    "fit_to_map",
    "locate",
    "read_recording",
    "record_drive",
    "replay",
    "study_recording",
]
