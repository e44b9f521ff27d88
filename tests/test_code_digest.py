"""Edited code never finds an older result: fields in the cache, and runs in a journal."""

import functools
import importlib
import os
import subprocess
import sys
import threading
import types

import numba
import numpy as np
import pytest
from conftest import drawn

import locplan
from locplan._util.code_digest import code_digest
from locplan.comparison import PlannerSpec
from locplan.errors import LocplanError
from locplan.field import _compute as computing, _store as store, _zarr as field_files

FILES = {
    "own_parts": """
import types
deeper = types.ModuleType("own_deeper")
deeper.PART = 1.0
""",
    "own_helpers": """
import collections
import own_parts
SCALE = 1.0
ORDERED = collections.OrderedDict(factor=1.0)
QUEUE = collections.deque([1.0])
TABLE = {"factor": 1.0}
KINDS = {"a", "b", "c", "d"}
Plain = type("Plain", (), {"factor": 1.0, "__call__": lambda self: self.factor})

def called(*, factor=1.0):
    factor *= ORDERED["factor"] * QUEUE[0] * own_parts.deeper.PART
    return factor * sum(inner() for _ in "a") * TABLE["factor"] * len(KINDS) / 4

def inner():
    return 1.0 * plain()

plain = Plain()

def imported():
    return 1.0
""",
    "own_parents": """
from dataclasses import dataclass
from locplan.field import Estimator, SearchWindow
from own_helpers import SCALE

@dataclass(frozen=True, kw_only=True, repr=False)
class Parent(Estimator):
    reach = 1.0
    summary = "own"

    def lattice(self, resolution):
        return SearchWindow().on(resolution)

    def halo(self, resolution, map_shape):
        return 0

    def inherited(self):
        return 1.0 * SCALE
""",
    "own_estimators": """
import functools
import importlib
from dataclasses import dataclass
import numpy as np
import own_helpers
from own_helpers import called
from own_parents import Parent

def closing(factor):
    def closed(default=1.0):
        return factor * default
    return closed

closed = closing(1.0)
bound = functools.partial(lambda x: 1.0 * x, 1.0)

def decorated(function):
    @functools.wraps(function)
    def wrapper(*given):
        return function(*given)
    return wrapper

class Mine(Parent):
    name = "mine"
    attribute = staticmethod(lambda: 1.0)

    @property
    def own(self):
        return 1.0

    @classmethod
    def of_class(cls):
        return 1.0

    @decorated
    def covariances(self, part):
        from own_helpers import imported
        factor = 1.0 * called() * closed() * bound() * imported() * own_helpers.SCALE
        factor *= self.inherited() * self.attribute() * self.own * self.of_class()
        return {"covariance": factor * np.ones((len(part.rows), 1, 1)) * np.eye(3)}
""",
}
"""Modules of a user with an estimator whose covariances are 1 times all that it computes with."""
EDITS = {
    "its body": ("own_estimators", "1.0 * called()", "2.0 * called()"),
    "a parent elsewhere": ("own_parents", "1.0 * SCALE", "2.0 * SCALE"),
    "a constant": ("own_helpers", "SCALE = 1.0", "SCALE = 2.0"),
    "a module of a module": ("own_parts", "PART = 1.0", "PART = 2.0"),
    "a dictionary of another kind": ("own_helpers", "(factor=1.0)\n", "(factor=2.0)\n"),
    "an element of a queue": ("own_helpers", "[1.0]", "[2.0]"),
    "a keyword's default": ("own_helpers", "*, factor=1.0", "*, factor=2.0"),
    "a table": ("own_helpers", '{"factor": 1.0}', '{"factor": 2.0}'),
    "a set": ("own_helpers", '"d"}', '"d", "e"}'),
    "a function of a function": ("own_helpers", "1.0 * plain()", "2.0 * plain()"),
    "a class of an object": ("own_helpers", '"factor": 1.0, "__', '"factor": 2.0, "__'),
    "what its body imports": ("own_helpers", "():\n    return 1.0\n", "():\n    return 2.0\n"),
    "a closure": ("own_estimators", "closing(1.0)", "closing(2.0)"),
    "a default": ("own_estimators", "default=1.0", "default=2.0"),
    "a lambda": ("own_estimators", "1.0 * x", "2.0 * x"),
    "an argument of a partial": ("own_estimators", "x, 1.0)", "x, 2.0)"),
    "a static method": ("own_estimators", "(lambda: 1.0)", "(lambda: 2.0)"),
    "a property": (
        "own_estimators",
        "own(self):\n        return 1",
        "own(self):\n        return 2",
    ),
    "a class method": ("own_estimators", "(cls):\n        return 1", "(cls):\n        return 2"),
    "a decorator": (
        "own_estimators",
        "return function(*given)",
        "return {name: 2.0 * each for name, each in function(*given).items()}",
    ),
}


def own_modules(monkeypatch, *edit: str) -> types.ModuleType:
    """The modules above as of now, without files; one text of one module may be another."""
    for name, source in FILES.items():
        if edit and name == edit[0]:
            assert source.count(edit[1]) == 1
            source = source.replace(*edit[1:])
        module = types.ModuleType(name)
        monkeypatch.setitem(sys.modules, name, module)
        exec(compile(source, f"<{name}>", "exec"), module.__dict__)
    return sys.modules["own_estimators"]


@pytest.fixture
def grid() -> locplan.OccupancyGrid:
    return drawn("#" * 12, *["#" + "." * 10 + "#"] * 6, "#" * 12, resolution=0.25)


@pytest.fixture
def computed(monkeypatch) -> list[int]:
    """How many points each tile computed had."""
    calls, compute = [], computing.compute

    def spy(engine, estimator, part):
        calls.append(len(part.rows))
        return compute(engine, estimator, part)

    monkeypatch.setattr(computing, "compute", spy)
    return calls


@pytest.mark.parametrize("edit", EDITS.values(), ids=EDITS)
def test_an_edited_estimator_gets_no_old_field(grid, tmp_path, monkeypatch, computed, edit):
    def load(*edit):
        estimator = own_modules(monkeypatch, *edit).Mine()
        return locplan.load_or_compute(grid, estimator, cache_dir=tmp_path).covariance

    before = load()
    assert computed == [60]
    np.testing.assert_array_equal(load(), before)
    assert computed == [60]
    after = load(*edit)
    assert computed == [60, 60]
    assert not np.array_equal(after, before, equal_nan=True)
    np.testing.assert_array_equal(load(), before)
    assert computed == [60, 60]


def test_lines_comments_and_annotations_make_no_other_field(grid, monkeypatch):
    def path(*edit):
        config = locplan.FieldConfig(own_modules(monkeypatch, *edit).Mine())
        return store.field_path(grid, config)

    assert path() == path("own_helpers", "def inner():", "\n\n# twice as far\ndef inner() -> int:")
    assert path() == path("own_estimators", "class Mine(", "class Unused: pass\n\nclass Mine(")


def test_an_edited_estimator_within_one_of_ours_gets_no_old_field(grid):
    lidar = locplan.Lidar(range=3.0, beams=30)

    def path(factor):
        class Mine(locplan.Scan):
            def covariances(self, part):
                values = super().covariances(part)
                return values | {"covariance": factor * values["covariance"]}

        return store.field_path(grid, locplan.FieldConfig(locplan.Fused(lidar, scan=Mine(lidar))))

    assert path(1.0) == path(1.0) != path(2.0)


def test_our_own_estimators_are_found_by_their_settings_alone(grid, monkeypatch):
    asked = []
    monkeypatch.setattr(field_files, "code_digest", lambda *_: asked.append(1))
    for estimator in (locplan.Sad(), locplan.Fused(locplan.Lidar())):
        store.field_path(grid, locplan.FieldConfig(estimator))
    assert not asked


def test_what_cannot_be_digested_is_computed_and_not_cached(grid, tmp_path, monkeypatch, computed):
    module = own_modules(monkeypatch)
    module.closed.lock = threading.Lock()
    expected = r"the field is not cached: estimator 'mine': .* type _thread.lock cannot be digested"
    for _ in range(2):
        with pytest.warns(store.CacheWarning, match=expected):
            field = locplan.load_or_compute(grid, module.Mine(), cache_dir=tmp_path)
    assert computed == [60, 60]
    assert field.evaluated.sum() == 60
    assert not list(tmp_path.iterdir())


SCRIPT = """
import dataclasses, functools, re
import numpy as np
from scipy.special import erf
from locplan._util.code_digest import code_digest
from locplan.field import Sad

WORDS = {"a", "b", "c", "d", "e"}
LOOKED_UP = re.compile("a+"), np.arange(4.0), np.hypot, erf

@functools.lru_cache
def remembered(x):
    return x in {"p", "q", "r"} or WORDS

@dataclasses.dataclass(frozen=True, kw_only=True)
class Mine(Sad):
    words: frozenset = frozenset(WORDS)
    sentinel: object = dataclasses.field(default_factory=object)

    @functools.cached_property
    def lazy(self):
        return id(self)

    def covariances(self, part):
        def nested():
            return [remembered(x) for x in LOOKED_UP]
        return nested(), super().covariances(part)

mine = Mine()
first = code_digest(mine, [Mine])
mine.lazy
for _ in range(100):
    remembered("p")
assert code_digest(mine, [Mine]) == first
print(first)
"""


def test_digests_are_those_of_other_processes_and_of_code_without_a_file():
    digests = {
        subprocess.run(
            [sys.executable, "-c", SCRIPT],
            check=True,
            capture_output=True,
            text=True,
            env={**os.environ, "PYTHONHASHSEED": seed},
        ).stdout
        for seed in ("1", "2")
    }
    assert len(digests) == 1


def test_code_is_the_same_in_a_script_and_in_a_module():
    def digest(module):
        scope = {"__name__": module}
        exec("class Own:\n    def own(self):\n        return 1", scope)
        return code_digest(scope["Own"](), [scope["Own"]])

    assert digest("__main__") == digest("own_module")


def test_installed_code_is_followed_where_it_is_what_computes(tmp_path, monkeypatch):
    folder = tmp_path / "site-packages"
    folder.mkdir()
    monkeypatch.syspath_prepend(folder)

    def own(value):
        (folder / "own_installed.py").write_text(f"def helper(): return {value:6}\n")
        monkeypatch.delitem(sys.modules, "own_installed", raising=False)
        monkeypatch.setattr(sys, "dont_write_bytecode", True)
        return importlib.import_module("own_installed").helper

    def digests(value):
        helper = own(value)
        return code_digest(helper, [helper]), code_digest(lambda: helper, [])

    (followed, named), (edited, still_named) = digests(1), digests(2)
    assert followed != edited
    assert named == still_named


def test_compiled_functions_are_known_by_what_they_compile():
    def digest(factor, **options):
        compiled = numba.njit(**options)(lambda x: x)
        compiled.py_func.__defaults__ = (factor,)
        return code_digest(lambda: compiled, [])

    assert digest(1.0) == digest(1.0)
    assert len({digest(1.0), digest(2.0), digest(1.0, fastmath=True)}) == 3
    ufuncs = [numba.vectorize(each) for each in (lambda x: x + 1, lambda x: x + 1, lambda x: x + 2)]
    one, same, other = (code_digest(functools.partial(each), []) for each in ufuncs)
    assert one == same != other
    with pytest.raises(LocplanError, match=r"type numpy.ufunc cannot be digested"):
        code_digest(np.frompyfunc(lambda x: x, 1, 1), [])


def test_things_that_lead_to_each_other_are_digested():
    def even(n):
        return n == 0 or odd(n - 1)

    def odd(n):
        return n > 0 and even(n - 1)

    chain = None
    for _ in range(5000):  # deeper than calls may be
        chain = [chain]
    assert code_digest([even, chain], []) != code_digest([odd, chain], [])


PLANNER = """
import locplan

class Base:
    name, minimises, space = "own", "J", "R2"
    check = prepare = lambda self: None

    def solve(self, costs, start, goal):
        return locplan.planners.Found(locplan.Path([start, goal]))
"""


def test_an_edited_parent_of_a_planner_in_another_module_is_another_planner(monkeypatch):
    monkeypatch.setitem(sys.modules, "cloudpickle", None)  # nothing is needed to tell planners

    def identity(source, limits=None):
        module = types.ModuleType("own_base")
        monkeypatch.setitem(sys.modules, "own_base", module)
        exec(source, module.__dict__)

        class Mine(module.Base):
            pass

        planner = locplan.planners.planner_for(Mine(), **(limits or {}))
        return PlannerSpec("mine", planner).identity()

    edited = PLANNER.replace("[start, goal]", "[start, start, goal]")
    for limits in ({}, {"via": [(1.0, 2.0)]}):
        assert identity(PLANNER, limits) == identity(PLANNER, limits) != identity(edited, limits)


def test_a_planner_that_cannot_be_digested_is_never_the_same():
    lock = threading.Lock()

    def mine(costs, start, goal):
        return lock

    spec = PlannerSpec.of(mine)
    assert spec.identity() != spec.identity()
