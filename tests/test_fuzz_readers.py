"""No reader does with a hostile file what it must not: it reads it, or says why not in one line.

`python tests/hostile_files.py READER SEED` runs a case that failed, and shows its file.
"""

import os
import signal
import sys

import pytest
from hostile_files import READERS, Bench, Fault, Reader, alarm, damaged, lines, run_all

from locplan.errors import LocplanError

FEW, MANY = 400, int(os.environ.get("LOCPLAN_FUZZ_CASES", "20000"))
"""Number of cases of a usual run, and of a long one."""

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="Windows has no alarms")


@pytest.mark.parametrize("count", [FEW, pytest.param(MANY, marks=pytest.mark.long)])
def test_hostile_files_are_read_or_refused_in_one_line(count):
    outcomes, faults = run_all(count)
    assert not faults, "\n".join(map(str, faults[:20]))
    assert all(outcomes.values())


def test_a_case_follows_from_its_reader_and_its_seed(tmp_path):
    bench = Bench(tmp_path)
    for name in READERS:
        bench.run(name, 1)
        assert damaged(name, 7, bench.valid[name]) == damaged(name, 7, bench.valid[name])


def fails(error):
    def read(folder):
        raise error

    return read


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (OverflowError("int too large"), "OverflowError: int too large"),
        (RecursionError("too deep"), "RecursionError"),
        (MemoryError("no room"), "MemoryError"),
        (RuntimeWarning("overflow in exp"), "RuntimeWarning"),
    ],
)
def test_what_must_not_be_is_found(tmp_path, monkeypatch, error, words):
    monkeypatch.setitem(READERS, "own", Reader(lines("a", "1"), "a", fails(error)))
    with pytest.raises(Fault, match=f"^own 3: {words}"):
        Bench(tmp_path).run("own", 3)


def test_long_lines_are_found(tmp_path, monkeypatch):
    class Long(LocplanError):
        def __str__(self):
            return "a" * 1051

    monkeypatch.setitem(READERS, "own", Reader(lines("a", "1"), "a", fails(Long("a"))))
    with pytest.raises(Fault, match="a message of 1051 characters"):
        Bench(tmp_path).run("own", 3)


@pytest.mark.parametrize("clock", ["SIGALRM", "SIGPROF"])
def test_what_does_not_end_is_ended(clock):
    with pytest.raises(TimeoutError), alarm():
        signal.raise_signal(signal.Signals[clock])
