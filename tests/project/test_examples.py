import functools
import importlib.util
import shlex
import sys
from pathlib import Path

import pytest
from support.machine import SHARED_DATA
from support.maps import ascii_map

import locplan
from locplan.simulation import RecommendationSettings

EXAMPLES = sorted((Path(__file__).resolve().parents[2] / "examples").glob("*.py"))

MAP = str(EXAMPLES[0].parent.parent / "maps" / "two_corridors.yaml")
QUICKLY = {
    "animation": (10.0, 4),
    "compare": (0.05,),
    "gallery": (MAP, "turtlebot4", "info.png", "paper_e.png"),
    "explorer_picture": ("two_corridors",),
    "ground_truth": (("seattle",),),
    "levels": ("", ("two_corridors",), 1, 1),
    "paper": (0.1, 1, ("paper",)),
    "places": ((MAP,), 4, 2),
    "routes": ((MAP,), 6, 1),
}
"""Arguments with which a program is done soon."""
LONG = (
    *("animation", "cluster", "compare", "estimators", "explorer_picture", "gallery"),
    *("ground_truth", "lasers", "levels", "navigation", "ompl_program", "paper", "places"),
    *("recorded_drive", "reference", "routes"),
)
"""What these do has tests of its own."""
OF_LOGS = ("ground_truth", "lasers")
"""Programs that read the laser logs."""


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize(
    "path",
    [
        pytest.param(path, marks=[pytest.mark.long] * (path.stem in LONG))
        for path in EXAMPLES
        if path.stem != "site"  # test_site.py builds the site once for all of its tests
    ],
    ids=lambda path: path.stem,
)
def test_example_runs_and_writes_its_results(path, tmp_path, capsys, monkeypatch):
    module = load_example(path.stem, monkeypatch)
    if path.stem in OF_LOGS and not (SHARED_DATA / "carmen").is_dir():
        pytest.skip("the laser logs (../shared/data/carmen) are not here")
    if path.stem == "explorer_picture":
        pytest.importorskip("starlette", reason="the explorer's server is not installed")
        pytest.importorskip("playwright", reason="playwright is not installed")
        if module.find_browser() is None:
            pytest.skip("no chromium on this machine")
    monkeypatch.setattr(
        locplan,
        "recommend_path",
        functools.partial(locplan.recommend_path, settings=RecommendationSettings(drives=4)),
    )
    data = (str(SHARED_DATA),) if path.stem in OF_LOGS else ()
    module.main(*data, str(tmp_path / "out"), *QUICKLY.get(path.stem, ()))
    assert capsys.readouterr().out
    assert any((tmp_path / "out").iterdir())


def load_example(name, monkeypatch):
    monkeypatch.syspath_prepend(EXAMPLES[0].parent)  # programs of the evidence share one
    spec = importlib.util.spec_from_file_location(name, EXAMPLES[0].parent / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    monkeypatch.setitem(sys.modules, name, module)  # dataclasses look for their module
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def gallery(monkeypatch):
    """The gallery as a module."""
    return load_example("gallery", monkeypatch)


def test_gallery_quotes_map_path(gallery):
    file = "/my maps/it's.yaml"
    given = dict.fromkeys(("lidar", "start", "goal", "middle"), "1,2")
    files = dict.fromkeys(("map", "driven", "drive", "examples"), shlex.quote(file))
    programs = 0
    for entry in gallery.ENTRIES:
        words = shlex.split(entry.command.format(**given, **files))
        if words[:2] == ["python", "-c"]:
            programs += 1
            compile(words[2], entry.title, "exec")
            assert ("sys.argv[1]" in words[2]) == (words[3:] == [file])
        elif "{map}" in entry.command:
            assert file in words
    assert programs >= 3


@pytest.mark.long
def test_gallery_shows_pictures_with_commands(gallery, tmp_path, capsys):
    module = gallery
    module.main(str(tmp_path), MAP, "turtlebot4", "info.png", "paper_e.png")
    page = (tmp_path / "index.md").read_text("utf-8")
    assert page.count("\n## ") == page.count("\n![") == 2
    assert "```sh\nlocplan info two_corridors -o info.png\n```" in page
    assert "drew paper_e.png" in capsys.readouterr().out
    pictures = [entry.picture for entry in module.ENTRIES]
    assert len(set(pictures)) == len(pictures)


def test_there_are_examples():
    assert EXAMPLES


def test_ompl_program_rejects_approximate_path(monkeypatch):
    """OMPL itself returns a path that ends near the goal, which was once printed with its J."""
    from ompl import base

    from locplan.planning import ompl

    program = load_example("ompl_program", monkeypatch)
    motions = ompl.Motions(locplan.Costmap.blank(ascii_map("." * 9, "#" * 9, "." * 9)))
    information = ompl.space_information(motions)
    problem = ompl.problem_definition(information, motions, (0.5, 0.5), (7.5, 2.5))
    iterations = iter(range(200))
    limit = base.PlannerTerminationCondition(lambda: next(iterations, None) is None)
    assert program.find_path(information, problem, limit) is None
    assert problem.hasApproximateSolution()
