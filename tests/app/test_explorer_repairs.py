"""Fields and costs that follow changes, against those computed from scratch."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from support.explorer_sessions import SAD, SMALL, ask, ask_plan, free_places, open_session, rooms

import locplan
from locplan.app.explorer.scene import SceneLimits, StartSettings
from locplan.app.explorer.session import Session
from locplan.field import FieldConfig
from locplan.maps import FREE, OccupancyGrid

SLOW = SceneLimits(min_points=5, first_seconds=0.0)
"""Limits with which a repair takes many steps."""


def draw(kind: str, points, width: float) -> dict:
    return {"kind": kind, "points": points, "width": width}


def watch(session: Session) -> list:
    """Return a list that collects the scenes of a session."""
    scenes = []
    session.listeners.append(lambda event: scenes.append(session.scene))
    return scenes


def check_scene(session: Session, config: FieldConfig = SAD) -> None:
    """Compare field and costs with those of the library."""
    session.wait()
    scene = session.scene
    assert scene.is_field_complete
    field = locplan.covariance_field(session.grid, config)
    np.testing.assert_array_equal(scene.field.covariance, field.covariance)
    costs = locplan.Costmap.from_field(field, robot=scene.site.robot, zones=scene.site.zones)
    for name in ("density", "u", "e"):
        np.testing.assert_array_equal(getattr(scene.costs, name), getattr(costs, name))
    assert scene.costs.grid.digest == session.grid.digest


@pytest.mark.parametrize("kind", ["wall", "erase", "pole"])
def test_repaired_scene_equals_computed_scene(kind):
    session = open_session(rooms(5), limits=SLOW)
    (x, y), *_ = free_places(session, 1)
    scenes = watch(session)
    points = [[x, y], [x + 1, y + 1]] if kind == "wall" else [[x, y]]
    ask(session, "change", changes=[draw(kind, points, 4.0 if kind == "erase" else 0.6)])
    check_scene(session)
    assert any(not scene.is_field_complete for scene in scenes)
    assert not any(scene.field.is_interpolated.any() for scene in scenes)
    assert len({scene.digest for scene in scenes if scene.site is session.scene.site}) > 2


@pytest.mark.parametrize("kind", ["Fisher", "Scan", "Fused"])
def test_repaired_ray_field_equals_computed_field(kind):
    config = FieldConfig(getattr(locplan, kind)(locplan.Lidar(range=2.0, beams=36)), stride=0.6)
    session = open_session(
        rooms(5, yaw=0.4), config, limits=SceneLimits(min_points=30, first_seconds=0)
    )
    scenes = watch(session)
    ask(session, "change", changes=[draw("pole", free_places(session, 1), 0.5)])
    check_scene(session, config)
    assert any(not scene.is_field_complete for scene in scenes)


def test_repair_ends_with_latest_changes():
    session, changes = open_session(rooms(6), limits=SLOW), []
    for n, xy in enumerate(free_places(session, 6)):
        changes.append(draw("pole", [xy], 0.3))
        if n % 3 == 2:
            changes = changes[:-1]
        if n == 4:
            x, y = xy
            square = [[x, y], [x + 1, y], [x + 1, y + 1]]
            changes.append({"kind": "zone", "zone": "prefer", "polygon": square})
        ask(session, "change", changes=changes)
    check_scene(session)


def test_undo_restores_basis_and_field():
    session = open_session(rooms(4))
    start, goal = free_places(session, 2)
    bases, fields, changes = [session.scene.basis], [session.field], []
    for k in range(3):
        changes.append(draw("wall", [start, goal], 0.2 + 0.2 * k))
        ask(session, "change", changes=changes)
        session.wait()
        bases.append(session.scene.basis)
        fields.append(session.field)
    assert len({basis["field"] for basis in bases}) == 4
    for k in (2, 1, 0, 1, 2, 3):
        basis = ask(session, "change", changes=changes[:k])["basis"]
        assert {**basis, "route": None} == {**bases[k], "route": None}
        assert session.field is fields[k]


@pytest.mark.parametrize("limit", [200e6, 0])
def test_undone_lidar_restores_basis(limit, tmp_path):
    limits = SceneLimits(scene_bytes=limit)
    session = open_session(rooms(4), cache_dir=tmp_path, limits=limits)
    before = session.scene.basis
    answer = ask(session, "change", changes=[{"kind": "lidar", "lidar": "lds-01", "range": 2.0}])
    assert answer["basis"]["robot"] != before["robot"]
    assert answer["basis"]["field"] is None
    check_scene(session, session.scene.site.config)
    basis = ask(session, "change", changes=[])["basis"]
    assert (basis["field"] == before["field"]) == (limit > 0)
    session.wait()
    assert session.scene.basis == before


def test_zone_change_keeps_field():
    session = open_session(rooms(4))
    field, (x, y) = session.scene.digest, free_places(session, 1)[0]
    square = [[x, y], [x + 1, y], [x + 1, y + 1]]
    for zone in ("no-go", "slow", "prefer"):
        changes = [{"kind": "zone", "zone": zone, "polygon": square, "percent": None}]
        basis = ask(session, "change", changes=changes)["basis"]
        assert basis["field"] == field
        check_scene(session)
    assert session.scene.costs.density.min() >= 1


def test_points_nearest_to_change_come_first():
    grid = OccupancyGrid(np.pad(np.full((60, 90), FREE), 4), 0.1)
    session = open_session(grid, limits=SceneLimits(min_points=8, first_seconds=0.0))
    fields = [session.field]
    session.listeners.append(lambda event: fields.append(session.field))
    ask(session, "change", changes=[draw("pole", [[3.0, 3.0]], 0.3)])
    session.wait()
    centre, bounds = np.array(grid.cell((3.0, 3.0))) / SAD.stride * 0.1, []
    for before, after in itertools.pairwise(fields):
        new = (before.covariance != after.covariance).any(axis=(-1, -2))
        new = new.any(axis=-1) if new.ndim > 2 else new
        if (new & before.is_evaluated).any():
            distance = np.hypot(*(np.argwhere(new & before.is_evaluated) - centre).T)
            bounds.append((distance.min(), distance.max()))
    assert len(bounds) > 2
    for (_, farthest), (nearest, _) in itertools.pairwise(bounds):
        assert nearest > farthest - 1.5  # distances are within a few per cent, and from cells


def test_shortest_path_follows_changes_without_field(monkeypatch):
    session = Session(rooms(), StartSettings(SAD, SMALL))
    monkeypatch.setattr(
        "locplan.app.explorer.session.compute_scene", lambda site, *_: session.scene
    )
    start, goal = free_places(session, 2, seed=3)
    before = ask_plan(session, [start, goal], 4.0)["shortest"]
    middle = before["xy"][len(before["xy"]) // 2]
    x, y = np.mean([start, goal], axis=0).tolist()
    ask(session, "change", changes=[draw("pole", [middle], 0.6), draw("pole", [[x, y]], 0.6)])
    assert session.grid.digest != session.original.grid.digest
    assert ask_plan(session, [start, goal], 4.0)["shortest"]["length"] > before["length"]
