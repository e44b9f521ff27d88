"""Fields of the lidar estimators, and the costmaps and path costs that use them."""

import dataclasses
import itertools
import json
import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
from support.cases import sample_cases
from support.maps import ascii_map, corridor, random_rooms
from support.oracles.landmarks import rotated

from locplan.errors import ConfigError
from locplan.field import (
    CovarianceField,
    Estimator,
    FieldConfig,
    Fisher,
    Fused,
    Sad,
    Scan,
    SearchWindow,
    covariance_field,
    load_or_compute,
    scalar,
)
from locplan.field.beams import NORMAL_REACH, find_surface_normals
from locplan.field.compute import find_lidar_cells
from locplan.field.covariance import average_information
from locplan.field.estimator import MapPart
from locplan.maps import FREE, OCCUPIED, OccupancyGrid, environments
from locplan.planning import Costmap, Path, path_metrics, plan
from locplan.planning.layers import HeadingLayers
from locplan.planning.metrics import compute_profile, find_cells_of_path
from locplan.planning.ompl.motions import Motions
from locplan.robots import LIDARS, Lidar

ALL_ROUND = Lidar(range=2.5, beams=72)
AHEAD = Lidar(range=2.5, field_of_view_deg=120.0, beams=40, mount_x=0.15, mount_yaw_deg=10.0)
SMALL = SearchWindow(half_width=0.6, step=0.2, half_rotation_deg=30.0)


def make_estimator(name, lidar=ALL_ROUND, **settings) -> Estimator:
    """Return an estimator; its search window is small by default."""
    settings = {"window": SMALL} | settings
    if name == "fused":
        both = {kind: make_estimator(kind, lidar, **settings) for kind in ("fisher", "scan")}
        return Fused(lidar, **both)
    return {"fisher": Fisher, "scan": Scan}[name](lidar, **settings)


def make_config(estimator, lidar=ALL_ROUND, *, headings=0, stride=0.2, **settings):
    return FieldConfig(
        make_estimator(estimator, lidar, **settings), headings=headings, stride=stride
    )


@pytest.fixture(scope="module")
def rooms() -> OccupancyGrid:
    return OccupancyGrid(random_rooms((110, 130), seed=7), 0.05, (1.0, 2.0, 0.6), name="rooms")


@pytest.fixture(scope="module", params=["fisher", "scan", "fused"])
def estimator(request) -> str:
    return request.param


@pytest.fixture(scope="module")
def ahead(rooms, estimator) -> CovarianceField:
    return covariance_field(rooms, make_config(estimator, AHEAD, headings=4))


def assert_same(one: CovarianceField, other: CovarianceField) -> None:
    assert one.values.keys() == other.values.keys()
    for name, array in one.values.items():
        np.testing.assert_array_equal(array, other.values[name])


def test_field_omits_axis_of_single_heading(rooms, estimator):
    field = covariance_field(rooms, make_config(estimator))
    assert field.covariance.shape[2:] == (3, 3)
    assert field.e.shape == field.covariance.shape[:2]
    assert set(field.layers) == (set() if estimator == "fisher" else {"ambiguity", "entropy"})
    for layer in field.layers.values():
        assert layer.shape == field.e.shape
        assert np.array_equal(np.isnan(layer), ~field.is_evaluated)


def test_field_has_axis_of_several_headings(ahead, estimator):
    h, w = ahead.is_evaluated.shape
    assert ahead.covariance.shape == (h, w, 4, 3, 3)
    assert ahead.e.shape == (h, w, 4)
    assert ahead.e_map().shape == (*ahead.grid.shape, 4)
    assert all(layer.shape == (h, w, 4) for layer in ahead.layers.values())
    known = ahead.covariance[ahead.is_evaluated]
    assert (np.linalg.eigvalsh(known) > 0).all()
    assert not np.allclose(known[:, 0], known[:, 1])


def test_place_without_returns_is_featureless(estimator):
    grid = OccupancyGrid(np.full((40, 40), FREE), 0.1)
    for sensor in (ALL_ROUND, AHEAD):
        field = covariance_field(grid, make_config(estimator, sensor))
        assert field.e[field.is_evaluated] == pytest.approx(field.anchors()[1], rel=1e-12)
        costs = Costmap.from_field(field, robot=0.0)
        assert costs.u[5, 5] == pytest.approx(1.0, rel=1e-12)


@pytest.mark.parametrize("half_rotation_deg", [10.0, 0.0])
def test_u_follows_anchors_of_position_std(estimator, half_rotation_deg):
    """u is 0 up to 5 cm, and 1 without returns."""
    window = SearchWindow(
        half_width=1.5, step=0.1, half_rotation_deg=half_rotation_deg, rotation_step_deg=2.0
    )
    wanted = make_config(estimator, window=window, stride=0.1)
    grid = OccupancyGrid(np.full((2, 6), FREE), 0.1)
    nothing = wanted.estimator.featureless(window.to_lattice(0.1))
    top = math.sqrt(nothing[0, 0])
    assert top == pytest.approx(0.9, abs=0.01)
    deviations = np.array([0.01, 0.05, 0.052, math.sqrt(0.05 * top), top, 2.0])
    covariance = np.tile(nothing, (2, 6, 1, 1))
    covariance[..., :2, :2] = np.eye(2) * 1e-4
    covariance[..., 0, 0] = deviations**2
    covariance = rotated(covariance, 0.7)
    field = CovarianceField(covariance, grid, wanted)
    assert field.anchors("position_std") == pytest.approx((0.05, top))
    costs = Costmap.from_field(field, robot=0.0)
    expected = [0.0, 0.0, math.log(1.04) / math.log(top / 0.05), 0.5, 1.0, 1.0]
    np.testing.assert_allclose(costs.u, [expected] * 2, atol=1e-9)
    assert costs.weight == 8.0
    np.testing.assert_allclose(costs.density, 1 + 8 * costs.u)
    assert field.saturated_share == 0.5


def test_coarse_steps_raise_perfect_covariance(estimator):
    """The steps are coarser than 5 cm."""
    lattice = SearchWindow(half_width=2.0, step=0.5).to_lattice(0.5)
    least = make_estimator(estimator).perfect(lattice)
    np.testing.assert_allclose(least, lattice.quantisation)
    assert lattice.quantisation[0, 0] > 0.05**2


def test_field_ignores_tile_size_and_executor(rooms, estimator, ahead, monkeypatch):
    monkeypatch.setattr("locplan.field.tiles.TILE", 9)
    assert_same(covariance_field(rooms, ahead.config, threads=2), ahead)
    odd = Lidar(
        range=2.0, beams=61, field_of_view_deg=180, mount_x=0.23, mount_y=-0.11, mount_yaw_deg=20
    )
    with ThreadPoolExecutor(2) as executor:  # whose tasks are cut out of the map
        for sensor in (AHEAD, odd, dataclasses.replace(odd, mount_x=-0.317)):
            wanted = make_config(estimator, sensor, headings=4)
            field = covariance_field(rooms, wanted, executor=executor)
            assert_same(field, covariance_field(rooms, wanted))


def test_halo_of_scan_includes_endpoint_noise(monkeypatch):
    monkeypatch.setattr("locplan.field.tiles.TILE", 3)
    posts = np.random.default_rng(1).random((100, 110)) < 0.02
    grid = OccupancyGrid(np.where(posts, OCCUPIED, FREE).astype(np.uint8), 0.05)
    short = Lidar(range=0.8, beams=180)
    wanted = make_config("scan", short, stride=0.4, endpoint_noise=(1.0, 0.2))
    with ThreadPoolExecutor(1) as executor:
        field = covariance_field(grid, wanted, executor=executor)
    assert_same(field, covariance_field(grid, wanted))


def test_field_survives_save_cache_and_update(rooms, ahead, tmp_path):
    ahead.save(tmp_path / "ahead.npz")
    loaded = CovarianceField.load(tmp_path / "ahead.npz")
    assert_same(loaded, ahead)
    assert loaded.config == ahead.config
    for _ in range(2):
        assert_same(load_or_compute(rooms, ahead.config, cache_dir=tmp_path / "cache"), ahead)
    cells = rooms.cells.copy()
    cells[3:6, 4:7] = 0
    after = dataclasses.replace(rooms, cells=cells)
    assert_same(ahead.update(after), covariance_field(after, ahead.config))


def test_quarter_turn_turns_covariances_and_headings(estimator):
    # An odd number of cells, so that the lattice turns onto itself.
    grid = OccupancyGrid(random_rooms((101, 101), seed=3), 0.05)
    turned = OccupancyGrid(np.rot90(grid.cells, -1), 0.05)
    wanted = make_config(estimator, AHEAD, headings=4)
    before, after = covariance_field(grid, wanted), covariance_field(turned, wanted)
    both = np.rot90(before.is_evaluated, -1) & after.is_evaluated
    expected = rotated(np.rot90(before.covariance, -1), math.pi / 2)
    expected = np.roll(expected, 1, axis=2)  # who faced x faces y
    difference = np.abs(after.covariance[both] - expected[both])
    assert np.median(difference) < 1e-9
    assert (difference.max(axis=(1, 2, 3)) < 1e-6).mean() > 0.9  # a ray on an edge may take either


@pytest.mark.parametrize(
    "lidar",
    sample_cases(
        [
            Lidar(range=2.5, field_of_view_deg=180.0, beams=361, mount_x=0.15),
            Lidar(range=2.5),
            Lidar(range=2.5, beams=90),
            Lidar(range=2.5, field_of_view_deg=270.0, beams=1080),
        ]
    ),
    ids=lambda lidar: f"{lidar.beams} beams in {lidar.field_of_view_deg:g} deg",
)
def test_field_follows_map_rotation_and_mirroring(estimator, lidar):
    # An odd number of cells, so that the lattice turns onto itself.
    grid = OccupancyGrid(random_rooms((101, 101), seed=3), 0.05)
    wanted = FieldConfig(make_estimator(estimator, lidar))
    field = covariance_field(grid, wanted)
    covariance = field.covariance.reshape(*field.is_evaluated.shape, wanted.headings, 3, 3)
    flip = np.diag([-1.0, 1.0, -1.0])
    mirrored = (flip @ covariance[:, ::-1] @ flip)[
        :, :, wanted.headings // 2 - np.arange(wanted.headings)
    ]
    for cells, evaluated, start, turns in (
        (grid.cells, field.is_evaluated, covariance, (1, 2)),
        (grid.cells[:, ::-1], field.is_evaluated[:, ::-1], mirrored, (0, 3)),
    ):
        for quarters in turns:
            turned = OccupancyGrid(np.rot90(cells, -quarters), 0.05)
            after = covariance_field(turned, wanted)
            both = np.rot90(evaluated, -quarters) & after.is_evaluated
            expected = rotated(np.rot90(start, -quarters), quarters * math.pi / 2)
            expected = np.roll(expected, quarters * wanted.headings // 4, axis=2)[both]
            found = after.covariance[both].reshape(expected.shape)
            assert np.median(np.abs(found - expected)) < 1e-4
            for name in ("position_std", "heading_std"):
                ratio = scalar(found, name) / scalar(expected, name)
                # A beam along an edge or through a corner may take either cell.
                assert np.quantile(np.abs(np.log(ratio)), 0.95) < 0.03


def test_map_yaw_turns_covariances_not_headings(estimator):
    """Headings are angles in the world frame."""
    cells = random_rooms((80, 90), seed=5)
    straight = covariance_field(
        OccupancyGrid(cells, 0.05), make_config(estimator, AHEAD, headings=4)
    )
    turned = covariance_field(OccupancyGrid(cells, 0.05, (0.0, 0.0, math.pi / 2)), straight.config)
    expected = np.roll(rotated(straight.covariance, math.pi / 2), 1, axis=2)
    known = straight.is_evaluated
    np.testing.assert_array_equal(turned.is_evaluated, known)
    assert np.median(np.abs(turned.covariance[known] - expected[known])) < 1e-9
    ratio = turned.e[known] / np.roll(straight.e, 1, axis=2)[known]
    assert (np.abs(np.log(ratio)) < 0.1).mean() > 0.95  # a beam on a cell's edge may take either


def test_corridor_is_uncertain_along_axis(estimator):
    for angle in (0.0, math.pi / 6):
        grid = corridor(14.0, 1.6, angle=angle)
        field = covariance_field(grid, make_config(estimator))
        covariance = field.at((0.0, 0.0), "covariance")
        values, vectors = np.linalg.eigh(covariance[:2, :2])
        along = math.atan2(vectors[1, 1], vectors[0, 1])
        assert abs(math.remainder(along - angle, math.pi)) < math.radians(8)
        # A slanting corridor's walls are stairs on the grid, which tell a little.
        assert values[1] > (0.95 if angle == 0 else 0.4) * field.window.uniform_covariance[0, 0]


@pytest.mark.parametrize(("yaw", "facing_the_wall"), [(90.0, 0), (-90.0, 2), (0.0, 1)])
def test_mount_yaw_turns_field_of_view(estimator, yaw, facing_the_wall):
    # One wall to the north, in range; who heads east has it on the left.
    grid = ascii_map("#" * 61, *["." * 61] * 60, resolution=0.1)
    lidar = Lidar(range=2.5, field_of_view_deg=120.0, beams=61, mount_yaw_deg=yaw)
    field = covariance_field(grid, make_config(estimator, lidar, headings=4))
    # The deviation across the wall, for headings east, north, west and south.
    across = np.sqrt(
        [field.at((3.05, 4.5, angle), "covariance")[1, 1] for angle in field.config.heading_angles]
    )
    nothing = math.sqrt(field.window.uniform_covariance[1, 1])
    assert across[facing_the_wall] < 0.5 * nothing
    assert across[(facing_the_wall + 2) % 4] == pytest.approx(nothing, rel=0.05)


def test_estimators_distinguish_paper_places():
    grid, at = environments.make("places", resolution=0.05), environments.place_positions("places")
    wide = SearchWindow(half_width=2.0, step=0.1, half_rotation_deg=10.0, rotation_step_deg=2.0)
    wanted = FieldConfig(Scan(Lidar(range=6.0), window=wide), stride=0.4)
    field = covariance_field(grid, wanted)
    e = {name: float(field.at(xy, "e")) for name, xy in at.items()}
    assert min(e, key=e.get) == "A"
    assert e["B"] > 10 * e["A"]
    ambiguity = field.interpolate_on_map(field.scalar("ambiguity"), logarithmic=False)
    there = {name: ambiguity[grid.cell(xy)] for name, xy in at.items()}
    assert there["D"] > 0.5  # its bays repeat
    assert there["A"] < 0.1
    fisher = covariance_field(grid, FieldConfig(Fisher(Lidar(range=6.0)), stride=0.4))
    corridor_, complex_ = (fisher.at(at[name], "covariance") for name in "BA")
    assert scalar(corridor_, "position_std") > 5 * scalar(complex_, "position_std")
    fused = covariance_field(grid, FieldConfig(Fused(Lidar(range=6.0)), stride=0.4))
    costs = Costmap.from_field(fused, robot=0.0)
    u = {name: costs.u[grid.cell(xy)] for name, xy in at.items()}
    assert u["A"] < 0.1
    assert u["B"] > 0.95
    assert u["D"] > 0.4


def test_field_without_rotation_has_two_dimensions(rooms, estimator):
    field = covariance_field(
        rooms, make_config(estimator, window=replace(SMALL, half_rotation_deg=0.0))
    )
    known = field.is_evaluated
    assert field.covariance.shape[2:] == (2, 2)
    assert (np.linalg.eigvalsh(field.covariance[known]) > 0).all()
    if estimator == "fisher":  # it is what is left where the heading is known
        turning = covariance_field(rooms, make_config(estimator)).covariance[known]
        expected = np.linalg.inv(np.linalg.inv(turning)[:, :2, :2])
        np.testing.assert_allclose(field.covariance[known], expected, rtol=1e-6, atol=1e-12)
    costs = Costmap.from_field(field, robot=0.0)
    assert 0 <= np.nanmin(costs.u) < 0.5 < np.nanmax(costs.u) <= 1


def test_covariance_interpolates_between_headings(ahead):
    i, j = np.argwhere(ahead.is_evaluated)[100]
    x, y = ahead.grid.position(int(i * ahead.stride), int(j * ahead.stride))
    for k, heading in enumerate(ahead.config.heading_angles):
        assert ahead.at((x, y, heading), "covariance") == pytest.approx(ahead.covariance[i, j, k])
        turned = ahead.at((x, y, heading - 2 * math.pi), "covariance")
        assert turned == pytest.approx(ahead.covariance[i, j, k])
    low, high = ahead.covariance[i, j, :2]
    between = ahead.at((x, y, math.pi / 4), "e")
    assert between == pytest.approx(math.sqrt(scalar(low, "e") * scalar(high, "e")))
    merged = np.linalg.inv(np.mean([np.linalg.inv(c) for c in ahead.covariance[i, j]], axis=0))
    assert ahead.at((x, y), "covariance") == pytest.approx(merged)


def test_scalar_combines_all_headings(ahead):
    known = ahead.is_evaluated
    worst = ahead.scalar("e", headings="worst")
    assert worst[known] == pytest.approx(ahead.e[known].max(axis=1))
    mean = ahead.scalar("e", headings="mean")
    assert (mean[known] <= worst[known] * (1 + 1e-9)).all()
    for covariances, e in zip(ahead.covariance[known][::50], mean[known][::50], strict=True):
        merged = np.linalg.inv(np.mean([np.linalg.inv(one) for one in covariances], axis=0))
        assert e == pytest.approx(math.sqrt(np.linalg.det(merged)))


def test_costmap_accepts_every_criterion(rooms, ahead):
    for criterion in ("e", "position_std", "heading_std", *ahead.layers):
        costs = Costmap.from_field(ahead, criterion=criterion, robot=0.0)
        free = np.isfinite(costs.density)
        assert free.any()
        assert costs.u[free].min() >= 0
        assert costs.u[free].max() <= 1
        assert costs.u_of_heading.shape == (4, *rooms.shape)
    with pytest.raises(ConfigError, match="criterion must be one of"):
        Costmap.from_field(ahead, criterion="entropie", robot=0.0)
    plain = covariance_field(rooms, FieldConfig(Sad(range=1.0), stride=0.4))
    with pytest.raises(ConfigError, match="criterion must be one of"):
        Costmap.from_field(plain, criterion="ambiguity", robot=0.0)


def make_map_part(rooms, count=5, headings=2, **more) -> MapPart:
    rows, cols = np.argwhere(rooms.free)[:: rooms.free.sum() // count][:count].T
    return MapPart(
        rooms.cells, rows, cols, rooms.resolution, rooms.shape,
        headings=np.linspace(0.2, 2.9, headings), **more,
    )  # fmt: skip


def compute_fisher_weight(covariance) -> float:
    """Return Fisher's weight in `Fused` for a covariance of the scan.

    It is 0.5 up to an axis ratio of 1.5 and 0.25 m, and 0 from a ratio of 4 or 0.35 m on.
    """
    minor, major = np.sqrt(np.linalg.eigvalsh(covariance[:2, :2]))
    return 0.5 * min(1.0, max(0.0, min((4.0 - major / minor) / 2.5, (0.35 - major) / 0.1)))


def apply_to_eigenvalues(function, matrix):
    """Apply a function to the eigenvalues of a symmetric matrix."""
    values, vectors = np.linalg.eigh(matrix)
    return (vectors * function(values)) @ vectors.T


@pytest.mark.parametrize("half_rotation_deg", sample_cases([30.0, 0.0]))
def test_fused_is_mean_of_matrix_logarithms(rooms, half_rotation_deg):
    sharp = {"window": replace(SMALL, half_rotation_deg=half_rotation_deg), "effective_beams": 120}
    fisher, scan = (make_estimator(name, AHEAD, **sharp) for name in ("fisher", "scan"))
    fused = Fused(AHEAD, fisher=fisher, scan=scan, noise_level=2.5)
    part = make_map_part(rooms, 60)
    one, other, both = (each.covariances(part) for each in (fisher, scan, fused))
    shares = []
    for n, k in np.ndindex(60, 2):
        of_fisher, of_scan = one["covariance"][n, k], other["covariance"][n, k]
        share = compute_fisher_weight(of_scan)
        parts = (apply_to_eigenvalues(np.log, each) for each in (of_fisher, of_scan))
        logs = share * next(parts) + (1 - share) * next(parts)
        mean = apply_to_eigenvalues(np.exp, logs)
        np.testing.assert_allclose(both["covariance"][n, k], 2.5 * mean, atol=1e-12)
        shares.append(share)
    assert min(shares) < 0.2 < max(shares) == 0.5
    assert any(0.2 < share < 0.45 for share in shares)
    for layer in ("ambiguity", "entropy"):
        np.testing.assert_array_equal(both[layer], other[layer])


def test_fused_equals_scan_in_corridor():
    """The derivatives see steps of slanting walls that no matcher finds."""
    for angle in (0.0, math.pi / 6):
        grid = corridor(14.0, 1.6, angle=angle)
        fisher, scan, fused = (
            covariance_field(grid, make_config(name)).at((0.0, 0.0), "covariance")
            for name in ("fisher", "scan", "fused")
        )
        np.testing.assert_allclose(fused, scan, atol=1e-12)
    assert scalar(fisher, "position_std") < 0.95 * scalar(scan, "position_std")


def test_fused_e_is_geometric_mean(rooms):
    fields = [covariance_field(rooms, make_config(name)) for name in ("fisher", "scan", "fused")]
    known = fields[0].is_evaluated
    e = [field.e[known] for field in fields]
    shares = np.array([compute_fisher_weight(each) for each in fields[1].covariance[known]])
    assert e[2] == pytest.approx(e[0] ** shares * e[1] ** (1 - shares))
    anchors = [field.anchors("e") for field in fields]
    assert anchors[2][1] == anchors[1][1]  # a featureless place is large


def test_estimator_counts_cells_until_stop(rooms, estimator):
    part = make_map_part(rooms)
    found = make_estimator(estimator, AHEAD).covariances(part)
    assert all(np.isfinite(values).all() for values in found.values())
    assert part.control.tolist() == [0, 5]
    stopped = make_map_part(rooms, control=np.array([1, 0]))
    found = make_estimator(estimator, AHEAD).covariances(stopped)
    assert all(np.isnan(values).all() for values in found.values())
    assert stopped.control.tolist() == [1, 0]


@pytest.mark.parametrize("kind", [Fisher, Scan])
def test_fused_passes_stop_to_estimators(kind, rooms, monkeypatch):
    controls = []

    def record_control(estimator, part, original=kind.covariances):
        controls.append(part.control)
        return original(estimator, part)

    monkeypatch.setattr(kind, "covariances", record_control)
    part = make_map_part(rooms)
    make_estimator("fused", AHEAD).covariances(part)
    part.control[0] = 1
    assert controls[0][0] == 1


def test_fused_parts_share_lidar_and_window():
    both = Fused(AHEAD)
    assert both == Fused(AHEAD, fisher=Fisher(AHEAD), scan=Scan(AHEAD))
    assert repr(both) == f"Fused(lidar={AHEAD!r})"
    assert both.fisher.lidar == both.scan.lidar == AHEAD
    with pytest.raises(ConfigError, match="must have the lidar of the fused"):
        Fused(AHEAD, scan=Scan(ALL_ROUND))
    with pytest.raises(ConfigError, match="one window"):
        Fused(AHEAD, scan=Scan(AHEAD, window=SMALL))
    with pytest.raises(ConfigError, match="scan must be a Scan"):
        Fused(AHEAD, scan=Fisher(AHEAD))
    with pytest.raises(ConfigError, match="lidar must be a Lidar"):
        Fused(Fisher(AHEAD))


def test_only_scan_adds_step_variance(rooms):
    """The least variance of a sharp match is Q for the scan, but much smaller for Fisher."""
    grid = OccupancyGrid(random_rooms((60, 60), seed=3, blocks=40), 0.05)
    sharp = {"effective_beams": 1e6, "sigma_hit": 0.01, "max_beams": 72}
    least = {}
    for name in ("fisher", "scan"):
        field = covariance_field(grid, make_config(name, **sharp))
        variances = np.diagonal(field.covariance[field.is_evaluated], axis1=1, axis2=2)
        least[name] = variances.min(axis=0) / np.diag(field.window.quantisation)
        assert (variances <= np.diag(field.config.estimator.featureless(field.window)) + 1e-9).all()
    assert least["scan"] == pytest.approx(np.ones(3), rel=1e-6)
    assert (least["fisher"] < 0.1).all()


def test_noise_level_scales_covariance_without_q(rooms, estimator):
    one, other = (
        make_estimator(estimator, AHEAD),
        replace(make_estimator(estimator, AHEAD), noise_level=2.5),
    )
    lattice = one.lattice(rooms.resolution)
    q = one.q(lattice)
    assert one.adds_q
    assert q.any() == (estimator == "scan")
    before, after = (each.covariances(make_map_part(rooms))["covariance"] for each in (one, other))
    np.testing.assert_allclose(after - q, 2.5 * (before - q), rtol=1e-9, atol=1e-12)
    nothing = one.featureless(lattice), other.featureless(lattice)
    np.testing.assert_allclose(nothing[1] - q, 2.5 * (nothing[0] - q), rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("model", ["endpoint", "range"])
def test_information_falls_with_squared_sigma(rooms, model):
    """Sigma is at least the width of a cell."""

    def information(cell, **settings):
        fisher = Fisher(lidar, window=SMALL, model=model, **settings)
        part = replace(make_map_part(rooms), resolution=cell)
        prior = np.linalg.inv(fisher.lattice(cell).uniform_covariance)
        return np.linalg.inv(fisher.covariances(part)["covariance"]) - prior

    lidar = replace(AHEAD, range_sigma=0.05)
    one = information(0.05, sigma_hit=0.05)
    noisy = {"range": {}, "endpoint": {"sigma_hit": 0.3}}[model]
    if model == "range":
        lidar = replace(AHEAD, range_sigma=0.3)
    tolerance = {"rtol": 1e-6, "atol": 1e-6 * np.abs(one).max()}
    np.testing.assert_allclose(information(0.05, **noisy), one / 36, **tolerance)
    lidar = replace(AHEAD, range_sigma=0.001)
    np.testing.assert_allclose(information(0.05, sigma_hit=0.001), one, **tolerance)


def test_fisher_scales_with_effective_beams(rooms):
    """Information is proportional to the effective beams per half turn, at most `max_beams`."""
    many = replace(ALL_ROUND, beams=720)
    part = make_map_part(rooms)

    def information(lidar, **settings):
        fisher = Fisher(lidar, window=SMALL, **settings)
        prior = np.linalg.inv(fisher.lattice(0.05).uniform_covariance)
        return np.linalg.inv(fisher.covariances(part)["covariance"]) - prior

    tolerance = {"rtol": 1e-6, "atol": 1e-6 * np.abs(information(many)).max()}
    all_of_them = information(many, max_beams=360, effective_beams=360)
    np.testing.assert_allclose(
        information(many, max_beams=360), all_of_them * 25.2 / 720, **tolerance
    )
    np.testing.assert_allclose(
        information(many, max_beams=360, effective_beams=1e9), all_of_them, **tolerance
    )
    fewer = information(many, max_beams=90)
    total, of_fewer = (np.trace(each, axis1=-2, axis2=-1) for each in (all_of_them, fewer))
    # Fewer beams have about the same information.
    assert of_fewer.sum() == pytest.approx(total.sum() * 25.2 / 720, rel=0.05)


EFFECTIVE = Lidar(range=5.0, field_of_view_deg=180.0, beams=90, min_range=0.1)


@pytest.mark.parametrize(
    ("one", "other", "same"),
    [
        (Scan(EFFECTIVE), Scan(replace(EFFECTIVE, range_sigma=0.2)), True),
        (Scan(EFFECTIVE), Scan(replace(EFFECTIVE, model="mine")), True),
        (Scan(EFFECTIVE), Scan(EFFECTIVE, max_beams=90), True),
        (Scan(EFFECTIVE), Scan(EFFECTIVE, max_beams=89), False),
        (Scan(EFFECTIVE, effective_beams=90), Scan(EFFECTIVE, effective_beams=500), True),
        (Scan(EFFECTIVE), Scan(EFFECTIVE, effective_beams=12), False),
        (Scan(EFFECTIVE), Scan(EFFECTIVE, endpoint_noise=[0.03, 0.01]), True),
        (Scan(EFFECTIVE), Scan(EFFECTIVE, endpoint_noise=(0.03, 0.0)), False),
        (Scan(EFFECTIVE), Scan(replace(EFFECTIVE, min_range=1.5)), False),
        (Scan(EFFECTIVE), Scan(EFFECTIVE, sigma_hit=0.2), False),
        (Fisher(EFFECTIVE), Fisher(replace(EFFECTIVE, range_sigma=0.2)), True),
        (Fisher(EFFECTIVE), Fisher(EFFECTIVE, sigma_hit=0.2), False),
        (Fisher(EFFECTIVE), Fisher(EFFECTIVE, model="range"), False),
        (
            Fisher(EFFECTIVE, model="range"),
            Fisher(replace(EFFECTIVE, range_sigma=0.2), model="range"),
            False,
        ),
        (Fisher(EFFECTIVE, model="range"), Fisher(EFFECTIVE, model="range", sigma_hit=0.2), True),
        (Fused(EFFECTIVE), Fused(replace(EFFECTIVE, range_sigma=0.2)), True),
        (Fused(EFFECTIVE), Fused(EFFECTIVE, fisher=Fisher(EFFECTIVE, sigma_hit=0.2)), False),
        (Fused(EFFECTIVE), Fused(EFFECTIVE, scan=Scan(EFFECTIVE, z_rand=0.1)), False),
        (Fused(EFFECTIVE), Fused(EFFECTIVE, noise_level=2.0), False),
    ],
)
def test_estimator_identity_changes_with_values_only(one, other, same):
    """The identity names the cached field."""
    keys = [json.dumps(each.identity(), sort_keys=True) for each in (one, other)]
    assert (keys[0] == keys[1]) == same
    levels = random_rooms((60, 60), seed=7)
    part = MapPart.from_map(levels, *np.argwhere(levels == FREE)[::97].T, 0.1)
    values = [each.covariances(part)["covariance"] for each in (one, other)]
    assert np.array_equal(*values) == same


@pytest.fixture(scope="module")
def headed_costs() -> Costmap:
    """Free space in which facing west costs nothing, and facing east most."""
    grid = OccupancyGrid(np.full((40, 60), FREE), 0.1)
    costs = Costmap.blank(grid, robot=0.0)
    u = 0.5 + 0.5 * np.cos(2 * np.pi * np.arange(8) / 8)
    layers = np.broadcast_to(u[:, None, None], (8, *grid.shape))
    of_heading = HeadingLayers(lambda: (layers, layers))
    half = np.full(grid.shape, 0.5)
    return dataclasses.replace(costs, weight=4.0, u=half, of_heading=of_heading)


def test_motion_cost_integrates_u_over_headings(headed_costs):
    u = headed_costs.u_of_heading[:, 0, 0]
    turning = Motions(headed_costs, "SE2")
    assert turning.cost((1, 1, 0.0), (4, 1, 0.0)) == pytest.approx(3 * (1 + 4 * u[0]))
    assert turning.cost((1, 1, math.pi), (4, 1, math.pi)) == pytest.approx(3.0)
    # A quarter turn on the way: half a bin, a whole one, half a bin.
    quarter = turning.cost((1, 1, 0.0), (4, 1, math.pi / 2))
    shares = np.array([0.25, 0.5, 0.25])
    assert quarter == pytest.approx(3 * (1 + 4 * shares @ u[:3]))
    car = Motions(headed_costs, "Dubins", turning_radius=1.0)
    circle = car.cost((2, 1, 0.0), (2, 3, math.pi))
    shares = np.array([0.125, 0.25, 0.25, 0.25, 0.125])
    assert circle == pytest.approx(math.pi * (1 + 4 * shares @ u[:5]))


def test_path_metrics_equal_motion_cost(headed_costs):
    rng = np.random.default_rng(1)
    for space, radius in (("SE2", None), ("Dubins", 0.7), ("ReedsShepp", 0.4)):
        motions = Motions(headed_costs, space, radius)
        for _ in range(40):
            poses = rng.uniform([1, 1, -7], [5, 3, 7], (3, 3))
            cost = sum(motions.cost(*two) for two in itertools.pairwise(poses))
            path = motions.path(poses)
            if math.isfinite(cost):
                metrics = path_metrics(headed_costs, path)
                assert metrics.cost == pytest.approx(cost, rel=1e-4)
                assert metrics.integrated_u == pytest.approx((cost - path.length) / 4, rel=1e-3)
                distance, u = compute_profile(headed_costs, path, headed_costs.u_of_heading)
                assert np.diff(distance) @ u == pytest.approx(metrics.integrated_u)


def test_path_without_headings_uses_merged_cost(headed_costs):
    path = Path(np.array([[1.0, 1.0], [4.0, 1.0]]))
    assert path_metrics(headed_costs, path).integrated_u == pytest.approx(1.5)


def test_plan_turns_through_certain_headings(headed_costs):
    # To face north: the way over east sees nothing, that over west all.
    start, goal = (2.0, 1.0, -math.pi / 2), (4.0, 3.0, math.pi / 2)
    result = plan(
        headed_costs, start, goal, planner="RRTstar", space="SE2", iterations=3000, seed=1
    )
    assert result.status == "solved"
    straight = Motions(headed_costs, "SE2").cost(start, goal)
    assert result.metrics.cost < 0.8 * straight


def test_path_cells_have_heading_bins():
    grid = OccupancyGrid(np.full((1, 2), 254), resolution=3.0)
    path = Path([[0.0, 0.5], [4.0, 0.5]], [0.0, math.pi / 2])
    heading, _, col, length = find_cells_of_path(grid, path, 4)
    assert heading.tolist() == [0, 1, 1]
    assert col.tolist() == [0, 0, 1]
    assert length == pytest.approx([2.0, 1.0, 1.0])
    back = Path([[0.0, 0.5], [4.0, 0.5]], [0.1, 2 * math.pi - 0.1])
    assert set(find_cells_of_path(grid, back, 4)[0].tolist()) == {0}
    turn = Path([[1.0, 0.5], [1.0, 0.5]], [0.0, -math.pi])
    heading, _, col, length = find_cells_of_path(grid, turn, 4)
    assert (heading.tolist(), col.tolist(), length.tolist()) == ([0, 3, 2], [0, 0, 0], [0, 0, 0])
    assert find_cells_of_path(grid, path, 7)[3].sum() == pytest.approx(4.0)


def test_normals_of_part_equal_whole_map(monkeypatch):
    occupied = random_rooms((300, 310), seed=2) == 0
    whole = find_surface_normals(occupied)
    part = find_surface_normals(occupied[40:260, 30:300])
    inner = slice(NORMAL_REACH, -NORMAL_REACH)
    np.testing.assert_array_equal(part[inner, inner], whole[40:260, 30:300][inner, inner])
    monkeypatch.setattr("locplan.field.beams.BAND", 37)
    np.testing.assert_array_equal(find_surface_normals(occupied), whole)


def test_fisher_predicts_error_of_noisy_ranges():
    # An asymmetric room; the pose that fits noisy ranges best, to first order in exact ranges.
    from locplan._support.kernels.rays import cast_ray, compute_empty_squares

    size = 0.02
    cells = np.full((220, 320), FREE, np.uint8)
    cells[[0, -1]] = cells[:, [0, -1]] = 0
    cells[:60, :80] = 0
    squares = compute_empty_squares(cells == 0)
    sensor = Lidar(range=10.0, beams=90, range_sigma=0.02)
    grid = OccupancyGrid(cells, size)
    alone = {"model": "range", "effective_beams": 90, "window": SearchWindow()}
    field = covariance_field(grid, FieldConfig(Fisher(sensor, **alone), stride=0.2))

    def ranges(x, y, theta):
        return np.array(
            [
                size * cast_ray(squares, y / size, x / size, math.sin(a), math.cos(a), 1e9)[0]
                for a in theta + sensor.angles
            ]
        )

    i, j = 14, 20
    assert field.is_evaluated[i, j]
    pose = np.array([*grid.position(i * field.stride, j * field.stride), 0.0])
    step = np.array([0.1, 0.1, 0.04])
    jacobian = np.stack(
        [
            (ranges(*(pose + e * step)) - ranges(*(pose - e * step))) / (2 * s)
            for e, s in zip(np.eye(3), step, strict=True)
        ],
        axis=1,
    )
    smooth = np.abs(jacobian).max(axis=1) < 15  # but for beams whose wall changes
    rng = np.random.default_rng(0)
    estimates = [
        np.linalg.lstsq(jacobian[smooth], rng.normal(0, 0.02, smooth.sum()), rcond=None)[0]
        for _ in range(2000)
    ]
    ratio = np.sqrt(np.diag(field.covariance[i, j]) / np.var(estimates, axis=0))
    assert (ratio > 0.75).all()
    assert (ratio < 1.3).all()


def test_lidar_presets_follow_data_sheets():
    for name, sheet in LIDARS.items():
        sensor = Lidar.preset(name)
        wanted = FieldConfig(Fisher(sensor))
        assert wanted.estimator.reach == sensor.range == sheet.range
        assert wanted.headings == (1 if sensor.sees_all_round else 8)
        spacing = np.degrees(np.diff(sensor.angles))
        assert spacing == pytest.approx(np.full(sensor.beams - 1, spacing[0]))
    with pytest.raises(ConfigError, match="lidar must be one of"):
        Lidar.preset("kinect")


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Lidar(range=0.0), "range must be a positive number of m"),
        (lambda: Lidar(range=math.inf), "range must be a positive number of m"),
        (lambda: Lidar(field_of_view_deg=400.0), "at most 360"),
        (lambda: Lidar(range_sigma=1e-200), "range_sigma must be at least"),
        (lambda: Lidar(beams=0), "beams must be a whole number"),
        (lambda: Lidar(beams=1.5), "beams must be a whole number"),
        (lambda: Lidar(mount_x="front"), "mount_x must be a number"),
        (lambda: FieldConfig(headings=4), "the same for all headings"),
        (lambda: FieldConfig(Fisher("lidar")), "must be a Lidar"),
        (lambda: FieldConfig(Fisher(Lidar(range=6.0)), headings=0.5), "headings must be a whole"),
        (lambda: FieldConfig(Scan(AHEAD), headings=1), "depends on the heading"),
        (lambda: FieldConfig(Scan(Lidar(range=6.0), z_rand=1.0)), "z_rand must lie between"),
        (lambda: FieldConfig(Scan(Lidar(range=6.0), max_beams=0)), "max_beams must be a whole"),
        (lambda: Scan(AHEAD, effective_beams=-1), "effective_beams must be a positive"),
        (lambda: Fisher(AHEAD, sigma_hit=0.0), "sigma_hit must be a positive number of m"),
        (lambda: Fisher(AHEAD, window=1.5), "window must be a SearchWindow"),
        (lambda: Fisher(AHEAD, model="point"), "model must be one of endpoint, range"),
        (lambda: Scan(AHEAD, endpoint_noise=0.03), "endpoint_noise must be two numbers"),
        (lambda: Scan(AHEAD, endpoint_noise=(0.03, -0.1)), "endpoint_noise must be two numbers"),
        (lambda: Scan(AHEAD, endpoint_noise=(0.03, math.nan)), "endpoint_noise must be two"),
        (lambda: Scan(AHEAD, endpoint_noise=(0.03,)), "endpoint_noise must be two numbers"),
    ],
)
def test_impossible_sensors_and_configs_are_refused(make, message):
    with pytest.raises(ConfigError, match=message):
        make()


@pytest.mark.parametrize(
    ("start", "end"),
    [(-math.pi / 2, math.pi / 2), (math.pi / 2, -math.pi / 2), (0.0, -math.pi), (-math.pi, 0.0)],
)
def test_path_metrics_follow_planned_half_turn(headed_costs, start, end):
    """Either direction would be as short."""
    motions = Motions(headed_costs, "SE2")
    poses = np.array([[1.0, 1.0, start], [4.0, 2.0, end]])
    measured = path_metrics(headed_costs, motions.path(poses)).cost
    assert measured == pytest.approx(motions.cost(*poses))


def test_lidar_inside_wall_sees_nothing(estimator):
    cells = np.full((40, 60), FREE, np.uint8)
    cells[:, 40:45] = 0
    sensor = Lidar(range=3.0, beams=60, field_of_view_deg=180.0, mount_x=0.5)
    field = covariance_field(OccupancyGrid(cells, 0.1), make_config(estimator, sensor, headings=4))
    assert field.e[10, 18, 0] == pytest.approx(field.anchors()[1])


def test_sharp_posteriors_have_finite_mean_information(rooms):
    wanted = make_config(
        "scan",
        AHEAD,
        headings=4,
        effective_beams=40,
        sigma_hit=0.02,
        window=replace(SMALL, half_rotation_deg=10.0),
    )
    field = covariance_field(rooms, wanted)
    assert np.isfinite(field.scalar("e", headings="mean")[field.is_evaluated]).all()
    for headings in ("mean", "worst"):
        costs = Costmap.from_field(field, headings=headings, robot=0.0)
        free = np.isfinite(costs.density)
        assert np.isfinite(costs.u[free]).all()
        assert np.isfinite(costs.e[free]).all()


def test_mean_information_accepts_zero_covariance():
    known = np.stack([np.zeros((3, 3)), np.eye(3)])
    np.testing.assert_allclose(average_information(known), 2e-12 * np.eye(3), rtol=1e-6)


def test_estimator_accepts_uniform_maps(estimator):
    for level in "#. ":
        grid = ascii_map(*[level * 12] * 9, resolution=0.2)
        field = covariance_field(grid, make_config(estimator))
        assert field.is_evaluated.sum() == (108 if level == "." else 0)


def test_lidar_cell_is_nearest_free_cell():
    """A lattice point may lie in a wall."""
    free = random_rooms((30, 34), seed=4) == FREE
    rows, cols = np.indices(free.shape).reshape(2, -1)
    at = find_lidar_cells(free, rows, cols, 3)
    for row, col, to_row, to_col in zip(rows, cols, *at, strict=True):
        near = np.argwhere(free[max(0, row - 3) : row + 4, max(0, col - 3) : col + 4])
        if len(near) == 0:
            assert (to_row, to_col) == (row, col)
            continue
        corner = np.array([max(0, row - 3) - row, max(0, col - 3) - col])
        apart = np.hypot(*(near + corner).T)
        assert free[to_row, to_col]
        assert math.hypot(to_row - row, to_col - col) == pytest.approx(apart.min())
