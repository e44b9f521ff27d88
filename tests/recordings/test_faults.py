"""Faults of recorded drives that no ground truth is needed for, put into simulated drives."""

from __future__ import annotations

import dataclasses
import itertools
import math

import cv2
import numpy as np
import pytest
from support.carmen_logs import format_flaser
from support.machine import SHARED_DATA
from support.maps import corridor
from support.recordings import simulate_recording

from locplan import Lidar, load_map
from locplan._support.poses import apply_motions, compute_motions, wrap_angles
from locplan.advice.map_reading import MapCorrection
from locplan.advice.recorded import analyze_recordings as look_at_drives
from locplan.maps import FREE, OCCUPIED, UNKNOWN, MapFaults, OccupancyGrid, environments
from locplan.recordings import Recording, read_recording
from locplan.recordings.calibration import fit_odometry_noise
from locplan.recordings.faults import find_recording_faults, measure_steps
from locplan.robots import Amcl, Disturbances

LIDAR = Lidar(range=8.0, min_range=0.1, field_of_view_deg=270.0, beams=136, range_sigma=0.01)


@pytest.fixture(scope="module")
def office():
    return environments.make("office", resolution=0.1)


def straight(*xs, y=7.0, spacing=0.1):
    """Poses along a line from x to x without a turn, (n, 3); the robot reverses."""
    parts = [
        np.linspace(a, b, round(abs(b - a) / spacing), endpoint=False)
        for a, b in itertools.pairwise(xs)
    ]
    x = np.concatenate([*parts, [xs[-1]]])
    return np.column_stack([x, np.full(len(x), y), np.zeros(len(x))])


@pytest.fixture(scope="module")
def drive(office):
    """A drive of 17 m in a crossing of corridors with doors, of which the robot reverses 3 m."""
    return simulate_recording(office, straight(7.0, 14.0, 11.0, 18.0), lidar=LIDAR)


def change_motions(drive, change):
    """The drive, with steps (n - 1, 3) of its odometry changed in place."""
    motions = compute_motions(drive.odometry[:-1], drive.odometry[1:])
    change(motions)
    odometry = [drive.odometry[0]]
    for way in motions:
        odometry.append(apply_motions(odometry[-1], way))
    return dataclasses.replace(drive, odometry=np.array(odometry))


def test_sound_drive_has_no_faults(office, drive):
    faults = find_recording_faults(drive, office)
    assert faults.is_sound
    assert faults.disagreements == ()
    assert not faults.faulty_steps.any()
    assert faults.n_backward_steps > 5
    assert faults.n_reversed_steps == 0
    assert faults.misfit.length < 0.5
    assert not any("map" in text or "jumps" in text for text in faults.sentences)


def test_faults_name_dropped_sign_of_reversing(drive):
    def drop_sign(ways):
        ways[ways[:, 0] < 0, :2] *= -1

    faults = find_recording_faults(change_motions(drive, drop_sign))
    assert faults.has_sign_fault
    assert not faults.is_sound
    assert faults.n_reversed_steps == faults.n_backward_steps > 5
    assert faults.reversed_way == pytest.approx(3.0, abs=0.6)
    assert faults.faulty_steps[72:98].all()
    assert not faults.faulty_steps[:65].any()
    assert not faults.faulty_steps[107:].any()
    assert faults.sentences[0] == (
        f"Odometry moves forward at {faults.n_reversed_steps} of {faults.n_backward_steps} places"
        " where the"
        f" scans move back ({faults.reversed_way:.2g} m). Probably the driver drops the sign of the"
        " velocity."
    )


@pytest.mark.parametrize(("share", "is_sound"), [(0.5, True), (0.0, False)])
def test_faults_find_slip_and_standstill(drive, share, is_sound):
    def slip(ways):
        ways[20:40, :2] *= share  # over 2 m

    faults = find_recording_faults(change_motions(drive, slip))
    (place,) = faults.disagreements
    assert place.x == pytest.approx(9.0, abs=0.5)
    assert place.error == pytest.approx(2 * (1 - share), abs=0.4)
    assert faults.is_sound == is_sound
    assert not faults.has_sign_fault
    assert faults.sentences[0].startswith(
        "Odometry and scans disagree by more than 0.15 m per step at 1 place, most at"
    )


def test_faults_find_jump_and_reset(drive):
    jumped = drive.odometry.copy()
    jumped[50:, 0] += 5.0
    faults = find_recording_faults(dataclasses.replace(drive, odometry=jumped))
    assert (faults.n_jumps, faults.n_resets, faults.is_sound) == (1, 0, False)
    assert np.flatnonzero(faults.faulty_steps).tolist() == [49]
    assert faults.sentences[0] == "Odometry jumps at 1 place."
    reset = drive.odometry.copy()
    reset[50:] = compute_motions(reset[50], reset[50:])
    faults = find_recording_faults(dataclasses.replace(drive, odometry=reset))
    assert (faults.n_jumps, faults.n_resets, faults.is_sound) == (1, 1, False)
    assert faults.sentences[0] == "Odometry jumps at 1 place, to its start at 1 of them."


def test_faults_ignore_gap_of_log(drive):
    """A robot drives far between two scans if time passes between them."""
    gap = np.r_[:30, 60:71]
    times = 0.2 * np.arange(len(drive))
    some = dataclasses.replace(drive, times=times)[gap]
    assert find_recording_faults(some).n_jumps == 0
    assert find_recording_faults(dataclasses.replace(some, times=None)).n_jumps == 1


def test_steps_across_gap_are_not_compared():
    """In a corridor, the scans on both sides of a gap match at the edge of the search window."""
    grid = environments.make("two_corridors", resolution=0.1)
    drive = simulate_recording(grid, straight(8.0, 32.0, y=3.0), lidar=LIDAR)
    drive = dataclasses.replace(drive, times=0.2 * np.arange(len(drive)))
    gap = np.r_[:80, 120 : len(drive)]
    assert find_recording_faults(drive[gap]).disagreements == ()


def test_faults_find_kinked_map(office, drive):
    turn = cv2.getRotationMatrix2D((126.0, 76.0), 10.0, 1.0)  # about the cell of (12, 7)
    cells = cv2.warpAffine(
        office.cells, turn, office.shape[::-1], flags=cv2.INTER_NEAREST, borderValue=int(UNKNOWN)
    )
    cells[:, :126] = office.cells[:, :126]
    kinked = dataclasses.replace(office, cells=cells)
    faults = find_recording_faults(drive, kinked)
    assert faults.has_misfit
    assert not faults.is_sound
    assert faults.misfit.x > 10
    assert faults.sentences[0] == (
        f"The map does not fit the scans at ({faults.misfit.x:.1f}, {faults.misfit.y:.1f}), over"
        f" {faults.misfit.length:.2g} m."
    )


def test_stretch_ignores_errors_of_poses(office, drive):
    """Poses of a filter are off by 0.2 m; the map is no worse for it."""
    random, poses = np.random.default_rng(0), drive.poses.copy()
    knots = np.arange(0, len(poses) + 15, 15)
    for axis, sigma in enumerate((0.2, 0.2, math.radians(1.5))):
        values = random.normal(0, sigma, len(knots))
        poses[:, axis] += np.interp(np.arange(len(poses)), knots, values)
    faults = find_recording_faults(dataclasses.replace(drive, poses=poses), office)
    assert faults.misfit.length < 1


def test_faults_report_motion_hidden_by_corridor():
    grid = corridor(40.0, 2.0)
    line = straight(-6.0, 6.0, y=0.0)
    exact = Disturbances(boundary_noise=0.0, outliers=0.0, occlusion=0.0)
    drive = simulate_recording(grid, line, lidar=LIDAR, disturbances=exact)

    def slip(ways):
        ways[20:40, :2] *= 0.5

    faults = find_recording_faults(change_motions(drive, slip))
    assert faults.disagreements == ()
    assert faults.n_hidden_steps > 0.9 * faults.n_steps
    assert faults.sentences == (
        f"The scans cannot show motion along corridors at {faults.n_hidden_steps} of"
        f" {faults.n_steps} steps.",
    )


def test_faulty_steps_are_not_in_drift(drive, monkeypatch):
    monkeypatch.setattr("locplan.recordings.calibration.RESAMPLES", 5)

    def slip(ways):
        ways[20:40, :2] *= 0.5

    slipped = change_motions(drive, slip)
    faulty = find_recording_faults(slipped).faulty_steps
    alphas = [fit_odometry_noise(slipped, Amcl(), mask).alpha3.value for mask in (None, faulty)]
    assert alphas[1] < 0.1 * alphas[0]


def test_check_reports_and_excludes_faults(office, drive, monkeypatch):
    """`check` reports a drive's faults, and estimates its drifts without the faulty steps."""
    monkeypatch.setattr("locplan.recordings.calibration.RESAMPLES", 5)

    def slip(ways):
        ways[20:40, :2] *= 0.5

    def stand(ways):
        ways[20:60, :2] = 0

    drives, robot = [change_motions(drive, change) for change in (slip, stand)], drive.robot()
    map_faults = MapFaults(office, (), office)
    results = [
        look_at_drives([one], MapCorrection(office), map_faults, robot, None, 1, 1)
        for one in drives
    ]
    assert [result.are_sound for result in results] == [(True,), (False,)]
    assert any("Odometry and scans disagree" in text for text in results[0].sentences)
    masks = [None, find_recording_faults(drives[0]).faulty_steps]
    drifts = [fit_odometry_noise(drives[0], Amcl(), mask).distance_bias.value for mask in masks]
    assert abs(drifts[1]) < 0.3 * abs(drifts[0])
    assert results[0].robot.odometry.distance_bias == pytest.approx(abs(drifts[1]))


def read_log(path, speeds, *, stamps=None):
    """A log whose odometry moves 0.1 m ahead from scan to scan, with velocities; read."""
    lines = []
    for n, speed in enumerate(speeds):
        stamp = float(n) if stamps is None else stamps[n]
        lines += [
            f"ODOM {0.1 * n} 0 0 {speed} 0 0 {stamp} host {stamp}\n",
            format_flaser((0.1 * n, 0.5, 0), stamp=stamp),
        ]
    path.write_text("".join(lines))
    return read_recording(path)


def test_faults_find_wrong_velocity_sign(tmp_path):
    speeds = [0.1] * 6 + [-0.1] * 6
    drive = read_log(tmp_path / "a.log", speeds)
    assert drive.speeds.tolist() == speeds
    drive.save(tmp_path / "a.npz")
    again = Recording.load(tmp_path / "a.npz")
    assert again[::2].speeds.tolist() == speeds[::2]
    faults = find_recording_faults(again)
    assert faults.has_sign_fault
    assert faults.sentences[0] == (
        "Odometry's pose moves forward at 5 of 5 steps with a negative velocity. Correct"
        " the sign in its driver, and record again."
    )
    assert not find_recording_faults(read_log(tmp_path / "b.log", [0.1] * 12)).has_sign_fault
    assert read_log(tmp_path / "c.log", [0] * 12).speeds is None


def test_faults_count_stamps_out_of_order(tmp_path):
    drive = read_log(tmp_path / "a.log", [0] * 6, stamps=[0, 1, 3, 2, 5, 4])
    faults = find_recording_faults(drive)
    assert (drive.times, faults.stamps_back) == (None, 2)
    assert "The stamps of 2 scans are out of order." in faults.sentences
    assert find_recording_faults(read_log(tmp_path / "b.log", [0] * 6)).stamps_back == 0


def test_faults_work_with_incomplete_recordings(office, drive):
    """Odometry, poses or a second scan may be missing."""
    without = dataclasses.replace(drive, odometry=None)
    faults = find_recording_faults(without, office)
    assert (faults.n_steps, faults.sentences, faults.is_sound) == (0, (), True)
    assert find_recording_faults(drive[:1], office).is_sound

    def stand(ways):
        ways[20:40, :2] = 0

    unknown = dataclasses.replace(
        change_motions(drive, stand), poses=np.full((len(drive), 3), np.nan)
    )
    faults = find_recording_faults(unknown, office)
    assert faults.misfit is None
    assert faults.disagreements[0].x == pytest.approx(9.0, abs=0.5)


def test_steps_equal_plain_loops():
    """The best motion between two scans, by the distances of ends from those of the scan before."""
    cells = np.full((60, 60), FREE, np.uint8)
    cells[[4, -5]] = cells[:, [4, -5]] = OCCUPIED
    cells[20:24, 40:44] = OCCUPIED
    room = OccupancyGrid(cells, 0.05)
    lidar = Lidar(range=3.0, field_of_view_deg=180.0, beams=179)
    line = np.array([[1.2, 1.4, 0.3], [1.44, 1.5, 0.35]])
    exact = Disturbances(boundary_noise=0.0, outliers=0.0, occlusion=0.0)
    odometry = np.array([[0.0, 0, 0], [0.5, -0.03, 0.1]])  # off by 0.25 m
    drive = simulate_recording(room, line, lidar=lidar, disturbances=exact, odometry=odometry)
    steps = measure_steps(drive)
    before, after = drive.ends_on_robot()
    low = before.min(axis=0) - 0.05
    near = np.hypot(*np.diff(before, axis=0).T) < 10 * math.radians(1) * drive.ranges[0][1:]
    walls = set()
    for n in np.flatnonzero(near):  # neighbours lie at most a cell apart, or on a line
        for part in np.linspace(before[n], before[n + 1], 200):
            walls.add(tuple(np.floor((part - low) / 0.05).astype(int)))
    where = np.array(sorted(walls))
    col, row = np.mgrid[-60:120, -60:120]
    square = np.full(col.shape, np.inf)
    for x, y in where:
        square = np.minimum(square, (col - x) ** 2 + (row - y) ** 2)
    score = 1 - np.log(0.5 * np.exp(-square * 0.05**2 / 0.02) + 0.5) / math.log(0.5)
    scores = {}
    at = (odometry[1, :2] - low) / 0.05
    for turn in range(-15, 16):
        heading = odometry[1, 2] + math.radians(turn)
        cos, sin = math.cos(heading), math.sin(heading)
        ends = np.floor(after @ [[cos, sin], [-sin, cos]] / 0.05 + at).astype(int) + 60
        for i in range(-24, 25):
            for j in range(-24, 25):
                scores[i, j, turn] = score[ends[:, 0] + i, ends[:, 1] + j].mean()
    best = max(scores, key=scores.get)
    assert steps.scores[0] == pytest.approx(scores[best], abs=0.02)
    offset = (steps.measured - steps.reported)[0]
    assert np.abs(offset[:2] - 0.05 * np.array(best[:2])).max() < 0.051
    assert math.degrees(offset[2]) == pytest.approx(best[2], abs=1)
    own = max(scores[i, j, t] for i, j, t in scores if abs(i) + abs(j) <= 1)
    assert steps.gains[0] == pytest.approx(scores[best] - own, abs=0.03)
    assert steps.is_contradicted_by_scans.tolist() == [True]
    true = compute_motions(*line)
    assert np.abs(steps.measured[0] - true)[:2].max() < 0.06
    assert abs(wrap_angles(steps.measured[0, 2] - true[2])) < math.radians(1.5)


def test_wean2_has_no_faults_of_odometry():
    folder = SHARED_DATA / "drives"
    if not folder.is_dir():
        pytest.skip("the dense recordings (../shared/data/drives) are not here")
    drive = read_recording(folder / "wean2.log.gz")
    faults = find_recording_faults(drive, load_map(folder / "wean2.yaml"))
    assert faults.is_sound
    assert faults.disagreements == ()
    assert faults.misfit.length < 1
    assert faults.n_hidden_steps < 0.3 * faults.n_steps
