"""What is new is one file and one line: an estimator that is registered works everywhere."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import pytest
from support.maps import ascii_map

import locplan
from locplan.errors import ConfigError
from locplan.field import ESTIMATORS, Estimator, FieldConfig, OffsetLattice, SearchWindow
from locplan.field.estimator import EstimatorLayer, MapPart
from locplan.field.figures import field_figure


@dataclass(frozen=True, kw_only=True)
class FromTheRight(Estimator):
    """The further to the right a cell lies, the more uncertain: for tests."""

    name: ClassVar[str] = "from-the-right"
    version: ClassVar[int] = 1
    remedy: ClassVar[str] = "stay at the left"
    weight: ClassVar[float] = 9.0
    layers: ClassVar[tuple[EstimatorLayer, ...]] = (
        EstimatorLayer("column", "column of the cell", "cells", lambda _: (0.0, 100.0)),
    )

    slope: float = 0.01
    """Variance that each metre adds [m]."""

    @property
    def reach(self) -> float:
        return 1.0

    @property
    def title(self) -> str:
        return f"{self.name}, slope {self.slope:g}"

    def lattice(self, resolution: float) -> OffsetLattice:
        return SearchWindow().to_lattice(resolution)

    def covariances(self, part: MapPart) -> dict[str, np.ndarray]:
        variance = self.slope * (part.cols + 1.0) * part.resolution
        covariance = variance[:, None, None] * np.eye(3)
        q = self.q(self.lattice(part.resolution))
        return {"covariance": covariance + q, "column": part.cols.astype(float)}

    def halo(self, resolution: float, map_shape: tuple[int, int]) -> int:
        return 0


@pytest.fixture
def grid() -> locplan.OccupancyGrid:
    return ascii_map("#" * 40, *["#" + "." * 38 + "#"] * 12, "#" * 40, resolution=0.25)


@pytest.fixture(autouse=True)
def _registered(monkeypatch):
    monkeypatch.setitem(ESTIMATORS, FromTheRight.name, FromTheRight)


def test_plan_uses_field_of_user_estimator(grid):
    field = locplan.covariance_field(grid, FromTheRight(slope=0.05))
    costs = locplan.Costmap.from_field(field)
    assert costs.weight == 9.0
    assert (np.diff(costs.u[5, 1:-1]) >= 0).all()
    found = locplan.plan(costs, (9.0, 0.6), (9.0, 2.5))
    assert found.status == "solved"
    columns = locplan.Costmap.from_field(field, criterion="column")
    assert columns.u[5, 20] == pytest.approx(0.2)


def test_user_estimator_is_cached_and_drawn(grid, tmp_path):
    config = FieldConfig(FromTheRight(slope=0.05), stride=0.5)
    field = locplan.load_or_compute(grid, config)
    again = locplan.load_or_compute(grid, config)
    np.testing.assert_array_equal(again.layers["column"], field.layers["column"])
    field.save(tmp_path / "field.npz")
    assert locplan.CovarianceField.load(tmp_path / "field.npz").config == config
    figure = field_figure(field, "column")
    assert "from-the-right, slope 0.05" in figure.axes[0].get_title()
    assert figure.axes[1].get_ylabel() == "column of the cell [cells]"


def test_settings_file_holds_user_estimator(tmp_path):
    locplan.save_config(FieldConfig(FromTheRight(slope=0.2)), tmp_path / "c.json")
    assert locplan.load_config(tmp_path / "c.json") == FieldConfig(FromTheRight(slope=0.2))
    (tmp_path / "c.json").write_text(json.dumps({"estimator": {"name": "from-the-right", "x": 1}}))
    with pytest.raises(ConfigError, match="from-the-right has no setting 'x'; it has: noise_level"):
        locplan.load_config(tmp_path / "c.json")
