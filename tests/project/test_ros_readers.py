"""Hand-computed values for the stack readers."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from support import ros_readers


def write(folder: Path, pixels: object, mode: str = "trinary", **keys: object) -> Path:
    array = np.atleast_2d(np.asarray(pixels, np.uint8))
    Image.fromarray(array).save(folder / "map.png")
    doc = {
        "image": "map.png",
        "resolution": 0.05,
        "origin": "[1.0, -2.0, 0.0]",
        "free_thresh": 0.2,
        "occupied_thresh": 0.6,
        "negate": 0,
        "mode": mode,
    } | keys
    (folder / "map.yaml").write_text("".join(f"{k}: {v}\n" for k, v in doc.items()))
    return folder / "map.yaml"


def test_flip_and_header(tmp_path: Path) -> None:
    grid = ros_readers.load(write(tmp_path, [[0, 10, 20], [30, 40, 50]], "raw"), "main")
    assert grid.data.tolist() == [[30, 40, 50], [0, 10, 20]]
    assert grid.resolution == 0.05000000074505806
    assert grid.origin == (1.0, -2.0, 0.0)


# occ = 1 - p/255: 206 -> 0.19216, 205 -> 0.19608, 89 -> 0.65098, 90 -> 0.64706
@pytest.mark.parametrize(
    ("stack", "expected"),
    [("main", [0, 100, -1]), ("humble", [-1, -1, -1]), ("ros1", [-1, -1, -1])],
)
def test_trinary_thresholds(tmp_path: Path, stack: str, expected: list[int]) -> None:
    path = write(tmp_path, [255, 0, 128], free_thresh=0.0, occupied_thresh=1.0)
    assert ros_readers.load(path, stack).data[0].tolist() == expected
    path = write(tmp_path, [206, 205, 89, 90], free_thresh=0.196, occupied_thresh=0.65)
    assert ros_readers.load(path, stack).data[0].tolist() == [0, -1, 100, -1]
    path = write(tmp_path, [205], free_thresh=0.25, occupied_thresh=0.65)
    assert ros_readers.load(path, stack).data[0, 0] == 0  # the unknown grey read as free


# (0.498039 - 0.2)/0.4 = 0.745098; (0.400000 - 0.2)/0.4 = 0.5 for p = 153
@pytest.mark.parametrize(
    ("stack", "expected"),
    [("main", [75, 50, 0, 100]), ("humble", [75, 50, 0, 100]), ("ros1", [74, 50, 0, 100])],
)
def test_scale(tmp_path: Path, stack: str, expected: list[int]) -> None:
    path = write(tmp_path, [128, 153, 255, 0], "scale")
    assert ros_readers.load(path, stack).data[0].tolist() == expected


def test_exported_scale_keeps_every_value(tmp_path: Path) -> None:
    values = np.arange(101)
    pixels = np.floor(255 * (1 - values / 100) + 0.5)
    path = write(tmp_path, pixels, "scale", free_thresh=0.0, occupied_thresh=1.0)
    assert np.array_equal(ros_readers.load(path, "main").data[0], values)
    assert np.array_equal(ros_readers.load(path, "humble").data[0], values)
    ros1 = ros_readers.load(path, "ros1").data[0]
    assert ros1[[0, 1, 50, 99, 100]].tolist() == [1, 2, 49, 97, 99]


def test_raw(tmp_path: Path) -> None:
    path = write(tmp_path, [0, 99, 100, 101, 200, 255], "raw", negate=1)
    for stack in ("main", "humble"):
        assert ros_readers.load(path, stack).data[0].tolist() == [0, 99, 100, -1, -1, -1]
    # ROS 1 inverts: 255, 156, 155, 154, 55, 0, and wraps to int8
    assert ros_readers.load(path, "ros1").data[0].tolist() == [-1, -100, -101, -102, 55, 0]


def test_alpha(tmp_path: Path) -> None:
    pixels = [[[0, 0, 0, 255], [0, 0, 0, 0], [128, 128, 128, 254]]]
    # means with alpha in trinary: 63.75 -> 0.75, 0 -> 1, 159.5 -> 0.3745
    trinary = {"main": [100, -1, -1], "humble": [100, 100, -1], "ros1": [100, 100, -1]}
    scale = {"main": [100, -1, -1], "humble": [100, -1, -1], "ros1": [100, 100, 74]}
    Image.fromarray(np.asarray(pixels, np.uint8)).save(tmp_path / "rgba.png")
    for stack, expected in trinary.items():
        path = write(tmp_path, [0], image="rgba.png")
        assert ros_readers.load(path, stack).data[0].tolist() == expected
        path = write(tmp_path, [0], "scale", image="rgba.png")
        assert ros_readers.load(path, stack).data[0].tolist() == scale[stack]


def test_refusals(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="mode"):
        ros_readers.load(write(tmp_path, [0], "grey"), "main")
    with pytest.raises(ValueError, match="origin"):
        ros_readers.load(write(tmp_path, [0], origin="[0.0, 0.0]"), "main")
    with pytest.raises(ValueError, match="negate"):
        ros_readers.load(write(tmp_path, [0], negate="false"), "ros1")
    assert ros_readers.load(write(tmp_path, [0], "RAW", negate="false"), "main").data[0, 0] == 0


def grid(rows: object, resolution: float = 1.0, x: float = 0.0, y: float = 0.0) -> ros_readers.Grid:
    return ros_readers.Grid(np.asarray(rows, np.int8), resolution, (x, y, 0.0))


def test_keepout_values() -> None:
    mask = grid([[-1, 0, 1, 50, 99, 100, 0]])
    costs = np.array([[7, 7, 0, 200, 252, 253, 255]], np.uint8)
    got = ros_readers.keepout(costs, mask, 1.0, (0.0, 0.0))
    assert got.tolist() == [[7, 7, 3, 200, 252, 254, 0]]  # unknown under mask 0 becomes free
    free = ros_readers.keepout(np.zeros((1, 7), np.uint8), mask, 1.0, (0.0, 0.0))
    assert free.tolist() == [[0, 0, 3, 127, 251, 254, 0]]
    out = ros_readers.keepout(np.zeros((1, 7), np.uint8), mask, 1.0, (0.0, 0.0), 254)
    assert out.tolist() == [[0, 0, 252, 252, 252, 252, 0]]


def test_keepout_geometry() -> None:
    costs = np.zeros((3, 4), np.uint8)
    # mask of 0.5 m cells over x 1..3, y 1..2: master centres 1.5, 2.5 fall in mask columns 1, 3
    mask = grid([[10, 20, 30, 40], [50, 60, 70, 80]], 0.5, 1.0, 1.0)
    got = ros_readers.keepout(costs, mask, 1.0, (0.0, 0.0))
    assert got.tolist() == [[0, 0, 0, 0], [0, 152, 203, 0], [0, 0, 0, 0]]
    # ends at x = 1.7: centre 1.5 is inside, but int(1.7 + 0.05) = 1 leaves that column out
    mask = grid(np.full((30, 17), 100), 0.1)
    got = ros_readers.keepout(costs, mask, 1.0, (0.0, 0.0))
    assert got.tolist() == [[254, 0, 0, 0]] * 3
    # one cell of 4 m: the window starts at int(0 + 2.0) = 2 on both axes
    got = ros_readers.keepout(costs, grid([[100]], 4.0), 1.0, (0.0, 0.0))
    assert got.tolist() == [[0, 0, 0, 0], [0, 0, 0, 0], [0, 0, 254, 254]]


def test_static_layer() -> None:
    data = np.array([[-1, 0, 1, 50, 98, 99, 100]], np.int8)

    def run(stack: str, **keys: object) -> list[int]:
        return ros_readers.static_layer(data, stack, **keys)[0].tolist()

    assert run("main") == [0, 0, 0, 0, 0, 253, 254]
    assert run("humble") == [0, 0, 0, 0, 0, 0, 254]
    assert run("ros1") == [255, 0, 0, 0, 0, 0, 254]
    assert run("main", trinary_costmap=False) == [0, 0, 2, 127, 248, 253, 254]
    assert run("humble", trinary_costmap=False) == [0, 0, 2, 127, 248, 251, 254]
    soft = run("main", trinary_costmap=False, lethal_cost_threshold=65, track_unknown_space=True)
    assert soft == [255, 0, 3, 195, 254, 253, 254]


def test_speed_limit() -> None:
    data = np.array([[-1, 0, 1, 40, 99, 100]], np.int8)
    got = ros_readers.speed_limit(data, 1, 100.0, -1.0)[0]
    assert np.isnan(got[0])
    assert got[1:].tolist() == [0, 99, 60, 1, 0]
    assert ros_readers.speed_limit(data, 1, 0.0, 3.0)[0, 1:].tolist() == [0, 3, 0, 0, 0]
    assert ros_readers.speed_limit(data, 2, 1.0, -0.0625)[0, 1:].tolist() == [0, 0.9375, 0, 0, 0]


def test_smac_costs() -> None:
    costs = np.array([0, 126, 252, 253, 254, 255], np.uint8)
    assert ros_readers.smac2d_multiplier(costs, 2.0)[:3].tolist() == [1, 2, 3]
    assert ros_readers.smac2d_multiplier(costs)[1] == 1.5
    assert ros_readers.smac_blocked(costs).tolist() == [False] * 3 + [True] * 2 + [False]
    assert ros_readers.smac_blocked(costs, False).tolist() == [False] * 3 + [True] * 3
    hybrid = ros_readers.smac_hybrid_multiplier(costs)[:3]
    assert hybrid == pytest.approx([0.985, 1.985, 2.985])
    hybrid = ros_readers.smac_hybrid_multiplier(costs, quadratic=True)[:3]
    assert hybrid == pytest.approx([0.985, 1.485, 2.985])


def test_navfn() -> None:
    costs = np.zeros((3, 9), np.uint8)
    costs[1, 1:8] = [0, 1, 127, 251, 252, 253, 255]
    assert ros_readers.navfn_costs(costs)[1].tolist() == [254, 50, 50, 151, 250, 251, 254, 253, 254]
    assert ros_readers.navfn_costs(costs, False)[1, 7] == 254
    pot = ros_readers.navfn_potential(ros_readers.navfn_costs(np.zeros((5, 6), np.uint8)), (1, 1))
    assert pot[1, 1:5].tolist() == [0, 50, 100, 150]
    assert pot[2, 2] == pytest.approx(50 + 50 * 0.704)


def test_theta_star() -> None:
    costs = np.array([0, 100, 251, 252, 253, 254, 255], np.uint8)
    # (26/252)^2 * 2 = 0.021290; (116/252)^2 * 2 = 0.423784
    assert ros_readers.theta_star_traversal(costs)[:2] == pytest.approx(
        [0.021290, 0.423784], abs=1e-6
    )
    assert ros_readers.theta_star_blocked(costs).tolist() == [False] * 4 + [True] * 2 + [False]
    assert ros_readers.theta_star_blocked(costs, line=True).tolist()[2:4] == [False, True]


def test_paths() -> None:
    costs = np.zeros((3, 5), np.uint8)
    costs[:, 2] = [252, 0, 252]
    cells = ros_readers.smac2d_path(costs, (0, 0), (0, 4), 2.0)
    assert len(cells) == 5
    assert cells[2] == (1, 2)
    costs[1, 2] = 126  # entering: straight 3, by the middle 2 sqrt(2) + sqrt(2)
    free = ros_readers.smac_blocked(costs)
    cells, cost = ros_readers.grid_path(
        ros_readers.smac2d_multiplier(costs, 2.0), free, (0, 1), (0, 3)
    )
    assert cells == [(0, 1), (0, 2), (0, 3)]
    assert cost == pytest.approx(3 + 1)
    # the entered cell is charged, not the left one: leaving 252 costs 1, entering it costs 3
    assert (
        ros_readers.grid_path(ros_readers.smac2d_multiplier(costs, 2.0), free, (0, 2), (0, 3))[1]
        == 1
    )
    # theta*: the traversal part does not grow with the length of a diagonal step
    fixed = ros_readers.theta_star_traversal(costs)
    step = ros_readers.grid_path(1.0, ros_readers.theta_star_blocked(costs), (0, 0), (1, 1), fixed)[
        1
    ]
    assert step == pytest.approx(2**0.5 + 0.021290, abs=1e-6)
    costs[:, 2] = 254
    cells, cost = ros_readers.grid_path(1.0, ros_readers.smac_blocked(costs), (0, 0), (0, 4))
    assert cells == []
    assert cost == float("inf")
