"""Hostile command lines of all commands and options in hostile surroundings, see fuzz_commands."""

from __future__ import annotations

import random
import sys
from concurrent.futures import ThreadPoolExecutor

import fuzz_commands
import pytest

from locplan.cli import COMMANDS

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="it reads Linux's /proc")

SEED = 19


def test_every_command_and_option_is_fuzzed():
    declared = fuzz_commands.declared()
    assert {names[0] for names in declared} == set(COMMANDS)
    assert {"--robot", "--workers"} <= {option.name for option in declared["compare",]}
    seen = set()
    for number in range(8000):
        line = fuzz_commands.line_of(random.Random(f"{SEED} {number}"), declared)
        seen |= {(line[0], word.partition("=")[0]) for word in line}
    for names, options in declared.items():
        for option in options:
            if not option.positional:
                assert (names[0], option.name) in seen, f"{names} {option.name}"


def test_equal_seeds_make_equal_lines_and_surroundings():
    declared = fuzz_commands.declared()
    one, other = (
        (fuzz_commands.line_of(chance, declared), fuzz_commands.surroundings_of(chance))
        for chance in (random.Random("7 1"), random.Random("7 1"))
    )
    assert one == other


def test_all_surroundings_are_drawn():
    drawn = [fuzz_commands.surroundings_of(random.Random(n)) for n in range(4000)]
    for name, values in fuzz_commands.VARIABLES.items():
        assert {each["variables"].get(name) for each in drawn} == {None, *values}
    for number, kinds in enumerate(fuzz_commands.STREAMS):
        assert {each["streams"][number] for each in drawn} == {None, *kinds}
    assert {each["out"] for each in drawn} == {None, *fuzz_commands.OUT}
    assert {each["file_size"] for each in drawn} == {None, *fuzz_commands.FILE_SIZES}


def around(stdin=None, stdout=None, stderr=None, out=None, file_size=None, **variables):
    streams = [stdin, stdout, stderr]
    return {"variables": variables, "streams": streams, "out": out, "file_size": file_size}


def test_lines_run_in_their_surroundings():
    field = ["field", "in/room.yaml", "-o", "out/result.zarr", "--estimator", "sad"]
    drawn = ["field", "in/room.yaml", "-o", "out/result.pdf"]
    maps = ["info", "hall", "-o", "out/maps"]
    served = fuzz_commands.Served()
    try:
        for line, where, code, words in (
            (["--version"], around(), "0", ""),
            (["info", "in/room.yaml"], around(stdout="full"), "1", "No space left"),
            (["info", "in/absent"], around(LC_ALL="C", COLUMNS="7"), "2", "in/absent"),
            (["info", "in/absent"], around(stderr="full"), "2", ""),
            (maps, around(stdin="closed", stderr="full"), "1", ""),
            (maps, around(file_size=0), "2", "File too large"),
            (drawn, around(file_size=5000), "2", "cannot be written"),
            (field, around(out="in/empty"), "2", "out"),
        ):
            answer = served.run(line, where)
            assert (answer["code"], answer["faults"]) == (code, []), answer
            assert words in answer["stderr"]
    finally:
        served.close()


def test_what_a_line_leaves_or_changes_is_found(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "in").mkdir()
    (tmp_path / "in/map").write_text("a")
    before = fuzz_commands.contents(tmp_path)
    (tmp_path / "in/map").write_text("b")
    for name in ("out.csv", "other", ".out-abcd1234.csv", "out.partial"):
        (tmp_path / name).write_text("")
    may = [str(tmp_path / "out"), str(tmp_path / "in/map")]
    found = list(fuzz_commands.changes(before, fuzz_commands.contents(tmp_path), may))
    expected = ["left '.out-abcd1234.csv'", "changed 'in/map'", "changed 'other'"]
    assert found == [*expected, "left 'out.partial'"]


@pytest.mark.parametrize(
    ("code", "out", "err", "logged", "found"),
    [
        (0, "a table", "wrote out/x\n", "", []),
        (2, "", "locplan: error: no\n", "", []),
        (-11, "", "", "", ["exit code -11"]),
        (2, "", "locplan: error: no\nsecond\n", "", ["no single line"]),
        (2, "", "", "", ["no single line"]),
        (0, "", "RuntimeWarning: overflow\n", "", ["warning", "more on stderr"]),
        (0, "", "", "RuntimeWarning: overflow\n", ["hidden warning"]),
        (1, "", "Traceback (most\n", "", ["traceback", "no single line"]),
        (1, None, None, "", []),
        (120, None, None, "", ["exit code 120"]),
    ],
)
def test_faults_of_an_outcome_are_told(code, out, err, logged, found):
    assert list(fuzz_commands.faults(code, out, err, logged)) == found


def test_a_line_may_end_without_a_word_where_nobody_reads_it():
    assert not list(fuzz_commands.faults(1, None, "", "", broken=True))
    assert list(fuzz_commands.faults(1, None, "", "")) == ["no single line"]
    assert list(fuzz_commands.faults(1, None, "a\nb\n", "", broken=True)) == ["no single line"]


def test_command_lines_end_in_a_result_or_in_one_line():
    answers = fuzz_commands.fuzz(20, SEED, leave_out=("compare",))
    faulty = [fuzz_commands.shown(each) for each in answers if each["faults"]]
    assert not faulty, "\n".join(faulty)


@pytest.mark.long
def test_many_command_lines_end_in_a_result_or_in_one_line():
    with ThreadPoolExecutor() as pool:  # each waits for a process of its own
        halves = pool.map(lambda n: fuzz_commands.fuzz(1000, SEED + 1, first=n), (0, 1000))
        answers = [each for half in halves for each in half]
    faulty = [fuzz_commands.shown(each) for each in answers if each["faults"]]
    assert not faulty, "\n".join(faulty)
