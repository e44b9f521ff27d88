"""Settings for a fleet: tuned on several maps, or on several recorded drives."""

from __future__ import annotations

import json

import numpy as np
import pytest
from made_drives import recorded

from locplan import save_map
from locplan.costs import Path
from locplan.errors import ConfigError
from locplan.maps import environments
from locplan.recordings import Recording, tune_on_drive
from locplan.robots import Amcl, Lidar, Robot, read_amcl
from locplan.simulation import poses_along, tune, tuning_figure

FEW = Amcl(min_particles=30, max_particles=60)


@pytest.fixture(scope="module")
def grids():
    names = "two_corridors", "office"
    return [environments.make(name, resolution=0.1) for name in names]


@pytest.fixture(scope="module")
def drives(grids) -> list[Recording]:
    """Two drives of 34 m, with a scan every 0.1 m, there and back."""
    there = poses_along(Path([(2.0, 3.0), (36.0, 3.0)]), grids[0])[::2]
    back = poses_along(Path([(36.0, 3.0), (2.0, 3.0)]), grids[0])[::2]
    return [recorded(grids[0], line, seed=seed) for seed, line in enumerate((there, back))]


@pytest.mark.long
def test_settings_for_several_maps_are_judged_on_each(grids):
    robot = Robot(Lidar(range=6.0, beams=60), filter=FEW)
    found = tune(grids, robot, paths=5, drives=2, threads=2)
    names = [each.name for each in grids]
    assert found.grids == tuple(grids)
    assert [level.name for level in found.levels] == [
        f"{name} {level}" for name in names for level in ("x1/3", "x1", "x3")
    ]
    alone = tune(grids[1], robot, paths=5, drives=2, threads=2)
    own, own_alone = found.judged[0].levels[3:], alone.judged[0].levels
    for one, other in zip(own, own_alone, strict=True):  # the same paths and drives
        assert one.m == other.m
    assert found.judged[0].beyond.level.name in {f"{name} x10" for name in names}
    report = found.report()
    assert f"on 5 random paths of each of {', '.join(names)} (the worst by name)" in report
    assert found.judged[0].worst_at().level.name in report
    about = json.loads(json.dumps(found.summary(), allow_nan=False))
    assert [each["name"] for each in about["maps"]] == names
    assert "map" not in about
    assert "map" in alone.summary()
    tuning_figure(found)


@pytest.mark.long
def test_the_worst_of_several_drives_decides(grids, drives):
    poor = Amcl(min_particles=60, max_particles=120, alpha2=1.0, alpha3=1.0)
    found = tune_on_drive(drives, grids[0], Robot(filter=poor), drives=2)
    assert [level.name for level in found.levels] == ["the drive recorded", "the drive 2 recorded"]
    alone = [tune_on_drive(each, grids[0], Robot(filter=poor), drives=2) for each in drives]
    whole = found.judged[0].whole
    each_rmse = [each.judged[0].whole.rmse.value for each in alone]
    assert whole.rmse.value == pytest.approx(max(each_rmse))
    assert whole.name == ("the drive", "the drive 2")[int(np.argmax(each_rmse))]
    assert f"{whole.name}: {whole.rmse.value:.2g} m" in found.report()
    assert found.drive == "the drive, the drive"
    tuning_figure(found)


def test_drives_have_one_map_or_one_each(grids, drives):
    with pytest.raises(ConfigError, match="2 drives need one map, or one for each"):
        tune_on_drive(drives, [*grids, grids[0]])
    with pytest.raises(ConfigError, match="a filter's map is of one map, not of 2"):
        tune(grids, filter_map=grids[0])
    with pytest.raises(ConfigError, match="grid must be"):
        tune([])


def test_the_command_takes_several_maps_and_drives(tmp_path, grids, drives, run):
    for each in grids:
        save_map(each, tmp_path / f"{each.name}.yaml")
    maps = [tmp_path / f"{each.name}.yaml" for each in grids]
    files = [tmp_path / f"drive{n}.npz" for n in range(2)]
    for file, drive in zip(files, drives, strict=True):
        drive.save(file)
    few = ["--set", "min_particles=20", "--set", "max_particles=20", "--drives", 2]
    logs = [word for file in files for word in ("--drive", file)]
    code, out, err = run("tune", maps[0], *logs, *few, "-o", tmp_path / "tuned")
    assert code == 0, err
    assert "5 stretches of each of the drive, the drive (the worst by name)" in out
    assert read_amcl(tmp_path / "tuned" / "nav2_params.yaml").max_particles == 20
    code, _, err = run("tune", *maps, *logs, "--drive", files[0])
    assert code == 2
    assert "3 drives, 2 maps" in err
