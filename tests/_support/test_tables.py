"""One declaration of columns gives text, CSV, JSON, GeoJSON and a data frame."""

import csv
import json
import math
import pkgutil
from dataclasses import dataclass
from importlib import import_module

import pytest

import locplan
from locplan._support import public
from locplan._support.intervals import Interval
from locplan._support.output import ResultFiles
from locplan._support.records import Result, Table, TableColumn
from locplan._support.tables import check_file_names_differ, make_file_name
from locplan.errors import ConfigError, LocplanError


@dataclass(frozen=True)
class Place:
    name: str
    x: float
    heading: float
    loss: float
    error: Interval


COLUMNS = (
    TableColumn("name", title="place"),
    TableColumn("x", "m", "x"),
    TableColumn("heading", "rad", "heading", 0, "deg"),
    TableColumn("loss", "m", "loss", 1, "cm", signed=True),
    TableColumn("error", "m", "error", interval=True),
    TableColumn("twice", value=lambda place: 2 * place.x),
)
PLACES = (
    Place("[a] b", -0.001, math.pi / 2, 0.123, Interval(0.25, 0.2, 0.3)),
    Place("=1+1", 2.0, math.nan, math.inf, Interval(0.05, math.nan, math.nan)),
)
TABLE = Table.from_records(COLUMNS, PLACES, number="no.")
NAMES = ("number", "name", "x", "heading", "loss", "error", "error_low", "error_high", "twice")


def test_people_see_titles_units_and_digits():
    head, _, first, second = (line.split() for line in TABLE.text(width=200).splitlines())
    assert " ".join(head) == "no. place x [m] heading [deg] loss [cm] error [m]"
    assert " ".join(first) == "1 [a] b 0.00 90 +12.3 0.25 [0.20,0.30]"
    assert " ".join(second) == "2 =1+1 2.00 - - 0.050"


@pytest.mark.parametrize(
    ("column", "value", "text"),
    [
        (TableColumn("share", people="%", digits=0), 0.256, "26%"),
        (TableColumn("share", people="%", digits=0, interval=True), (0.5, 0.2, 0.8), "50% [20,80]"),
        (TableColumn("error", "m", interval=True), (0.0991, 0.09, 0.2), "0.099 [0.090,0.200]"),
        (TableColumn("error", "m", interval=True), (0.0999, 0.09, 0.2), "0.10 [0.09,0.20]"),
        (TableColumn("ratio", interval=True), (0.05, 0.04, 0.06), "0.05 [0.04,0.06]"),
        (TableColumn("error", "m", interval=True), (math.nan,) * 3, "-"),
        (TableColumn("x", "m"), 0.05, "0.05"),
        (TableColumn("drives", digits=0), 12, "12"),
    ],
)
def test_values_have_their_digits(column, value, text):
    assert column.text(Interval(*value) if column.interval else value) == text


def test_percent_sign_follows_values_not_heading():
    share = TableColumn("share", title="lost", people="%", interval=True)
    assert (share.heading, share.text(Interval(0.5, 0.0, 1.0))[:6]) == ("lost", "50.00%")
    assert share.names == ("share", "share_low", "share_high")


def test_table_columns_have_consistent_units():
    names = [each.name for each in pkgutil.walk_packages(locplan.__path__, "locplan.")]
    modules = [vars(import_module(name)) for name in names if "__main__" not in name]
    tuples = (value for module in modules for value in module.values() if type(value) is tuple)
    columns = {
        id(each): each for found in tuples for each in found if isinstance(each, TableColumn)
    }
    assert len(columns) > 100
    units = {"", "m", "rad", "s", "nat", "m² rad", "m² rad m"}
    for each in columns.values():
        assert each.unit in units, each
        assert each.title not in units - {""}, each
        assert each.unit == {"cm": "m", "deg": "rad", "%": ""}.get(each.people, each.unit), each


def test_table_text_fits_rows_and_width():
    assert "=1+1" not in TABLE.text(1)
    assert "=1+1" in str(TABLE)
    assert max(map(len, TABLE.text(width=50).splitlines())) <= 50
    assert len(TABLE) == 2


def test_table_breaks_lines_only_at_spaces():
    """Headings break before values do."""
    rates = Interval(1.0, 0.68, 1.0)
    columns = (
        TableColumn("name", title="path"),
        TableColumn(
            "share", title="off by > 2 m at some time", people="%", digits=0, interval=True
        ),
        TableColumn("error", "m", title="error of a drive", interval=True),
    )
    rows = (("localizability-aware", rates, rates), ("clear way around 2", rates, rates))
    table = Table(columns, rows)
    words = {word for row in rows for word in row[0].split()} | {"100%", "[68,100]", "[0.68,1.00]"}
    for width in (53, 60, 70, 100):
        text = table.text(width=width)
        assert words <= {*text.split()}, width
        assert max(map(len, text.splitlines())) <= width
    for line in table.text(width=70).splitlines()[-2:]:
        assert line.split()[-4:] == ["100%", "[68,100]", "1.00", "[0.68,1.00]"]


def test_csv_json_and_frame_agree(tmp_path):
    pytest.importorskip("pandas")
    TABLE.write_csv(tmp_path / "places.csv")
    with (tmp_path / "places.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    records, frame = TABLE.records(), TABLE.to_frame()
    assert TABLE.names == tuple(rows[0]) == tuple(records[0]) == tuple(frame.columns) == NAMES
    assert float(rows[0]["heading"]) == pytest.approx(records[0]["heading"]) == math.pi / 2
    assert frame["error_low"][0] == records[0]["error_low"] == float(rows[0]["error_low"]) == 0.2
    assert frame["number"].tolist() == [1, 2]
    assert frame["twice"][1] == 4.0


def test_unknown_values_are_empty_or_null(tmp_path):
    TABLE.write_csv(tmp_path / "places.csv")
    last = (tmp_path / "places.csv").read_text().splitlines()[-1]
    assert last == "2,'=1+1,2,,,0.05,,,4"
    unknown = {name for name, value in TABLE.records()[1].items() if value is None}
    assert unknown == {"heading", "loss", "error_low", "error_high"}
    assert json.dumps(TABLE.records(), allow_nan=False)


def test_geojson_has_closed_outlines_and_values(tmp_path):
    corners = [[0, 0], [1, 0], [1, 1]]
    TABLE.write_geojson(tmp_path / "places.geojson", [corners] * 2, frame="odom")
    made = json.loads((tmp_path / "places.geojson").read_text())
    assert made["name"] == "places"
    for feature, record in zip(made["features"], TABLE.records(), strict=True):
        assert feature["geometry"]["coordinates"] == [[*corners, corners[0]]]
        assert feature["properties"] == record | {"frame": "odom"}
    with pytest.raises(ValueError, match="zip"):
        TABLE.write_geojson(tmp_path / "places.geojson", [corners])


def test_data_frame_needs_pandas(monkeypatch):
    monkeypatch.setattr(public, "find_spec", lambda name: None)
    with pytest.raises(LocplanError, match=r"a data frame needs pandas: .*locplan\[tables\]"):
        TABLE.to_frame()


def test_table_text_is_plain_on_terminal(monkeypatch):
    for name, value in {"FORCE_COLOR": "1", "TERM": "xterm-256color"}.items():
        monkeypatch.setenv(name, value)
    assert "\x1b" not in TABLE.text()


class Drawn:
    def savefig(self, to, **options):
        to.write_bytes(b"PNG")


class Found(Result):
    files = ResultFiles("places", ("places.json", "places.png", "places.csv"))

    def table(self):
        return TABLE

    def figure(self, *about):
        return Drawn()

    def summary(self, seed=0):
        return {"places": self.table().records(), "seed": seed}

    def _write(self, folder, seed=0):
        Table(TABLE.columns, TABLE.rows[:seed]).write_csv(folder / "places.csv")


def test_result_saves_table_summary_and_picture(tmp_path):
    Found().save(tmp_path / "out", 1)
    assert len((tmp_path / "out" / "places.csv").read_text().splitlines()) == 2
    about = json.loads((tmp_path / "out" / "places.json").read_text())
    assert (about["seed"], about["places"]) == (1, TABLE.records())
    assert (tmp_path / "out" / "places.png").read_bytes() == b"PNG"
    (tmp_path / "out" / "places.csv").write_text("mine")
    with pytest.raises(LocplanError, match=r"places\.csv: was changed after"):
        Found().save(str(tmp_path / "out"))
    assert json.loads((tmp_path / "out" / "places.json").read_text())["seed"] == 1
    Found().save(tmp_path / "out", force=True)
    assert (tmp_path / "out" / "places.csv").read_text() != "mine"
    with pytest.raises(LocplanError, match="a folder of results must be a path"):
        Found().save(5)


@pytest.mark.parametrize(
    ("name", "file"),
    [
        ("a to b", "a-to-b"),
        ("C:\\maps", "C--maps"),
        ("con", "con-"),
        ("LPT1.old", "LPT1-.old"),
        ("console", "console"),
        ("..", "-"),
        ("dock.", "dock"),
    ],
)
def test_file_name_suits_every_system(name, file):
    """Windows has devices such as CON, and drops dots at the end."""
    assert make_file_name(name) == file


@pytest.mark.parametrize("other", ["dock a", "Dock-A", "DOCK/A"])
def test_names_with_equal_files_are_refused(other):
    check_file_names_differ("routes", ["dock a", "dock b"])
    with pytest.raises(ConfigError, match=r"^routes 'dock a' and .* would be saved as one file"):
        check_file_names_differ("routes", ["dock a", "b", other])
