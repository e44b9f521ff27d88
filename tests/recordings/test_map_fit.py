"""Whether a map fits a drive, and the move that is found where it was shifted."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from support.cases import sample_cases
from support.machine import SHARED_DATA
from support.maps import ascii_map
from support.small_drive import FILE, MAP

from locplan.errors import ConfigError, RecordingError
from locplan.maps import FREE, OccupancyGrid, load_map
from locplan.recordings import Recording, fit_to_map, read_recording
from locplan.recordings.map_fit import MapFit, check_recording_on_map
from locplan.robots import Lidar

NAMES = ("intel", "aces", "csail", "fhw", "orebro", "seattle")
DRIVES = ("wean2", "killian_3", "mines2", "aces", "csail", "intel")


@pytest.fixture(scope="module")
def grid() -> OccupancyGrid:
    return load_map(MAP)


@pytest.fixture(scope="module")
def small() -> Recording:
    return Recording.load(FILE)


def check_found(fit: MapFit, drive: Recording, wanted: Recording) -> None:
    """The move that was found leads back, to a fraction of a cell."""
    assert fit.is_shifted
    assert not fit.fits
    found = drive.move(*fit.move)
    assert np.abs(found.poses[:, :2] - wanted.poses[:, :2]).max() < 0.06
    turned = (found.poses[:, 2] - wanted.poses[:, 2] + np.pi) % (2 * np.pi) - np.pi
    assert np.abs(turned).max() < 0.005


def test_drive_fits_its_map(small, grid):
    fit = fit_to_map(small, grid)
    assert fit.fits
    assert not fit.is_shifted
    assert fit.share > 0.9
    assert fit.distance == 0.1
    assert fit.sentence == f"The map fits: {fit.share:.0%} of the beams end within 0.1 m of a wall."


@pytest.mark.parametrize(
    "move", sample_cases([(-7.0, 40.0, 2.2), (1.3, -0.6, 0.0), (0.0, 0.0, math.pi / 2)])
)
def test_map_fit_finds_shift_and_turn(small, grid, move):
    moved = small.move(*move)
    fit = fit_to_map(moved, grid)
    check_found(fit, moved, small)
    assert fit.sentence.startswith(f"The map seems shifted: {fit.share:.0%} of the beams end")
    other = OccupancyGrid(grid.cells, grid.resolution, fit.origin)
    assert fit_to_map(moved, other).fits  # the remedy that the sentence names


def test_map_fit_uses_map_yaw(small, grid, coarse_fit):
    x, y, yaw = grid.origin
    cos, sin = math.cos(0.6), math.sin(0.6)
    turned = OccupancyGrid(
        grid.cells, grid.resolution, (cos * x - sin * y, sin * x + cos * y, yaw + 0.6)
    )
    assert fit_to_map(small.move(0.0, 0.0, 0.6), turned).fits
    check_found(fit_to_map(small, turned), small, small.move(0.0, 0.0, 0.6))


def test_map_fit_reports_small_shift(small, grid):
    """Many beams still end near walls after a small shift."""
    moved = small.move(0.12, 0.0, 0.0)
    fit = fit_to_map(moved, grid)
    assert fit.share >= 0.6
    check_found(fit, moved, small)


def test_another_map_does_not_fit(small, coarse_fit):
    fit = fit_to_map(small, load_map(MAP.with_name("warehouse.yaml")))
    assert not fit.fits
    assert not fit.is_shifted
    assert fit.best_share < 0.6
    assert fit.ranges is None
    assert "The map does not fit" in fit.sentence


def test_map_fit_reports_wrong_resolution(small, grid, coarse_fit):
    fit = fit_to_map(replace(small, ranges=small.ranges * 0.9), grid)
    assert not fit.fits
    assert fit.ranges.factor.value == pytest.approx(0.9, abs=0.001)
    assert "multiply resolution and origin in its YAML by 0.900" in fit.sentence


@pytest.mark.parametrize("turn", sample_cases((90, 180, -90), 0))
def test_map_fit_reports_wrong_mount(small, grid, turn, coarse_fit):
    centred = replace(small.lidar, mount_x=0.0)
    wrong = replace(small, lidar=replace(centred, mount_yaw_deg=-turn))
    fit = fit_to_map(wrong, grid)
    assert fit.mount == f"turned by {turn} deg"
    assert f"The lidar seems to be turned by {turn} deg: " in fit.sentence


@pytest.mark.long
def test_map_fit_reports_upside_down_lidar(small, grid, coarse_fit):
    mirrored = replace(small, ranges=small.ranges[:, ::-1])
    assert fit_to_map(mirrored, grid).mount == "upside down"


@pytest.mark.long
def test_map_fit_progress_counts_turns(small, grid, coarse_fit):
    seen: list[tuple[int, int]] = []
    fit_to_map(small.move(3.0, 0.0, 0.0), grid, progress=lambda *each: seen.append(each))
    total = seen[0][1]
    assert total % 4 == 0  # so that quarter turns are among them
    assert seen == [(n + 1, total) for n in range(total)]


def test_map_fit_rejects_unusable_input(small):
    with pytest.raises(RecordingError, match="has no walls; use another map"):
        fit_to_map(small, OccupancyGrid(np.full((20, 20), FREE), 0.1))
    with pytest.raises(ConfigError, match="grid must be an OccupancyGrid"):
        fit_to_map(small, "map")
    with pytest.raises(ConfigError, match="recording must be a Recording"):
        fit_to_map("drive", ascii_map("#.#"))


def test_map_fit_accepts_single_beam():
    lidar = Lidar(range=9.0, field_of_view_deg=180.0, beams=101)
    ranges = np.full((1, 101), np.inf)
    ranges[0, 1] = 3.0  # none of the evenly spaced beams
    fit = fit_to_map(Recording(ranges, lidar, [[1.5, 1.5, 0.0]]), ascii_map("###", "#.#", "###"))
    assert 0.0 <= fit.share <= 1.0


def without_poses(recording: Recording) -> Recording:
    return replace(recording, poses=np.full_like(recording.poses, np.nan))


def test_check_place_accepts_recording_of_map(small, grid):
    check_recording_on_map(small, grid)
    check_recording_on_map(small.move(5.0, -3.0, 1.0), grid)
    check_recording_on_map(replace(small, odometry=None), grid)


def test_check_place_rejects_other_building(small):
    other = load_map("two_corridors")
    message = (
        r"small_drive does not fit two_corridors: only \d+% of its ranges agree .*; use the map"
    )
    for recording in (small, without_poses(small)):
        with pytest.raises(RecordingError, match=message):
            check_recording_on_map(recording, other)


def test_check_place_names_wrong_mount(small, grid):
    centred = replace(small.lidar, mount_x=0.0)
    wrong = replace(small, lidar=replace(centred, mount_yaw_deg=-90))
    with pytest.raises(RecordingError, match="office: The lidar seems to be turned by 90 deg"):
        check_recording_on_map(wrong, grid)


def test_check_place_ignores_scans_without_returns(small, grid):
    ranges = small.ranges.copy()
    ranges[::2] = np.inf
    check_recording_on_map(replace(small, ranges=ranges), grid)
    ranges[5:] = np.inf  # nothing to compare, which other checks tell
    check_recording_on_map(replace(without_poses(small), ranges=ranges), grid)


@pytest.mark.parametrize("name", sample_cases(DRIVES, 0))
def test_check_place_distinguishes_real_recordings(name):
    """Killian Court's map has kinks; wean2 is mostly one corridor, as parts of other maps are."""
    folder = SHARED_DATA / "drives"
    if not folder.is_dir():
        pytest.skip("the recordings of real robots (../shared/data/drives) are not here")
    recording = read_recording(folder / f"{name}.log.gz")
    for other in DRIVES:
        grid = load_map(folder / f"{other}.yaml")
        if other == name:
            check_recording_on_map(recording, grid)
            check_recording_on_map(without_poses(recording), grid)
        else:
            with pytest.raises(RecordingError, match="does not fit"):
                check_recording_on_map(recording, grid)


@pytest.mark.parametrize("name", sample_cases(NAMES, 0)[:3])
def test_real_logs_fit_only_their_maps(name, request):
    if not all((SHARED_DATA / each).is_dir() for each in ("carmen", "rosmaps_carmen")):
        pytest.skip("the logs of real lasers (../shared/data/carmen) are not here")
    log = read_recording(SHARED_DATA / "carmen" / f"{name}-corrected.log.gz")
    own = load_map(SHARED_DATA / "rosmaps_carmen" / name)
    assert fit_to_map(log, own).share > 0.9
    moved = log.move(-2.0, 3.0, 0.8)
    check_found(fit_to_map(moved, own), moved, log)
    other = NAMES[NAMES.index(name) - 1]
    request.getfixturevalue("coarse_fit")  # nothing is to be found
    fit = fit_to_map(log, load_map(SHARED_DATA / "rosmaps_carmen" / other))
    assert not fit.fits
    assert not fit.is_shifted
