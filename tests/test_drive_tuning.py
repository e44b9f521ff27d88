"""Presets of AMCL that compete on one half of a recorded drive, and are judged on the other."""

from __future__ import annotations

import dataclasses
import json

import numpy as np
import pytest
from made_drives import recorded

from locplan import Costmap, plan, save_map
from locplan.cli import main
from locplan.errors import ConfigError, RecordingError
from locplan.maps import environments
from locplan.recordings import replay, split_drive, tune_on_drive
from locplan.recordings._tracks import Tracks
from locplan.robots import Amcl, Robot, read_amcl
from locplan.simulation import poses_along, tuning_figure

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


def test_stretches_are_the_whole_drive_in_equal_parts(drive):
    stretches = split_drive(drive)
    assert len(stretches) == 10
    scans = np.concatenate([np.arange(len(drive))[part] for part in stretches])
    np.testing.assert_array_equal(scans, np.arange(len(drive)))
    lengths = [drive[part].length for part in stretches]
    assert {round(length, 1) for length in lengths} <= {3.2, 3.3, 3.4}


def test_a_stretch_is_tracked_as_a_drive_of_its_own(grid, drive):
    stretch, amcl = slice(100, 140), Amcl(**FEW)

    def tracked(tracks, part):
        random, own = np.random.default_rng(4), tracks.arguments(Robot(filter=amcl))
        return tracks.track(random, tracks.ends(amcl), own, part)

    errors, covariances = tracked(Tracks(drive, grid), stretch)
    alone = tracked(Tracks(drive[stretch], grid), slice(None))
    assert errors == pytest.approx(alone[0], abs=1e-9)
    assert covariances == pytest.approx(alone[1], abs=1e-9, nan_ok=True)


def test_poor_settings_are_bettered_on_the_recording(tuned):
    assert tuned.own == POOR
    assert tuned.changes
    assert tuned.winner.alpha2 < 1.0
    assert tuned.candidate_verdict.ratio.high < 1
    assert [case.name for case in tuned.cases] == ["second half", "whole drive"]
    assert [case.decides for case in tuned.cases] == [True, False]
    assert tuned.paths == 5


def test_reports_speak_of_the_recording(tuned):
    text = tuned.report()
    assert "2 replays of the whole of the drive" in text
    assert "random paths" not in text
    about = tuned.summary()
    assert about["recording"] == "the drive"
    json.dumps(about, allow_nan=False)
    title = tuning_figure(tuned).get_suptitle().replace("\n", " ")
    assert "5 stretches of the drive, 2 replays each" in title


def test_whole_drive_has_the_replays_of_simulate(tuned, grid, drive):
    """The same numbers give the same replays in both commands."""
    expected = replay(drive, grid, Robot(filter=POOR), runs=2).drives.typical_rmse
    assert tuned.cases[1].baseline_error.value == pytest.approx(expected.value)


def test_contradicting_whole_drive_keeps_the_settings(tuned, tmp_path):
    """However good a preset is on the stretches."""
    second, whole_drive = tuned.cases
    contradicted = (second, dataclasses.replace(whole_drive, contradicts=True))
    refused = dataclasses.replace(tuned, cases=contradicted)
    assert refused.changes == {}
    assert refused.conclusion.endswith("but not here: whole drive")
    assert "locplan calibrate --drive" in " ".join(refused.report().split())
    refused.save(tmp_path / "out")
    assert read_amcl(tmp_path / "out" / "nav2_params.yaml") == POOR


def test_several_recordings_are_judged_together(grid, drive):
    still = Amcl(min_particles=20, max_particles=20)
    result = tune_on_drive([drive, drive], grid, Robot(filter=still), drives=2)
    assert [case.name for case in result.cases] == [
        "the drive second half",
        "the drive whole drive",
        "the drive 2 second half",
        "the drive 2 whole drive",
    ]
    assert result.candidate_verdict.n_drives == 20
    assert result.recording == "the drive, the drive"
    with pytest.raises(ConfigError, match="2 drives need one map, or one for each"):
        tune_on_drive([drive, drive], [grid] * 3)


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
    assert "replays of the whole of" in said.out
    assert read_amcl(tmp_path / "tuned" / "nav2_params.yaml").max_particles == 40
    for more, fault in ((["--paths", "8"], "--paths"), (["--set", "range=5"], "--set range")):
        code, said = run(*more)
        assert code == 2
        assert f"{fault} is not read with --drive" in said.err
    command[1:2] = [tmp_path / "map.yaml"] * 3
    code, said = run("--drive", tmp_path / "drive.npz")
    assert code == 2
    assert "2 drives, 3 maps" in said.err
