"""Queries from files, at random, and of benchmarks."""

import math

import numpy as np
import pytest
from support.machine import SHARED_DATA

from locplan._support.tables import write_csv_rows
from locplan.comparison.benchmarks import read_movingai_map, read_scenarios
from locplan.errors import ConfigError, LocplanError
from locplan.maps import FREE, OCCUPIED, OccupancyGrid
from locplan.planning import Costmap, Query, plan, random_queries
from locplan.planning.queries import Station, read_queries, read_stations

BENCHMARKS = SHARED_DATA / "movingai"


def write_file(folder, text, name="queries.csv"):
    file = folder / name
    file.write_text(text)
    return file


def test_queries_are_read(tmp_path):
    header = "\ufeffname,start_x,start_y,goal_x,goal_y\n"
    file = write_file(tmp_path, header + "a,1,2,3,4\n\n b ,1.5,0,0,-1\n")
    assert read_queries(file) == [
        Query("a", (1.0, 2.0), (3.0, 4.0)),
        Query("b", (1.5, 0.0), (0.0, -1.0)),
    ]
    header = "name,start_x,start_y,goal_x,goal_y,start_heading_deg,goal_heading_deg\n"
    (query, bare) = read_queries(write_file(tmp_path, header + "a,1,2,3,4,90,-180\nb,1,2,3,4,,\n"))
    assert query.start == (1.0, 2.0, math.pi / 2)
    assert query.goal == (3.0, 4.0, -math.pi)
    assert bare.start == (1.0, 2.0)


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("", "its header must be name,start_x"),
        ("name,x\n", "its header must be"),
        ("name,x,y\n", "has no stations"),
        ("name,x,y\na,1,2\n", "has one station"),
        ("name,x,y\n,1,2\n", "row 2: name is empty"),
        ("name,x,y\na,1,2\na,3,4\n", "row 3: another row is named 'a'"),
        ("name,x,y\na,1,2\nb,inf,4\n", "row 3: x must be a finite"),
        ("name,start_x,start_y,goal_x,goal_y\n", "has no queries"),
        ("name,start_x,start_y,goal_x,goal_y\na,1,2,3\n", "row 2: has 4 values"),
        ("name,start_x,start_y,goal_x,goal_y\n\na,1,2,x,4\n", "row 3: goal_x must be a finite"),
        ("name,start_x,start_y,goal_x,goal_y\na,1,2,nan,4\n", "row 2: goal_x must be a finite"),
        ("name,start_x,start_y,goal_x,goal_y\n,1,2,3,4\n", "row 2: name is empty"),
        ("name,start_x,start_y,goal_x,goal_y\na,1,2,3,4\na,1,2,3,4\n", "row 3: another row"),
        ('name,start_x,start_y,goal_x,goal_y\n"a,1,2,3,4\n', "row 2: has 1 values"),
    ],
)
def test_wrong_rows_are_named(tmp_path, text, complaint):
    file = write_file(tmp_path, text)
    with pytest.raises(LocplanError, match=complaint) as caught:
        read_queries(file)
    assert str(file) in str(caught.value)


FORMULAS = ("=HYPERLINK(1)", "-dock", "+1", "-1e3", "@x", "'=a", "''-b", "'c", "plain")


def test_csv_names_survive_formula_escaping(tmp_path):
    write_csv_rows(
        tmp_path / "stations.csv", ("name", "x", "y"), [(n, -1.0, 2.0) for n in FORMULAS]
    )
    assert tuple(each.name for each in read_stations(tmp_path / "stations.csv")) == FORMULAS
    columns = ("name", "start_x", "start_y", "goal_x", "goal_y")
    write_csv_rows(tmp_path / "queries.csv", columns, [(n, -1.0, 2.0, 3.0, 4.0) for n in FORMULAS])
    assert tuple(each.name for each in read_queries(tmp_path / "queries.csv")) == FORMULAS
    cells = [row.split(",")[:2] for row in (tmp_path / "stations.csv").read_text().split()[1:]]
    names = ["'=HYPERLINK(1)", "'-dock", "+1", "-1e3", "'@x", "''=a", "'''-b", "'c", "plain"]
    assert cells == [[name, "-1"] for name in names]


def test_station_pairs_become_queries(tmp_path):
    file = write_file(tmp_path, "name,x,y\na,1,2\nb,3,4\nc,5,6\n")
    assert read_stations(file)[1] == Station("b", 3.0, 4.0)
    with pytest.raises(LocplanError, match="its header must be name,x,y"):
        read_stations(write_file(tmp_path, "name,x_m,y_m\na,1,2\n", "other.csv"))
    assert read_queries(file) == [
        Query("a to b", (1.0, 2.0), (3.0, 4.0)),
        Query("a to c", (1.0, 2.0), (5.0, 6.0)),
        Query("b to c", (3.0, 4.0), (5.0, 6.0)),
    ]


def test_read_queries_rejects_unreadable_files(tmp_path):
    with pytest.raises(LocplanError, match="there is no such file"):
        read_queries(tmp_path / "none.csv")
    (tmp_path / "picture.csv").write_bytes(bytes(range(128, 256)))
    with pytest.raises(LocplanError, match="is no text"):
        read_queries(tmp_path / "picture.csv")


def two_rooms(size=60) -> Costmap:
    """Joined at a corner only: no way between them, and a wall's corner cell."""
    cells = np.full((size, size), FREE, np.uint8)
    cells[: size // 2, size // 2 :] = OCCUPIED
    cells[size // 2 :, : size // 2] = OCCUPIED
    return Costmap.blank(OccupancyGrid(cells, 0.5, (-3.0, 2.0, 0.3)), robot=0.0)


def test_random_queries_are_solvable_and_spread():
    costs = two_rooms()
    queries = random_queries(costs, 12, 4, min_distance=8.0)
    assert len({query.name for query in queries}) == 12
    assert queries == random_queries(costs, 12, 4, min_distance=8.0)
    assert queries != random_queries(costs, 12, 5, min_distance=8.0)
    for query in queries:
        assert math.dist(query.start, query.goal) >= 8.0 - 1e-6
        assert plan(costs, query.start, query.goal).status == "solved"
    rows = [costs.grid.cell(query.start)[0] for query in queries]
    assert 3 <= sum(row < 30 for row in rows) <= 9
    ends = np.array([query.start + query.goal for query in queries])
    apart = np.linalg.norm(ends[:, None] - ends[None], axis=2) + 1e9 * np.eye(12)
    assert apart.min() > 4.0


def test_random_queries_reach_longest_distance():
    costs = two_rooms()
    longest = math.hypot(29, 29) * 0.5
    queries = random_queries(costs, 3, 1, min_distance=longest)
    assert all(math.dist(q.start, q.goal) == pytest.approx(longest) for q in queries)
    with pytest.raises(ConfigError, match=r"lie 21 m apart; the farthest are 20\.51 m"):
        random_queries(costs, 3, 1, min_distance=21.0)


def test_random_queries_reject_impossible_requests():
    full = Costmap.blank(OccupancyGrid(np.zeros((5, 5), np.uint8), 1.0), robot=0.0)
    with pytest.raises(ConfigError, match="no cell where the robot fits"):
        random_queries(full, 1, 1, min_distance=1.0)
    message = "the number of random queries must be a whole number in 1..10000"
    with pytest.raises(ConfigError, match=message):
        random_queries(two_rooms(), 0, 1, min_distance=1.0)


def test_grid_plans_scenarios_optimally():
    if not BENCHMARKS.is_dir():
        pytest.skip("the MovingAI grids are not here")
    for name in ("8room_000", "Berlin_0_256", "random512-40-3"):
        grid = read_movingai_map(BENCHMARKS / f"{name}.map", 0.5)
        costs, file = Costmap.blank(grid, robot=0.0), BENCHMARKS / f"{name}.map.scen"
        lines = file.read_text().splitlines()
        queries = read_scenarios(file, grid, count=6)
        assert len(queries) == 6
        for query in queries:
            optimal = float(lines[int(query.name.split()[1])].split()[-1])
            result = plan(costs, query.start, query.goal, planner="grid")
            assert result.metrics.length == pytest.approx(optimal * 0.5, abs=0.005)
            assert result.metrics.cost == pytest.approx(optimal * 0.5, abs=0.005)


MOVINGAI_MAP = "type octile\nheight 2\nwidth 3\nmap\n...\n@@.\n"
MOVINGAI_SCENARIO = "version 1\n0\tm.map\t3\t2\t0\t0\t2\t1\t3\n"


def test_movingai_map_starts_at_top(tmp_path):
    grid = read_movingai_map(write_file(tmp_path, MOVINGAI_MAP, "m.map"))
    assert (grid.cells == [[OCCUPIED, OCCUPIED, FREE], [FREE, FREE, FREE]]).all()
    scenario = write_file(tmp_path, MOVINGAI_SCENARIO, "m.scen")
    assert read_scenarios(scenario, grid) == [Query("scenario 1", (0.5, 1.5), (2.5, 0.5))]


def test_movingai_readers_reject_wrong_files(tmp_path):
    map_file = write_file(tmp_path, MOVINGAI_MAP, "m.map")
    scenario = write_file(tmp_path, MOVINGAI_SCENARIO, "m.scen")
    with pytest.raises(LocplanError, match="is for a map of 3 x 2 cells"):
        read_scenarios(scenario, two_rooms().grid)
    with pytest.raises(LocplanError, match="is not a MovingAI map"):
        read_movingai_map(scenario)
    with pytest.raises(LocplanError, match="is not a MovingAI scenario"):
        read_scenarios(map_file, read_movingai_map(map_file))
