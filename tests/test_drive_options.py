"""The options that read a recorded drive."""

import numpy as np
import pytest
from conftest import drawn, refused

import locplan
from locplan import Lidar
from locplan.cli._options import DriveOptions, move
from locplan.cli._types import two_numbers
from locplan.errors import ConfigError
from locplan.recordings import Recording

RANGES = np.array([[1.0, 2.0, 3.0], [1.5, 2.5, 3.5], [2.0, 3.0, 4.0]])


@pytest.fixture
def drive_file(tmp_path):
    file = tmp_path / "drive.npz"
    poses = [[0.0, 1.0, 0.0], [1.0, 1.0, 0.5], [2.0, 1.0, 1.0]]
    Recording(RANGES, Lidar(range=10.0, beams=3), poses).save(file)
    return file


def test_a_drive_is_read_as_it_was_saved(drive_file):
    drive = DriveOptions(drive=drive_file).read()
    np.testing.assert_allclose(drive.ranges, RANGES)


def test_every_nth_scan_is_read(drive_file):
    assert len(DriveOptions(drive=drive_file, every=2).read()) == 2


def test_limits_mount_and_alignment_are_texts_of_numbers_and_degrees(drive_file):
    drive = DriveOptions(
        drive=drive_file,
        range_limits=two_numbers("--range-limits", "1.2,3.2"),
        mount=move("--mount", "-0.1,0.2,90"),
        align=move("--align", "1,2,90"),
    ).read()
    assert np.isfinite(drive.ranges).sum() == 6
    assert (drive.lidar.mount_x, drive.lidar.mount_y) == (-0.1, 0.2)
    assert drive.lidar.mount_yaw_deg == pytest.approx(90.0)
    np.testing.assert_allclose(drive.poses[1], [0.0, 3.0, 0.5 + np.pi / 2], atol=1e-12)


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ("--mount=1,2", "--mount must be 3 numbers"),
        ("--align=a,b,c", "--align must be 3 numbers"),
        ("--range-limits=1", "--range-limits must be 2 numbers"),
        ("--range-limits=3,2", "--range-limits must be a least and a greatest"),
        ("--pose-topic=/pose", "--pose-topic is for bags"),
    ],
)
def test_wrong_options_are_one_clear_line(run, tmp_path, drive_file, given, said):
    locplan.save_map(drawn("....", "....", resolution=1.0), tmp_path / "bay.yaml")
    ask = "locate", tmp_path / "bay.yaml", "--drive", drive_file, given
    assert said in refused(run(*ask))


def test_options_of_a_drive_are_refused_without_one():
    with pytest.raises(ConfigError, match="--every is not read without --drive"):
        DriveOptions(every=2).check_drive()
    DriveOptions().check_drive()
    with pytest.raises(ConfigError, match="name a recorded drive"):
        DriveOptions().read()
