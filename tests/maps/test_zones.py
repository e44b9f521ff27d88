import json
import pickle

import numpy as np
import pytest
from support.machine import SHARED_DATA
from support.zones import inside, random_outline

from locplan import Zone, Zones
from locplan.errors import ConfigError, LocplanError
from locplan.maps import FREE, OCCUPIED, OccupancyGrid, read_map, save_map
from locplan.maps.figures import draw_zones, make_map_axes

BOX = [[0.0, 0.0], [2.0, 0.0], [2.0, 1.0], [0.0, 1.0]]
TRIANGLE = [[0.3, 0.2], [2.6, 0.4], [1.1, 2.3]]
ALL = Zones([Zone("no-go", BOX), Zone("slow", TRIANGLE, 30), Zone("prefer", np.array(BOX) + 2)])


def center_positions(grid):
    """World positions of the centres of all cells."""
    return np.column_stack(grid.grid_to_world(*(np.indices(grid.shape).reshape(2, -1) + 0.5)))


def open_grid(rows=30, cols=40, resolution=0.1, origin=(0.0, 0.0, 0.0)):
    return OccupancyGrid(np.full((rows, cols), FREE), resolution, origin)


@pytest.mark.parametrize("origin", [(0.0, 0.0, 0.0), (-3.7, 12.4, 0.5)])
def test_zones_hold_all_overlapped_cells(origin):
    rng, grid = np.random.default_rng(4), open_grid(origin=origin)
    shares = (np.arange(12) + 0.5) / 12
    parts = np.stack(np.meshgrid(shares, shares), axis=-1).reshape(-1, 2)
    rows, cols = np.indices(grid.shape)
    at = np.stack([rows, cols], axis=-1)[..., None, :] + parts
    points = np.column_stack(grid.grid_to_world(*at.reshape(-1, 2).T))
    for corners in (3, 5, 12):
        centre = np.array(grid.grid_to_world(*rng.uniform(-3, 33, 2)))
        polygon = random_outline(rng, centre, 1.5, corners)
        cells = Zones([Zone("no-go", polygon)]).cells(grid, "no-go")
        share = inside(polygon, points).reshape(*grid.shape, -1).mean(axis=-1)
        assert cells[share > 0].all()
        # Of a hundred cells at the outline a few overlap by less than the samples see.
        assert (cells & (share == 0)).sum() <= 0.1 * cells.sum() + 3
        assert 0 < (share > 0).sum() < share.size


def test_zones_hold_thin_lines():
    """A virtual wall between the centres of cells still blocks them."""
    wall = Zone("no-go", [[0.0, 1.01], [4.0, 1.01], [4.0, 1.02], [0.0, 1.02]])
    cells = Zones([wall]).cells(open_grid(), "no-go")
    assert cells[10].all()
    assert cells.sum() == 40


def test_zones_along_edges_hold_no_neighbours():
    """Rounding of the map's coordinates adds no cell."""
    for resolution in (0.03, 0.05, 0.1):
        grid = open_grid(resolution=resolution, origin=(-15.1, -25.0, 0.0))
        x, y = grid.grid_to_world([3, 3, 7, 7], [2, 9, 9, 2])
        cells = Zones([Zone("no-go", np.column_stack([x, y]))]).cells(grid, "no-go")
        assert np.argwhere(cells).tolist() == [[r, c] for r in range(3, 7) for c in range(2, 9)]


def test_zones_are_clipped_to_map():
    far = [[-1e8, -1e8], [1e8, -1e8], [1e8, 1.0], [-1e8, 1.0]]
    assert Zones([Zone("no-go", far)]).cells(open_grid(), "no-go").sum() == 10 * 40
    assert not Zones([Zone("no-go", np.array(BOX) - 9)]).cells(open_grid(), "no-go").any()


def test_charge_is_1_outside_preferred_zones():
    grid = open_grid()
    assert Zones([Zone("no-go", BOX)]).cost_per_metre(grid) == 0.0
    charge = ALL.cost_per_metre(grid)
    assert np.unique(charge).tolist() == [0.0, 1.0]
    assert (charge == 0).sum() == 20 * 10


def test_speed_limit_is_minimum_of_zones():
    zones = Zones([Zone("slow", BOX, 30), Zone("slow", TRIANGLE, 50), Zone("no-go", BOX)])
    limit = zones.speed_limit(open_grid())
    assert limit[5, 5] == 30.0
    assert limit[15, 11] == 50.0
    assert limit[29, 39] == 100.0


def test_loaded_zones_equal_saved_zones(tmp_path):
    ALL.save(tmp_path / "zones.geojson")
    loaded = Zones.load(tmp_path / "zones.geojson")
    assert loaded == ALL
    assert (loaded.digest, hash(loaded), list(loaded)) == (ALL.digest, hash(ALL), list(ALL))
    loaded.save(tmp_path / "again.geojson")
    saved = [(tmp_path / f"{name}.geojson").read_bytes() for name in ("zones", "again")]
    assert saved[0] == saved[1]
    content = json.loads(saved[0])
    ring = content["features"][0]["geometry"]["coordinates"][0]
    assert (ring[0], len(ring)) == (ring[-1], 5)
    assert content["features"][1]["properties"] == {"kind": "slow", "percent": 30.0}
    assert pickle.loads(pickle.dumps(ALL)) == ALL
    with pytest.raises(ValueError, match="read-only"):
        pickle.loads(pickle.dumps(ALL)).items[0].polygon[0] = 1


def test_empty_zones_can_be_saved(tmp_path):
    Zones().save(tmp_path / "none.geojson")
    assert Zones.load(tmp_path / "none.geojson") == Zones()


def feature(coordinates, kind="no-go", shape="Polygon", **about):
    return {
        "type": "Feature",
        "properties": {"kind": kind, **about},
        "geometry": {"type": shape, "coordinates": coordinates},
    }


RING = [*BOX, BOX[0]]


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (feature([RING], kind="nogo"), "feature 2: the kind of a zone must be one of no-go"),
        ({"type": "Feature", "properties": None, "geometry": None}, "feature 2: has no kind"),
        (feature([RING], shape="MultiPolygon"), "feature 2: is a MultiPolygon; save each"),
        (feature([1, 2], shape="Point"), "feature 2: is no polygon, but 'Point'; draw"),
        (feature([RING, RING]), "feature 2: has a hole; split"),
        (feature([]), "feature 2: has no corners; draw"),
        (feature([[[0, 0], [1, 1], [0, 0]]]), "feature 2: encloses no area; draw"),
        (feature([[[0, 0], [1, 1], [2, 2], [0, 0]]]), "feature 2: encloses no area; draw"),
        (
            feature([[[0, 0], [2, 2], [2, 0], [0, 3]]]),
            "feature 2: its outline crosses itself near 1.20,1.20; draw it as two zones",
        ),
        (feature([[[0, 0], ["a", 1], [2, 0]]]), "feature 2: a corner must be x, y in metres"),
        (feature([[[0, 0], [1e9, 1], [2, 0]]]), "feature 2: a corner must be x, y in metres"),
        (feature([RING], kind="slow"), "feature 2: a slow zone needs percent"),
        (feature([RING], kind="slow", percent=0.3), "feature 2: percent must be"),
        (feature([RING], percent=30), "feature 2: a zone of kind no-go has no percent"),
    ],
)
def test_load_error_names_invalid_feature(tmp_path, wrong, message):
    file = tmp_path / "zones.geojson"
    features = [feature([RING]), wrong]
    file.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    with pytest.raises(LocplanError, match=message) as error:
        Zones.load(file)
    assert str(error.value).startswith(f"{file}: feature 2: ")


@pytest.mark.parametrize("text", ["", "[]", "{", '{"type": "Topology"}', "[" * 9000])
def test_load_rejects_other_files(tmp_path, text):
    (tmp_path / "zones.geojson").write_text(text)
    with pytest.raises(LocplanError, match=r"zones.geojson: (is not JSON|holds no zones)"):
        Zones.load(tmp_path / "zones.geojson")


def test_zones_reject_wrong_input():
    with pytest.raises(ConfigError, match="a zone must be a Zone"):
        Zones([BOX])
    many = np.column_stack([np.arange(1001.0), np.arange(1001.0) ** 2])
    with pytest.raises(ConfigError, match="has 1,001 corners; draw at most 1,000"):
        Zone("no-go", many)
    for wrong in ([[0, 0], [1, 1]], "abc", None, [[0, 0], [np.nan, 1], [2, 0]], np.zeros((4, 3))):
        with pytest.raises(ConfigError):
            Zone("no-go", wrong)
    with pytest.raises(ConfigError, match="25,001 zones"):
        Zones([Zone("no-go", BOX)] * 25_001)


def mask_map(rng, origin=(-3.0, 2.0, 0.0)):
    cells = np.where(rng.random((23, 31)) < 0.3, OCCUPIED, FREE).astype(np.uint8)
    cells[5:12, 8:20] = OCCUPIED
    return OccupancyGrid(cells, 0.05, origin)


@pytest.mark.parametrize("mode", ["trinary", "scale", "raw"])
def test_loaded_mask_blocks_occupied_cells(tmp_path, mode):
    mask = mask_map(np.random.default_rng(1))
    png = "png" if mode == "scale" else "pgm"
    save_map(mask, tmp_path / "keepout.yaml", mode=mode, image_format=png)
    zones = Zones.load(tmp_path / "keepout.yaml")
    np.testing.assert_array_equal(zones.cells(mask, "no-go"), mask.cells == OCCUPIED)
    # It is also exact on finer cells, and in the file of zones.
    fine = OccupancyGrid(mask.cells.repeat(2, 0).repeat(2, 1), 0.025, mask.origin)
    zones.save(tmp_path / "zones.geojson")
    again = Zones.load(tmp_path / "zones.geojson")
    np.testing.assert_array_equal(again.cells(fine, "no-go"), fine.cells == OCCUPIED)


def test_raw_mask_blocks_only_value_100(tmp_path):
    """Lower values are costs for the KeepoutFilter, whatever the thresholds are."""
    values = bytes([0, 50, 65, 99, 100, 255])
    (tmp_path / "mask.pgm").write_bytes(b"P5 6 1 255\n" + values)
    (tmp_path / "mask.yaml").write_text(
        "image: mask.pgm\nmode: raw\nresolution: 0.5\norigin: [0, 0, 0]\nnegate: 0\n"
        "occupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )
    cells = Zones.load(tmp_path / "mask.yaml").cells(open_grid(1, 6, 0.5), "no-go")
    assert cells.tolist() == [[False] * 4 + [True, False]]


@pytest.mark.parametrize(
    "name", ["nav2_depot_keepout", pytest.param("nav2_warehouse_keepout", marks=pytest.mark.long)]
)
def test_published_mask_is_read(name):
    folder = SHARED_DATA / "rosmaps" / name
    if not folder.is_dir():
        pytest.skip("the real maps (../shared/data/rosmaps) are not here")
    (file,) = folder.glob("*.yaml")
    (mask, _), zones = read_map(file), Zones.load(file)
    np.testing.assert_array_equal(zones.cells(mask, "no-go"), mask.cells == OCCUPIED)


@pytest.mark.parametrize("origin", [(0.0, 0.0, 0.0), (-3.7, 12.4, 0.5)])
def test_drawn_no_go_zones_cover_cells(origin):
    """Zones of a mask are drawn together, with their holes."""
    rng = np.random.default_rng(3)
    grid = OccupancyGrid(np.where(rng.random((30, 40)) < 0.3, OCCUPIED, FREE), 0.1, origin)
    zones = Zones.from_mask(grid)
    axes = make_map_axes(grid)[1]
    (handle,) = draw_zones(axes, zones, grid)
    assert handle.get_label() == "no-go zone"
    (patch,) = axes.patches
    turns = np.zeros(grid.cells.size)
    for ring in patch.get_path().to_polygons():
        area = ring[:-1, 0] @ ring[1:, 1] - ring[:-1, 1] @ ring[1:, 0]
        turns += np.sign(area) * inside(ring[:-1], center_positions(grid))
    np.testing.assert_array_equal(turns.reshape(grid.shape) != 0, grid.cells == OCCUPIED)


def test_draw_zones_omits_zones_outside_map():
    grid = open_grid()
    axes = make_map_axes(grid)[1]
    labels = [handle.get_label() for handle in draw_zones(axes, ALL, grid)]
    assert labels == ["no-go zone", "slow zone", "preferred zone"]
    np.testing.assert_array_equal(axes.patches[1].get_path().vertices[:3], TRIANGLE)
    part = grid.crop(slice(0, 3), slice(0, 3))
    assert [handle.get_label() for handle in draw_zones(axes, ALL, part)] == ["no-go zone"]
    assert not draw_zones(axes, Zones(), grid)
