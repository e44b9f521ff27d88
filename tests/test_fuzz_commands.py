"""Command lines of all commands and options with valid and hostile values, see fuzz_commands."""

from __future__ import annotations

import random
import sys

import fuzz_commands
import pytest

from locplan.cli._application import COMMANDS

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="it reads Linux's /proc")

SEED = 19


def test_every_command_and_option_is_fuzzed():
    declared = fuzz_commands.declared()
    assert {names[0] for names in declared} == set(COMMANDS)
    assert {"--range", "--workers"} <= {option.name for option in declared["compare",]}
    seen = set()
    for number in range(8000):
        line = fuzz_commands.line_of(random.Random(f"{SEED} {number}"), declared)
        seen |= {(line[0], word.partition("=")[0]) for word in line}
    for names, options in declared.items():
        for option in options:
            if not option.positional:
                assert (names[0], option.name) in seen, f"{names} {option.name}"


def test_equal_seeds_make_equal_lines():
    declared = fuzz_commands.declared()
    one, other = (fuzz_commands.line_of(random.Random("7 1"), declared) for _ in range(2))
    assert one == other


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
    ],
)
def test_faults_of_an_outcome_are_told(code, out, err, logged, found):
    assert list(fuzz_commands.faults(code, out, err, logged)) == found


def test_command_lines_end_in_a_result_or_in_one_line():
    answers = fuzz_commands.fuzz(30, SEED, leave_out=("compare",))
    faulty = [fuzz_commands.shown(each) for each in answers if each["faults"]]
    assert not faulty, "\n".join(faulty)


@pytest.mark.long
def test_many_command_lines_end_in_a_result_or_in_one_line():
    answers = fuzz_commands.fuzz(2000, SEED + 1)
    faulty = [fuzz_commands.shown(each) for each in answers if each["faults"]]
    assert not faulty, "\n".join(faulty)
