"""Exports of the page, against those of the library."""

from __future__ import annotations

from pathlib import Path

import pytest
from support.explorer_sessions import MIDDLE, ROBOT, ROUTE, ask, corridors, open_corridors

from locplan.app.explorer.exports import make_map_file_name
from locplan.errors import ConfigError
from locplan.export import nav2_keepout
from locplan.maps import Zone, Zones, load_map
from locplan.planning import Costmap

BAND = [[15.0, 1.0], [25.0, 1.0], [25.0, 5.0], [15.0, 5.0]]


def export(
    folder, *, changes=(), force=False, parameter_files=(), progress=lambda *_: None, **values
):
    """Return the answer to an export after changes."""
    session = open_corridors(folder=folder, force=force, parameter_files=parameter_files)
    if changes:
        ask(session, "change", changes=list(changes))
        session.wait()
    try:
        return ask(session, "export", progress=progress, **(ROUTE | values))
    finally:
        session.close()


def test_export_equals_library_export(tmp_path):
    zones = Zones([Zone("no-go", BAND), Zone("slow", BAND, 30), Zone("prefer", BAND[:3])])
    changes = [
        {"kind": "zone", "zone": zone.kind, "polygon": zone.polygon.tolist(), "percent": 30}
        for zone in zones
    ]
    answer = export(tmp_path / "out", changes=changes, distro="kilted")
    assert "kilted" in " ".join(answer["warnings"])  # a fault of that distribution
    costs = Costmap.from_field(corridors()[1], weight=3.0, robot=ROBOT, zones=zones)
    with pytest.warns(UserWarning, match="kilted"):
        nav2_keepout(tmp_path / "expected", costs, distro="kilted")
    names = sorted(file.name for file in (tmp_path / "expected").iterdir())
    assert answer["files"] == names
    assert "zones.geojson" in names
    for name in names:
        ours = (tmp_path / "out" / "two_corridors-nav2" / name).read_bytes()
        assert ours == (tmp_path / "expected" / name).read_bytes(), name


def test_export_merges_nav2_parameters(tmp_path):
    file = tmp_path / "params.yaml"
    file.write_text("amcl: {ros__parameters: {max_beams: 77}}\n")
    export(tmp_path, parameter_files=(file,))
    exported = (tmp_path / "two_corridors-nav2" / "nav2.yaml").read_text()
    assert "max_beams: 77" in exported


def test_export_holds_edited_map(tmp_path):
    pole = {"kind": "pole", "points": [list(MIDDLE)], "width": 0.5}
    answer = export(tmp_path, changes=[pole])
    grid = load_map(tmp_path / "two_corridors-nav2" / "edited_map.yaml")
    assert "edited_map.yaml" in answer["files"]
    assert not grid.free[grid.cell(MIDDLE)]
    assert "edited_map.yaml" not in export(tmp_path)["files"]


def test_second_export_gets_number_unless_forced(tmp_path):
    (tmp_path / "two_corridors-nav2-2").symlink_to(tmp_path / "gone")
    folders = [export(tmp_path)["folder"] for _ in range(2)]
    assert [folder.rpartition("/")[2] for folder in folders] == [
        "two_corridors-nav2",
        "two_corridors-nav2-3",
    ]
    assert export(tmp_path, force=True)["folder"] == folders[0]


@pytest.mark.parametrize("name", ["../../etc", "a/b", "..", "", "naïve map", "x" * 500, "\ufffd"])
def test_map_name_becomes_safe_file_name(name):
    """An export named after the map stays in the output folder."""
    file_name = make_map_file_name(name)
    assert Path(file_name).name == file_name
    assert 0 < len(file_name) <= 80
    assert not file_name.startswith(".")


@pytest.mark.parametrize("wrong", [{"distro": "melodic"}, {"weight": -1}])
def test_refused_export_writes_nothing(tmp_path, wrong):
    with pytest.raises(ConfigError) as error:
        export(tmp_path / "out", **wrong)
    assert "\n" not in str(error.value)
    assert not (tmp_path / "out").exists()


def test_export_needs_output_folder():
    with pytest.raises(ConfigError, match="exports need an output folder"):
        export(None)
