"""Presets of AMCL that are replayed over a whole recorded drive."""

from __future__ import annotations

import dataclasses
import json

import pytest
from support.recordings import simulate_recording

from locplan import Costmap, plan, save_map
from locplan.advice.preset_choice import OWN
from locplan.advice.tuning import tune_on_drive
from locplan.app.cli import main
from locplan.errors import ConfigError, RecordingError
from locplan.maps import environments
from locplan.recordings import replay
from locplan.robots import PRECISE, Amcl, Robot
from locplan.robots.nav2 import read_amcl
from locplan.simulation.worlds import poses_along

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
    return simulate_recording(grid, poses_along(path, grid)[::2])


@pytest.fixture(scope="module")
def tuned(grid, drive):
    return tune_on_drive(drive, grid, robot=Robot(filter=POOR), drives=2)


def test_poor_settings_are_bettered_on_recording(tuned):
    assert tuned.robot.amcl == POOR
    assert tuned.choice.name == PRECISE
    assert tuned.winner.alpha2 == 0.05
    cases = {(row.settings, row.case) for row in tuned.choice.results}
    assert {(OWN, "usual"), (PRECISE, "usual"), (OWN, "the drive"), (PRECISE, "the drive")} <= cases
    assert {case for _, case in cases} == {"usual", "the drive"}


def test_report_shows_recording(tuned):
    text = " ".join(tuned.report().split())
    assert text.startswith("note: the drive: The scans cannot show motion along corridors")
    assert "on the drive, " in tuned.conclusion
    assert "2 runs over the whole drive (seed 1)" in text
    assert "precise: alphas 0.05, likelihood_field_prob. safe: update_min_d 0.1" in text
    verdicts = {(row.settings, row.case): row.verdict for row in tuned.choice.results}
    assert verdicts[OWN, "the drive"] == "baseline"
    assert verdicts[PRECISE, "the drive"] == "confirmed"
    about = tuned.summary()
    assert about["recording"] == "the drive"
    json.dumps(about, allow_nan=False)


def test_recording_has_the_replays_of_simulate(tuned, grid, drive):
    """The same numbers give the same replays in both commands."""
    expected = replay(drive, grid, Robot(filter=POOR), runs=2).drives
    (row,) = (row for row in tuned.choice.results if (row.settings, row.case) == (OWN, "the drive"))
    assert row.error.value == pytest.approx(expected.rmse.value)
    assert row.lost.value == expected.lost.mean()


def test_settings_that_fail_on_recording_are_kept(tuned, tmp_path):
    kept = dataclasses.replace(tuned.choice, name=OWN, objections={PRECISE: "runs end lost"})
    refused = dataclasses.replace(tuned, choice=kept)
    assert refused.changes == {}
    assert refused.conclusion == "Keep your settings: runs end lost"
    assert "locplan recording FILE MAP" in " ".join(refused.report().split())
    refused.save(tmp_path / "out")
    assert read_amcl(tmp_path / "out" / "nav2_params.yaml") == POOR


def test_several_recordings_are_judged_together(grid, drive):
    still = Amcl(min_particles=20, max_particles=20)
    result = tune_on_drive([drive, drive], grid, Robot(filter=still), drives=2)
    assert result.choice.recordings == ("the drive", "the drive 2")
    assert result.recording == "the drive, the drive 2"
    with pytest.raises(ConfigError, match="2 drives need one map, or one for each"):
        tune_on_drive([drive, drive], [grid] * 3)


def test_drives_that_nothing_can_be_tuned_on_are_refused(grid, drive):
    with pytest.raises(RecordingError, match="too short to judge settings by"):
        tune_on_drive(drive[:100], grid)
    with pytest.raises(RecordingError, match="no odometry"):
        tune_on_drive(dataclasses.replace(drive, odometry=None), grid)


@pytest.mark.long
def test_sparse_scans_are_a_warning(grid, drive):
    own = Amcl(min_particles=20, max_particles=20)
    tuned = tune_on_drive(drive.every(5), grid, robot=Robot(filter=own), drives=2)
    assert "every 0.5 m for lack of scans" in tuned.notes[0]
    assert tuned.report().startswith("note: the filter updated every 0.5 m")


def test_the_command_writes_tuned_parameters(tmp_path, grid, drive, monkeypatch, capsys):
    save_map(grid, tmp_path / "map.yaml")
    drive.save(tmp_path / "drive.npz")
    few = ["--set", "min_particles=20", "--set", "max_particles=40", "--drives", "2"]
    command = ["tune", tmp_path / "map.yaml", "--recording", tmp_path / "drive.npz", *few]

    def run(*more):
        monkeypatch.setattr("sys.argv", ["locplan", *map(str, command), *map(str, more)])
        with pytest.raises(SystemExit) as ended:
            main()
        return ended.value.code, capsys.readouterr()

    code, said = run("-o", tmp_path / "tuned")
    assert code == 0, said.err
    assert "The recording decides" in said.out
    assert read_amcl(tmp_path / "tuned" / "nav2_params.yaml").max_particles == 40
    for more, fault in ((["--paths", "8"], "--paths"), (["--set", "range=5"], "--set range")):
        code, said = run(*more)
        assert code == 2
        assert f"{fault} is not read with --recording" in said.err
    command[1:2] = [tmp_path / "map.yaml"] * 3
    code, said = run("--recording", tmp_path / "drive.npz")
    assert code == 2
    assert "2 recordings, 3 maps" in said.err
