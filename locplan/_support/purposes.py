"""What the files of results are for, by the kind of the results and the name of the file."""

from __future__ import annotations

from collections.abc import Iterable
from fnmatch import fnmatch

SHOWN = 5
"""Maximum number of files that are listed; the others are counted."""
NAV2 = {
    "README.md": "how to use them in Nav2",
    "nav2.yaml": "Nav2's parameters, with these files in use",
    "graph.geojson": "the route graph for Nav2's route server",
    "mask.yaml": "the mask, as a map of Nav2",
    "preview.png": "the picture",
}
PURPOSES: dict[str, dict[str, str]] = {
    "choice": {
        "chosen.csv": "the recommended path, for export --path",
        "choice.png": "the picture",
        "candidates.csv": "all candidates with length, degeneracy and error",
        "choice.json": "everything in numbers, for export --choice",
        "[0-9]*.csv": "a candidate path",
    },
    "choices": {"choices.csv": "the recommended path of each query"},
    "front": {
        "front.png": "the picture",
        "knee.csv": "the path at the knee",
        "front.csv": "length and degenerate metres of each path",
        "front.npz": "all paths, for Python",
    },
    "check": {
        "report.html": "the report, for your browser",
        "README.md": "how to use the repaired map in Nav2",
        "nav2_params.yaml": "Nav2's parameters with the recommended settings",
        "landmarks.csv": "where each pole goes",
        "map.yaml": "the corrected map",
        "map_amcl.yaml": "the repaired map, for AMCL alone",
        "mask/README.md": "how to use the mask in Nav2",
        "check.csv": "the fixes with their rates",
    },
    "mend": {
        "README.md": "how to use the repaired map in Nav2",
        "map_amcl.yaml": "the repaired map, for AMCL alone",
        "map.yaml": "the map with the right threshold",
        "mend.png": "the picture",
        "mend.csv": "the repairs with their places",
    },
    "recording": {
        "drive.npz": "the recording, for --recording of other commands",
        "poses.tum": "the ground truth, for evo",
        "poses.csv": "the ground truth with standard deviations",
        "robot.yaml": "the robot with its measured noise, for --robot",
        "recording.png": "the picture",
        "*.npz": "the recording, for --recording of other commands",
    },
    "trajectory": {
        "poses.tum": "the poses, for evo",
        "poses.csv": "the poses with standard deviations",
        "trajectory.png": "the picture",
    },
    "drive": {"drive.png": "the picture", "scans.csv": "a row per scan"},
    "located": {
        "located.png": "the picture",
        "modes.csv": "the places where each scan fits",
        "scans.csv": "a row per scan",
    },
    "replay": {"replay.png": "the picture", "errors.csv": "the errors along the drive"},
    "simulation": {
        "simulation.png": "the picture",
        "errors.csv": "the errors along the path",
        "arrivals.csv": "the end of each closed-loop drive",
    },
    "queries": {"queries.csv": "a row per route"},
    "comparison": {
        "report.html": "the report, for your browser",
        "comparison.csv": "a row per planner and case",
        "runs.csv": "a row per run",
        "runs.jsonl": "the runs, from which an interrupted comparison resumes",
    },
    "tuning": {
        "nav2_params.yaml": "AMCL's settings for Nav2, for --robot",
        "tuning.png": "the picture",
    },
    "landmarks": {
        "landmarks.csv": "where each object goes",
        "map_with_landmarks.yaml": "the map with the objects",
        "landmarks.geojson": "the outlines, for QGIS",
        "landmarks.png": "the picture",
        "verification.csv": "the drives that verify them",
    },
    "maps": {"*.yaml": "the map, for ROS and all commands"},
    "info": {"*": "the picture"},
    "field": {"*.npz": "the field, for --field", "*": "the picture"},
    "fields": {"*.npz": "a field, for --field", "*": "a picture"},
    "nav2-keepout": NAV2,
    "nav2-speed": NAV2,
    "nav2-routes": NAV2,
    "ros-map": {"README.md": "how to use it", "*.yaml": "u in per cent, as a map of ROS"},
    "path": {"*": "the path"},
}
"""Purpose of a file by its name or pattern, the most useful first."""


def describe_files(kind: str, names: Iterable[str]) -> list[tuple[str, str]]:
    """Return the most useful files of results with their purposes.

    >>> describe_files("choice", ["choice.json", "chosen.csv", "errors.csv"])[0]
    ('chosen.csv', 'the recommended path, for export --path')
    """
    names = sorted(names)
    described: dict[str, str] = {}
    for pattern, purpose in PURPOSES.get(kind, {}).items():
        for name in names:
            if fnmatch(name, pattern):
                described.setdefault(name, purpose)
    return [*described.items()][:SHOWN]
