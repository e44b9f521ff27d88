"""Recorded scans matched with a map, and what fields predict along a drive."""

from __future__ import annotations

import csv
import dataclasses
import math

import numpy as np
import pytest
from matplotlib.collections import LineCollection
from scipy.stats import spearmanr
from support import oracles
from support.machine import SHARED_DATA
from support.small_drive import FILE, MAP

from locplan import Lidar, Scan, load_map
from locplan._support.kernels import likelihood, posterior
from locplan._support.kernels.likelihood import TOP, make_scan_lattice
from locplan.errors import ConfigError, RecordingError
from locplan.field import SearchWindow
from locplan.maps import FREE, OCCUPIED, OccupancyGrid
from locplan.recordings import DriveEvaluation, Recording, evaluate_drive
from locplan.recordings.evaluation import ScanMatches, match_scans
from locplan.recordings.figures import drive_figure
from locplan.recordings.kernels.matches import write_recorded_posteriors

CARMEN = SHARED_DATA / "carmen"


@pytest.fixture(scope="module")
def office():
    return load_map(MAP)


@pytest.fixture(scope="module")
def drive():
    return Recording.load(FILE)


@pytest.fixture(scope="module")
def evaluation(office, drive):
    return evaluate_drive(drive.subsample(6), office)


def test_scan_posteriors_equal_plain_loops():
    random = np.random.default_rng(3)
    levels = np.full((24, 30), FREE, np.uint8)
    levels[random.random(levels.shape) < 0.06] = OCCUPIED
    resolution, share, beams = 0.1, 6.0 / 14, 14
    searched = SearchWindow(half_width=0.3, step=0.1, half_rotation_deg=8.0, rotation_step_deg=4.0)
    window = searched.to_lattice(resolution)
    field = Scan(Lidar(), window=searched).prepare(levels, resolution).likelihood
    cells = np.array([[10, 12], [4, 20], [15, 6]])
    ends = random.uniform(-6, 6, (3, beams, 2))
    ends[random.random(ends.shape[:2]) < 0.2] = np.nan
    mean, covariance = np.empty((3, 3)), np.empty((3, 3, 3))
    best, summary = np.empty((3, 3), np.int64), np.empty((3, 3))
    lattice = make_scan_lattice(window.half_steps, window.angles)
    write_recorded_posteriors(field, lattice, cells, ends, share, mean, covariance, best, summary)
    table = likelihood.tabulate_costs(resolution, 0.1, 0.05)
    nats = -math.log(0.05) / TOP
    expected = oracles.scan.recorded_posteriors(
        *(levels, cells, ends, window.step_cells, window.half_steps, window.angles),
        lambda squared: nats * table[int(min(squared, table.size - 1))],
        share,
        -math.log(posterior.CONNECTED),
    )
    for n, (m, c, b, entropy, ambiguity, score) in enumerate(expected):
        np.testing.assert_allclose(mean[n], m, atol=1e-6)
        np.testing.assert_allclose(covariance[n], c, atol=1e-6)
        assert tuple(best[n]) == b
        np.testing.assert_allclose(summary[n], (entropy, ambiguity, score), atol=1e-6)


def test_scan_matches_lie_at_true_poses(office, drive):
    matches = match_scans(drive.subsample(10), office)
    assert matches.is_matched.all()
    distance = np.hypot(*matches.best[:, :2].T)
    assert np.median(distance) <= 0.1
    assert (distance < 3 * np.maximum(matches.position_std, 0.1)).mean() > 0.9
    assert np.degrees(np.abs(matches.best[:, 2])).max() <= 2
    with pytest.raises(RecordingError, match="no scan on this map has enough returns"):
        match_scans(drive.subsample(50).move(500.0, 0.0, 0.0), office)


@pytest.mark.parametrize("yaw", [math.pi / 2, -0.7])
def test_posterior_rotates_with_world(office, drive, yaw):
    few = drive.subsample(40)
    plain = match_scans(few, office)
    turned_grid = OccupancyGrid(
        office.cells, office.resolution, (*_turned(office.origin, yaw), yaw)
    )
    turned = match_scans(few.move(0.0, 0.0, yaw), turned_grid)
    cos, sin = math.cos(yaw), math.sin(yaw)
    turn = np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1.0]])
    np.testing.assert_allclose(turned.covariance, turn @ plain.covariance @ turn.T, atol=2e-3)
    np.testing.assert_allclose(turned.position_std, plain.position_std, rtol=0.1, atol=0.01)


def _turned(origin, yaw):
    x, y, _ = origin
    return math.cos(yaw) * x - math.sin(yaw) * y, math.sin(yaw) * x + math.cos(yaw) * y


def test_corridor_match_is_uncertain_along_axis():
    cells = np.full((60, 400), FREE, np.uint8)
    cells[:10] = cells[-10:] = OCCUPIED
    grid = OccupancyGrid(cells, 0.05)
    lidar = Lidar(range=5.0, beams=90)
    bearings = lidar.angles
    ranges = np.minimum(1.0 / np.maximum(np.abs(np.sin(bearings)), 1e-9), 99.0)
    matches = match_scans(Recording(ranges[None], lidar, [[10.0, 1.5, 0.0]]), grid)
    assert matches.position_std[0] > 0.8
    assert abs(math.sin(matches.direction[0])) < 0.02
    assert matches.score[0] > -0.1


def test_fields_predict_uncertainty_of_scans(evaluation):
    assert evaluation.is_compared.sum() > 50
    for name in ("fisher", "scan", "fused"):
        each = evaluation.agreements[name]
        assert each.rank.spearman.value > 0.5
        assert each.rank.spearman.low < each.rank.spearman.value < each.rank.spearman.high
        assert 0.5 < each.factor.value < 2.0
        assert each.aligned.value > 0.8
    first, second = evaluation.verdict
    assert first.startswith("On this drive, `fused` predicts where scans leave the pose uncertain")
    assert second.endswith(".")


def test_evaluation_excludes_crowded_scans(office, drive):
    """People around the robot are not on the map."""
    thinned = drive.subsample(8)
    ranges = thinned.ranges.copy()
    crowd = np.arange(len(ranges)) < 12
    ranges[np.ix_(crowd, np.arange(40, 110))] = 0.7  # people all around
    crowded = dataclasses.replace(thinned, ranges=ranges)
    plain, disturbed = (
        evaluate_drive(each, office, estimators={"scan": Scan(drive.lidar)})
        for each in (thinned, crowded)
    )
    assert not plain.is_outdated.any()
    np.testing.assert_array_equal(disturbed.is_outdated, crowd)
    assert "12 of" in disturbed.verdict[1]
    assert "do not match the map" in disturbed.verdict[1]
    assert disturbed.is_compared.sum() == plain.is_compared.sum() - 12
    on_map, on_way = (
        next(line.get_xydata() for line in axes.lines if line.get_marker() == "x")
        for axes in drive_figure(disturbed).axes[:2]
    )
    np.testing.assert_allclose(on_map[: crowd.sum()], thinned.poses[crowd, :2])
    along = np.cumsum(
        np.hypot(*np.diff(thinned.poses[:, :2], axis=0, prepend=thinned.poses[:1, :2]).T)
    )
    np.testing.assert_allclose(on_way[:, 0], along[crowd], atol=1e-6)


def test_evaluation_keeps_scattered_returns(office, drive):
    """On coarse cells, at long range and in plants many miss the walls, but few by far."""
    thinned = drive.subsample(8)
    ranges = thinned.ranges.copy()
    ranges[::4] += np.random.default_rng(2).normal(0.0, 0.17, ranges[::4].shape)
    scattered = dataclasses.replace(thinned, ranges=np.abs(ranges))
    evaluation = evaluate_drive(scattered, office, estimators={"scan": Scan(drive.lidar)})
    assert (evaluation.matches.score[::4] < -0.5).mean() > 0.8
    assert not evaluation.is_outdated.any()
    assert (evaluation.matches.stray_share < 1 / 6).all()


def test_intervals_resample_blocks_of_drive(evaluation):
    """Repeating each scan ten times keeps the intervals as wide; a short drive has none."""
    matches = evaluation.matches
    compared = np.flatnonzero(evaluation.is_compared)
    repeats = np.repeat(compared, 10)
    repeated = dataclasses.replace(
        evaluation,
        matches=dataclasses.replace(
            matches,
            recording=matches.recording[repeats],
            **{
                name: getattr(matches, name)[repeats]
                for name in (
                    "mean",
                    "best",
                    "covariance",
                    "ambiguity",
                    "entropy",
                    "score",
                    "n_returns",
                )
            },
        ),
        predicted={name: each[repeats] for name, each in evaluation.predicted.items()},
    )
    one, other = (each.agreements["scan"].factor for each in (evaluation, repeated))
    assert other.high - other.low == pytest.approx(one.high - one.low, rel=0.3)
    short = dataclasses.replace(evaluation)
    short.__dict__["blocks"] = np.arange(len(matches)) // 50 % 4
    assert math.isnan(short.agreements["scan"].factor.low)
    assert math.isnan(short.agreements["scan"].rank.auc.low)
    assert short.verdict[0].startswith("The drive is too short to evaluate fields")


def test_evaluation_rejects_unusable_drives(office, drive):
    with pytest.raises(RecordingError, match="the drive has only 8 scans; at least 10 are"):
        evaluate_drive(drive.subsample(50), office)
    with pytest.raises(RecordingError, match="no scan on this map has enough returns"):
        evaluate_drive(drive.subsample(25).move(0.0, 500.0, 0.0), office)
    with pytest.raises(ConfigError, match="recording must be a Recording"):
        evaluate_drive("drive.npz", office)


@pytest.mark.parametrize(
    ("blocks", "worst"),
    [
        ([0, 0, 0, 1, 2, 2, 2], 1),  # of one scan
        ([0, 0, 0, 1, 2, 3, 4], 4),  # most stretches have but one
    ],
)
def test_verdict_names_worst_block(blocks, worst):
    """Blocks with a single scan count as well."""
    stds = 0.1 * np.exp([0, 1, 2, 5.5, 4, 5, 6.0])
    scans = np.flatnonzero(np.array(blocks) == worst)
    text = f"are around {scans.mean():.1f},0.0:"
    assert text in make_evaluation(stds, np.zeros(7), blocks).verdict[1]


@pytest.mark.parametrize(
    ("directions", "axis"), [([179.0, 180.8, -0.3], 0), ([85.0, -89.0], 88), ([-45.0], 135)]
)
def test_verdict_wraps_axis_at_180_degrees(directions, axis):
    count = len(directions)
    one = make_evaluation(np.full(count, 0.5), np.radians(directions), [0] * count)
    assert f"along {axis}°" in one.verdict[1]


def make_evaluation(stds, directions, blocks):
    """An evaluation of scans 1 m apart with these deviations, in these blocks."""
    count, turns = len(stds), np.zeros((len(stds), 3, 3))
    turns[:, 2, 2] = 1.0
    turns[:, 0, 0] = turns[:, 1, 1] = np.cos(directions)
    turns[:, 1, 0], turns[:, 0, 1] = np.sin(directions), -np.sin(directions)
    own = np.zeros((count, 3, 3))
    own[:, 0, 0], own[:, 1, 1], own[:, 2, 2] = stds**2, (0.1 * stds) ** 2, 1e-4
    covariance = turns @ own @ turns.transpose(0, 2, 1)
    lidar, poses = Lidar(beams=12), np.column_stack([np.arange(count), *np.zeros((2, count))])
    evaluation = DriveEvaluation(
        ScanMatches(
            Recording(np.ones((count, 12)), lidar, poses),
            OccupancyGrid(np.full((9, 9), FREE, np.uint8), 0.1),
            Scan(lidar),
            *(np.zeros((count, 3)), np.zeros((count, 3)), covariance),
            *(np.zeros(count), np.zeros(count), np.zeros(count), np.full(count, 12)),
        ),
        {"scan": covariance},
        {"scan": "position_std"},
    )
    vars(evaluation)["blocks"] = np.array(blocks)
    return evaluation


def test_figure_shows_sparse_scans_as_dots(office, drive):
    sparse = evaluate_drive(drive.subsample(24), office, estimators={"scan": Scan(drive.lidar)})
    axes = drive_figure(sparse).axes[0]
    lines = [each for each in axes.collections if isinstance(each, LineCollection)][-1]
    ends = np.array([path.vertices for path in lines.get_paths()])
    np.testing.assert_allclose(ends[:, 0], sparse.matches.recording.poses[:, :2])
    assert np.hypot(*(ends[:, 1] - ends[:, 0]).T).max() < 0.01
    np.testing.assert_allclose(lines.get_array(), 100 * sparse.matches.position_std)


def test_evaluation_table_lists_all_scans(tmp_path, evaluation):
    assert set(evaluation.agreements) == {"sad", "fisher", "scan", "fused"}
    evaluation.table().write_csv(tmp_path / "scans.csv")
    with open(tmp_path / "scans.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == len(evaluation.matches)
    std = [float(row["major_std"]) for row in rows]
    np.testing.assert_allclose(std, evaluation.matches.position_std, rtol=1e-6)
    assert "rank" in evaluation.report()


def reference():
    return sorted(CARMEN.glob("localizability_*.csv"))


@pytest.mark.skipif(not CARMEN.exists(), reason="the recorded logs are not here")
def test_evaluation_reproduces_laser_reference():
    """Spearman with the reference's deviations, without the tenth of the scans that fit worst."""
    from locplan.recordings import read_recording

    ours, theirs = [], []
    for file in reference():
        name = file.stem.removeprefix("localizability_")
        with file.open(encoding="utf-8", newline="") as opened:
            rows = list(csv.DictReader(opened))
        column = {key: np.array([float(row[key]) for row in rows]) for key in rows[0]}
        grid = load_map(SHARED_DATA / "rosmaps_carmen" / f"{name}_even")
        limits = (0.05, 30.0 if name in ("intel", "orebro") else 40.0)
        drive = read_recording(CARMEN / f"{name}-corrected.log.gz", range_limits=limits)
        matches = match_scans(drive[column["scan"].astype(int)], grid)
        kept = column["score_per_beam"] >= np.quantile(column["score_per_beam"], 0.1)
        ours.append(matches.position_std[kept])
        theirs.append(column["sd_major"][kept])
        assert spearmanr(ours[-1], theirs[-1])[0] > 0.90, name
    assert len(ours) == 6
    assert spearmanr(np.concatenate(ours), np.concatenate(theirs))[0] > 0.96


def test_verdict_rejects_weak_field(evaluation):
    weak = dataclasses.replace(evaluation, predicted={"sad": evaluation.predicted["sad"]})
    assert weak.verdict[0].startswith("No field ranks the scans of this drive better than chance")
    mixed = evaluation.predicted["scan"].copy()
    some = np.arange(len(mixed)) % 5 < 4
    mixed[some] = mixed[some][::-1]
    little = dataclasses.replace(evaluation, predicted={"scan": mixed})
    assert little.agreements["scan"].rank.spearman.value < 0.5
    assert "only slightly better than chance" in little.verdict[0]


def test_verdict_counts_blocks_without_scans(evaluation):
    matches = dataclasses.replace(
        evaluation.matches, covariance=100 * evaluation.matches.covariance
    )
    vague = dataclasses.replace(evaluation, matches=matches)
    block_count = len(np.unique(evaluation.blocks))
    assert "have a standard deviation of" in vague.verdict[1]
    assert "have no compared scan" not in vague.verdict[1]
    unknown = evaluation.predicted["sad"].copy()
    unknown[np.isin(evaluation.blocks, np.unique(evaluation.blocks)[:2])] = np.nan
    partial = dataclasses.replace(vague, predicted=evaluation.predicted | {"sad": unknown})
    assert f"; 2 of {block_count} blocks of 10 m have no compared scan" in partial.verdict[1]


def test_verdict_suspects_mount_if_scans_misfit(evaluation):
    score = evaluation.matches.score.copy()
    score[::2] = -2.0
    bad = dataclasses.replace(
        evaluation, matches=dataclasses.replace(evaluation.matches, score=score)
    )
    assert "scans do not fit the map at their poses: check the mount of the lidar" in bad.verdict[0]
