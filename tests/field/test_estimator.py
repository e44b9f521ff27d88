"""What an estimator returns is checked, in one line, before it becomes a field or a file."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import ClassVar

import numpy as np
import pytest
from support.maps import ascii_map

import locplan
from locplan.errors import FieldError, LocplanError
from locplan.field import ESTIMATORS, Estimator, FieldConfig, SearchWindow
from locplan.field.estimator import EstimatorLayer


@dataclasses.dataclass(frozen=True, kw_only=True, repr=False)
class Own(Estimator):
    """Sound covariances and one layer."""

    name: ClassVar[str] = "own"
    layers: ClassVar[tuple[EstimatorLayer, ...]] = (
        EstimatorLayer("row", "row", "cells", lambda _: (0.0, 9.0)),
    )
    reach = 1.0
    title = "own"
    turns = 60.0

    def lattice(self, resolution):
        return SearchWindow(half_rotation_deg=self.turns).to_lattice(resolution)

    def halo(self, resolution, map_shape):
        return 2

    def covariances(self, part):
        sound = 0.1 * np.ones((len(part.rows), 1, 1)) * np.eye(3)
        return {"covariance": sound, "row": part.rows.astype(float)}


@pytest.fixture
def grid() -> locplan.OccupancyGrid:
    rows = ["#" * 30, *["#" + "." * 28 + "#"] * 8, "#" * 30]
    return ascii_map(*rows, resolution=0.25)


def own(change: Callable[[dict[str, np.ndarray], object], object], **members: object) -> Estimator:
    """An estimator whose values are changed before they are returned."""

    def covariances(self, part):
        return change(Own.covariances(self, part), part)

    return type("Mine", (Own,), {"covariances": covariances, **members})()


def test_estimator_without_name_is_refused():
    unnamed = {name: value for name, value in vars(Own).items() if name != "name"}
    with pytest.raises(LocplanError, match="estimator Unnamed has no name; add name"):
        type("Unnamed", (Estimator,), unnamed)()


def refused(grid: locplan.OccupancyGrid, estimator: Estimator, **how: object) -> str:
    with pytest.raises(LocplanError) as caught:
        locplan.covariance_field(grid, estimator, **how)
    assert "\n" not in str(caught.value)
    assert "estimator 'own'" in str(caught.value)
    return str(caught.value)


def with_covariance(*diagonal: float, **cells: float) -> Callable[..., object]:
    """A change of all covariances to a diagonal, and of some of their elements, as x01=1.0."""

    def change(values, part):
        covariance = np.broadcast_to(np.diag(diagonal), (len(part.rows), 3, 3)).copy()
        for place, value in cells.items():
            covariance[:, int(place[1]), int(place[2])] = value
        return values | {"covariance": covariance}

    return change


def test_changed_default_keeps_setting_limits():
    @dataclasses.dataclass(frozen=True, kw_only=True, repr=False)
    class Sure(Own):
        noise_level: float = 0.5

    assert Sure().noise_level == 0.5
    with pytest.raises(LocplanError, match="noise_level must be a positive number"):
        Sure(noise_level=-1.0)


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        (lambda v, _: v["covariance"], "covariances() must return a dict with 'covariance', 'row'"),
        (lambda v, _: None, "must return a dict with 'covariance', 'row', not None"),
        (lambda v, _: v | {"col": v["row"]}, "not 'covariance', 'row', 'col'; name all others in"),
        (lambda v, _: {"covariance": v["covariance"]}, "not 'covariance'; name all"),
        (
            lambda v, _: v | {"covariance": v["covariance"][:, :2, :2]},
            "'covariance' must be an array of numbers of shape (224, 3, 3), not float64 of shape"
            " (224, 2, 2)",
        ),
        (lambda v, _: v | {"covariance": v["covariance"][1:]}, "not float64 of shape (223, 3, 3)"),
        (lambda v, _: v | {"row": list(v["row"])}, "'row' must be an array of numbers of shape"),
        (lambda v, _: v | {"row": v["row"] + 0j}, "not complex128 of shape (224,)"),
        (lambda v, _: v | {"row": v["row"] / 0 * 0}, "row 1, column 1 of the map has a row that"),
        (
            lambda v, p: v | {"row": np.where((p.rows == 4) & (p.cols == 9), np.inf, 0.0)},
            "row 4, column 9 of the map has a row that is not finite; correct covariances() there",
        ),
        (with_covariance(np.nan, 1.0, 1.0), "has a covariance that is not finite"),
        (with_covariance(0.1, 0.1, 0.1, x02=np.nan), "has a covariance that is not finite"),
        (with_covariance(-0.1, -0.1, -0.1), "has a covariance with a negative eigenvalue"),
        (with_covariance(0.1, 0.1, 0.1, x01=0.2, x10=0.2), "with a negative eigenvalue"),
        (with_covariance(0.1, 0.1, 0.1, x01=0.01), "a covariance that is not symmetric"),
    ],
)
@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_field_rejects_invalid_estimator_values(grid, change, complaint):
    assert complaint in refused(grid, own(change))


@pytest.mark.parametrize(
    "change",
    [
        with_covariance(0.0, 0.0, 0.0),
        with_covariance(1.0, 1.0, 1.0, x01=1.0 + 1e-9, x10=1.0),
        lambda v, _: v | {"covariance": v["covariance"].astype(np.float32)},
        lambda v, _: v | {"row": v["row"].astype(int)},
    ],
)
def test_field_accepts_rounding_and_zero_covariance(grid, change):
    assert locplan.covariance_field(grid, own(change)).is_evaluated.sum() == 224


def test_field_checks_values_of_later_tiles(grid):
    def change(values, part):
        return with_covariance(*[np.nan if (part.rows > 6).any() else 0.1] * 3)(values, part)

    slow = own(change, seconds=lambda self, resolution: 1.0)
    assert "row 7, column 1 of the map has a covariance that" in refused(grid, slow, threads=1)


def test_field_checks_values_of_every_heading(grid):
    def change(values, part):
        several = {name: np.repeat(each[:, None], 8, axis=1) for name, each in values.items()}
        # A cell of the map, not of a tile: threads finish the tiles in any order.
        wrong = (part.rows == 1) & (part.cols == 6)
        several["covariance"][wrong, 3] *= -1
        return several

    headed = own(change, headings=8)
    assert "row 1, column 6 of the map has a covariance with a negative" in refused(grid, headed)


def around(distance: int) -> Callable[..., object]:
    """A change that counts the walls of a square around each cell."""

    def change(values, part):
        for at, (row, col) in enumerate(zip(part.rows, part.cols, strict=True)):
            row, col = row - part.corner[0], col - part.corner[1]
            rows, cols = (slice(max(0, i - distance), i + distance + 1) for i in (row, col))
            values["row"][at] = np.count_nonzero(part.levels[rows, cols] == 0)
        return values

    return change


def test_halo_check_rejects_too_small_halo(grid):
    expected = "of the map change with the map beyond the halo of 2 cells; let halo() reach"
    for distance in (3, 4, 20):
        assert expected in refused(grid, own(around(distance)))
        with ThreadPoolExecutor(1) as pool:
            assert expected in refused(grid, own(around(distance)), executor=pool)
    assert locplan.covariance_field(grid, own(around(2))).is_evaluated.sum() == 224


def test_halo_check_detects_distant_cells(grid):
    def change(values, part):
        cols = part.cols - part.corner[1] + 10
        inside = cols < part.levels.shape[1]
        values["row"][inside] = part.levels[part.rows - part.corner[0], cols * inside][inside]
        values["row"][~inside] = 254.0
        return values

    assert "beyond the halo of 2 cells" in refused(grid, own(change))


def test_halo_check_covers_last_cells(grid):
    def change(values, part):
        sound, wrong = values | {}, around(3)({**values, "row": values["row"].copy()}, part)
        return sound | {"row": np.where(part.rows > 6, wrong["row"], sound["row"])}

    assert "row 8, column 28 of the map change" in refused(grid, own(change))


def test_halo_check_works_without_walls():
    assert "beyond the halo of 2 cells" in refused(ascii_map(*["." * 30] * 30), own(around(3)))


def test_halo_check_covers_prepared_map(grid):
    def change(values, part):
        return values | {"row": np.full(len(part.rows), float(part.prepared))}

    def prepare(self, levels, resolution):
        return np.count_nonzero(levels == 0)

    assert "beyond the halo of 2 cells" in refused(grid, own(change, prepare=prepare))
    sound = own(lambda values, _: values, prepare=prepare)
    assert locplan.covariance_field(grid, sound).is_evaluated.sum() == 224


def test_halo_check_rejects_random_values(grid):
    random = np.random.default_rng(5)
    noisy = own(lambda v, p: v | {"row": random.normal(size=len(p.rows))})
    assert "draw no random numbers" in refused(grid, noisy)


def test_halo_must_be_whole_number(grid):
    for halo in (2.0, -1, None):
        estimator = own(lambda values, _: values, halo=lambda self, *_: halo)  # noqa: B023
        assert "halo() of estimator 'own' must be a whole number" in refused(grid, estimator)


def test_built_in_estimator_computes_cells_once(grid, monkeypatch):
    """Only a user's estimator is computed again to check its halo."""
    cells = []
    compute = locplan.Sad.covariances

    def counting(self, part):
        cells.extend(zip(part.rows, part.cols, strict=True))
        return compute(self, part)

    monkeypatch.setattr(locplan.Sad, "covariances", counting)
    locplan.covariance_field(grid, locplan.Sad(range=1.0))
    assert len(cells) == len(set(cells))


def saved(tmp_path, field: locplan.CovarianceField) -> locplan.CovarianceField:
    field.save(tmp_path / "f.npz")
    return locplan.CovarianceField.load(tmp_path / "f.npz")


@pytest.fixture
def sound(grid, monkeypatch) -> locplan.CovarianceField:
    monkeypatch.setitem(ESTIMATORS, "own", Own)
    return locplan.covariance_field(grid, FieldConfig(Own(), stride=0.5))


@pytest.mark.parametrize(
    ("name", "at", "value", "complaint"),
    [
        ("row", (1, 2), np.nan, "row 2, column 4 of the map has a row that is not finite"),
        ("covariance", (1, 2, 0, 1), np.nan, "row 2, column 4 of the map has a covariance that"),
        ("covariance", (1, 2, 0, 0), np.nan, "some of its points only"),
        ("covariance", (1, 2, 0, 0), -1.0, "row 2, column 4 of the map has a covariance with a"),
    ],
)
def test_save_rejects_invalid_field(sound, tmp_path, name, at, value, complaint):
    """Such a file could not be loaded."""
    assert saved(tmp_path, sound).config == sound.config
    values = {key: array.copy() for key, array in sound.values.items()}
    values[name][at] = value
    wrong = locplan.CovarianceField.from_values(values, sound.grid, sound.config)
    with pytest.raises(FieldError, match=complaint):
        wrong.save(tmp_path / "wrong.npz")
    for lost in ({"layers": {}}, {"covariance": sound.covariance[1:]}):
        with pytest.raises(FieldError, match="must be an array of shape"):
            dataclasses.replace(sound, **lost).save(tmp_path / "wrong.npz")
    assert [path.name for path in tmp_path.iterdir()] == ["f.npz"]


def test_save_rejects_field_of_unregistered_estimator(grid, sound, tmp_path, monkeypatch):
    """`load` could not build the estimator again."""

    class Namesake(locplan.Sad):
        """It has the name of another."""

    namesake = locplan.covariance_field(grid, Namesake(range=1.0))
    with pytest.raises(FieldError, match="field of estimator 'sad' could not be read again; give"):
        namesake.save(tmp_path / "f.npz")
    monkeypatch.delitem(ESTIMATORS, "own")
    with pytest.raises(FieldError, match=r"ESTIMATORS\['own'\] = Own"):
        sound.save(tmp_path / "f.npz")
    assert not list(tmp_path.iterdir())


def test_cache_skips_field_with_unserializable_settings(grid, tmp_path):
    @dataclasses.dataclass(frozen=True, kw_only=True, repr=False)
    class WithTable(Own):
        version: ClassVar[int] = 1
        table: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros(3))

    with pytest.warns(
        locplan.field.cache.CacheWarning, match="not cached: estimator 'own': .* ndarray"
    ):
        field = locplan.load_or_compute(grid, WithTable(), cache_dir=tmp_path)
    assert field.is_evaluated.sum() == 224
    assert not list(tmp_path.iterdir())


def test_versioned_estimator_is_cached_and_logged(grid, tmp_path, caplog):
    caplog.set_level("INFO")
    first = type("Mine", (Own,), {"version": 3})()
    field = locplan.load_or_compute(grid, first, cache_dir=tmp_path)
    assert not caplog.messages
    again = locplan.load_or_compute(grid, first, cache_dir=tmp_path)
    assert caplog.messages == [f"field of {grid.name}: cached, version 3"]
    np.testing.assert_array_equal(again.covariance, field.covariance)
    locplan.load_or_compute(grid, type("Mine", (Own,), {"version": 4})(), cache_dir=tmp_path)
    assert len(caplog.messages) == 1
    assert len(list(tmp_path.glob("*.npz"))) == 2


def test_estimator_without_version_is_not_cached(grid, tmp_path):
    with pytest.warns(locplan.field.cache.CacheWarning, match="Own declares no version"):
        locplan.load_or_compute(grid, Own(), cache_dir=tmp_path)
    assert not list(tmp_path.iterdir())


def test_fused_requires_version_of_custom_scan(grid):
    class Mine(locplan.Scan):
        """A user's scan."""

    lidar = locplan.Lidar(range=3.0, beams=30)
    config = FieldConfig(locplan.Fused(lidar, scan=Mine(lidar)))
    with pytest.raises(FieldError, match="Mine declares no version"):
        locplan.field.store.field_path(grid, config)
    Mine.version = 1
    before = locplan.field.store.field_path(grid, config)
    Mine.version = 2
    assert locplan.field.store.field_path(grid, config) != before
