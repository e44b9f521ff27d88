"""AMCL's settings tuned on stretches of a recorded drive."""

from __future__ import annotations

import dataclasses
import json
import math

import numpy as np
import pytest
from made_drives import recorded

from locplan import Costmap, plan, save_map
from locplan.cli import main
from locplan.errors import RecordingError
from locplan.maps import environments, own_axes
from locplan.recordings import replay, tune_on_drive
from locplan.recordings._tracks import Tracks
from locplan.robots import Amcl, Disturbances, Robot, read_amcl
from locplan.simulation import TuningBench, poses_along, tuning_figure

FEW = {"min_particles": 60, "max_particles": 120}
POOR = Amcl(**FEW, alpha1=1.0, alpha2=1.0, alpha3=1.0, alpha4=1.0)


@pytest.fixture(scope="module")
def grid():
    return environments.make("two_corridors", resolution=0.1)


@pytest.fixture(scope="module")
def drive(grid):
    """A drive of 34 m, with a scan every 0.1 m."""
    costs = Costmap.blank(grid, robot=0.3)
    path = plan(costs, (2.0, 3.0), (36.0, 3.0)).path
    return recorded(grid, poses_along(path, grid)[::2])


@pytest.fixture(scope="module")
def tuned(grid, drive):
    return tune_on_drive(drive, grid, robot=Robot(filter=POOR), drives=2)


STILL = Amcl(min_particles=20, max_particles=20, alpha1=0.0, alpha2=0.0, alpha3=0.0, alpha4=0.0)


@pytest.fixture(scope="module")
def benches(grid, drive):
    """The benches of a search and of its judgement, each with the poses of its stretches."""
    seen, made = [], TuningBench.__post_init__

    def noted(self):
        seen.append((self, self.lines))
        made(self)

    robot = Robot(filter=STILL, disturbances=Disturbances(start_sigma=0.0, start_sigma_deg=0.0))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(TuningBench, "__post_init__", noted)
        tune_on_drive(drive, grid, robot, drives=2)
    return seen


def test_stretches_are_the_whole_drive_in_equal_parts(benches, grid, drive):
    (_, search), (_, judge) = benches
    *early, first_half = search  # all of the half that is searched on is one path more
    np.testing.assert_array_equal(np.concatenate(early), first_half)
    stretches = [*early, *judge]
    assert len(stretches) == 10  # the first half to search on, the other to judge by
    np.testing.assert_allclose(np.concatenate(stretches), own_axes(grid, drive.poses))
    lengths = [float(np.hypot(*np.diff(each[:, :2], axis=0).T).sum()) for each in stretches]
    assert {round(each, 1) for each in lengths} <= {3.3, 3.4}


def test_a_drive_on_the_bench_is_the_replay_of_its_stretch(benches, grid, drive):
    bench, lines = benches[1]
    # Without noise all particles are one, whatever the random numbers.
    robot = Robot(filter=STILL, disturbances=Disturbances(start_sigma=0.0, start_sigma_deg=0.0))
    begin = len(benches[0][1][-1])
    stretch = drive[begin : begin + len(lines[0])]
    expected = replay(stretch, grid, robot, runs=2).drives.mean_squares[0]
    bench.drive([STILL], 1, 2)
    assert bench.driven[STILL].squares[:, :1] == pytest.approx(np.full((1, 1, 2), expected))
    assert bench.lengths[0] == pytest.approx(stretch.length)
    other = Amcl(**FEW)
    bench.drive([other], 1, 2)
    # Every replay has random numbers of its own.
    assert np.ptp(bench.driven[other].squares[:, 0]) > 0
    assert np.ptp(bench.whole(other)[0].mean_squares) > 0


def test_a_stretch_is_tracked_as_a_drive_of_its_own(grid, drive):
    stretch, amcl = slice(100, 140), Amcl(**FEW)

    def tracked(tracks, part):
        random, own = np.random.default_rng(4), tracks.arguments(Robot(filter=amcl))
        return tracks.track(random, tracks.ends(amcl), own, part)

    errors, covariances = tracked(Tracks(drive, grid), stretch)
    alone = tracked(Tracks(drive[stretch], grid), slice(None))
    assert errors == pytest.approx(alone[0], abs=1e-9)
    assert covariances == pytest.approx(alone[1], abs=1e-9, nan_ok=True)


def test_poor_settings_are_bettered_on_stretches_that_nothing_was_chosen_on(tuned):
    assert tuned.own == POOR
    assert tuned.changes
    assert tuned.winner.alpha2 < 1.0
    assert tuned.found.rmse_ratio.high < 1
    assert [level.name for level in tuned.levels] == ["recorded"]
    assert tuned.paths == 5


def test_reports_speak_of_the_drive(tuned):
    text = tuned.report()
    assert "on 5 stretches of the drive, 2 replays each" in text
    assert "random paths" not in text
    assert "on the whole drive" in tuned.conclusion
    assert "lost on 0% of the way; your settings: " in tuned.conclusion
    about = tuned.summary()
    assert (about["drive"], about["levels"]) == ("the drive", None)
    json.dumps(about, allow_nan=False)
    figure = tuning_figure(tuned)
    assert "5 stretches of the drive, 2 replays each" in figure.get_suptitle().replace("\n", " ")


def test_the_whole_drive_is_replayed_from_its_beginning(tuned, grid, drive):
    whole, own = tuned.found.whole, tuned.judged[0].whole
    assert whole.rmse.value < 0.2 < own.rmse.value
    assert (whole.lost_way.value, whole.first_loss) == (0.0, math.inf)
    runs = replay(drive, grid, Robot(filter=POOR), runs=8).drives
    assert own.lost_way.value > 0.1
    assert own.first_loss == pytest.approx(runs.first_loss, rel=1.0)
    assert own.rmse_ratio.value == 1


def test_what_fails_on_the_whole_drive_is_refused(tuned, tmp_path):
    """However well it does on the stretches."""
    interval = type(tuned.found.rmse_ratio)
    worse = [{"rmse_ratio": interval(1.2, 0.9, 1.5)}, {"lost_way_difference": 0.02}]
    worse.append({"lost_difference": 0.5})  # a replay more, if only for a scan
    for change in worse:
        whole = dataclasses.replace(tuned.found.whole, **change)
        found = dataclasses.replace(tuned.found, whole=whole)
        judged = tuple(found if each is tuned.found else each for each in tuned.judged)
        refused = dataclasses.replace(tuned, judged=judged)
        assert refused.changes == {}
        assert refused.conclusion.startswith("nothing that was tried holds on your drive: keep ")
        assert "locplan calibrate --drive" in refused.conclusion
        assert "locplan simulate" not in refused.conclusion  # which sends to tune --drive
        refused.save(tmp_path / "out")
        assert read_amcl(tmp_path / "out" / "nav2_params.yaml") == POOR


def test_drives_that_nothing_can_be_tuned_on_are_refused(grid, drive):
    with pytest.raises(RecordingError, match="tuning needs 30 m at least"):
        tune_on_drive(drive[:100], grid)
    with pytest.raises(RecordingError, match="no odometry"):
        tune_on_drive(dataclasses.replace(drive, odometry=None), grid)
    with pytest.raises(RecordingError, match="too sparse to tune on"):
        tune_on_drive(drive.every(20), grid)


def test_sparse_scans_are_a_warning(grid, drive):
    own = Amcl(min_particles=20, max_particles=20)
    tuned = tune_on_drive(drive.every(5), grid, robot=Robot(filter=own), drives=2)
    assert "every 0.5 m for lack of scans" in tuned.notes[0]
    assert tuned.report().startswith("note: the filter updated every 0.5 m")


def test_the_command_writes_tuned_parameters(tmp_path, grid, drive, monkeypatch, capsys):
    save_map(grid, tmp_path / "map.yaml")
    drive.save(tmp_path / "drive.npz")
    few = ["--set", "min_particles=20", "--set", "max_particles=40", "--drives", "2"]
    command = ["tune", tmp_path / "map.yaml", "--drive", tmp_path / "drive.npz", *few]

    def run(*more):
        monkeypatch.setattr("sys.argv", ["locplan", *map(str, command), *map(str, more)])
        with pytest.raises(SystemExit) as ended:
            main()
        return ended.value.code, capsys.readouterr()

    code, said = run("-o", tmp_path / "tuned")
    assert code == 0, said.err
    assert "on 5 stretches of " in said.out
    assert read_amcl(tmp_path / "tuned" / "nav2_params.yaml").max_particles == 40
    for more, fault in ((["--paths", "8"], "--paths"), (["--set", "range=5"], "--set range")):
        code, said = run(*more)
        assert code == 2
        assert f"{fault} is not read with --drive" in said.err
