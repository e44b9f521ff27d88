"""What commands print on standard error."""

import logging
import sys
import warnings
from unittest.mock import Mock

import pytest
from support.command_line import check_refusal
from support.maps import ascii_map

import locplan
from locplan._support import progress
from locplan.app.cli.log import LineHandler, show_log
from locplan.maps.files import MapWarning

LOG = logging.getLogger("locplan.field.cache")


@pytest.fixture
def room(tmp_path):
    grid = ascii_map("#" * 10, *["#........#"] * 6, "#" * 10, resolution=0.5)
    locplan.save_map(grid, tmp_path / "room.yaml")
    return tmp_path / "room.yaml"


def test_package_alone_prints_nothing(capfd):
    """Without a handler, Python prints warnings."""
    LOG.warning("the result is not cached")
    assert logging.NullHandler in map(type, logging.getLogger("locplan").handlers)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize(
    ("is_verbose", "expected"),
    [
        (False, ["locplan: one", "locplan: warning: two --max-e"]),
        (
            True,
            [
                "locplan.field.cache: none",
                "locplan: one",
                "locplan: warning: two --max-e",
                "locplan: ompl",
                "other: warning: three",
                "locplan.app.cli: UserWarning: four",
            ],
        ),
    ],
)
def test_log_is_one_line_per_message(capsys, monkeypatch, is_verbose, expected):
    monkeypatch.setattr(sys, "argv", ["locplan", "plan"])
    with show_log(is_verbose=is_verbose):
        LOG.debug("none")
        LOG.info("one")
        LOG.warning("two %s", "max_e")
        logging.getLogger("locplan.ompl").info("ompl")
        logging.getLogger("other").warning("three")
        warnings.warn("four", stacklevel=1)
    assert capsys.readouterr().err.splitlines() == expected


def test_repeated_warning_is_logged_once(capsys):
    with show_log(is_verbose=False):
        for _ in range(2):
            warnings.warn(MapWarning("m.yaml: odd"), stacklevel=1)
    assert capsys.readouterr().err == "locplan: warning: m.yaml: odd\n"


def test_command_restores_log_settings(room, run):
    names = "locplan", "locplan.ompl", None
    before = [(logging.getLogger(name).level, logging.getLogger(name).handlers) for name in names]
    before = [(level, list(handlers)) for level, handlers in before]
    run("-v", "info", room)
    check_refusal(run("-v", "info", room.with_name("none.yaml")))
    after = [(logging.getLogger(name).level, logging.getLogger(name).handlers) for name in names]
    assert after == before


def test_full_disk_ends_log_quietly(monkeypatch, capsys):
    class Full:
        def write(self, _):
            raise OSError(28, "No space left on device")

        flush = write

    monkeypatch.setattr(sys, "stderr", Full())
    record = logging.LogRecord("locplan", logging.INFO, "", 0, "one", None, None)
    LineHandler().emit(record)
    assert sys.stderr is None
    LineHandler().emit(record)
    assert capsys.readouterr().out == ""  # which belongs to the result


@pytest.mark.parametrize(
    ("error", "line"),
    [
        (OSError("matplotlib needs a folder"), "matplotlib needs a folder"),
        (OSError(28, "No space left on device"), "the output: No space left on device"),
        (OSError(28, "No space left on device", "a.png"), "a.png: No space left on device"),
    ],
)
def test_system_error_is_one_line(run, monkeypatch, error, line):
    monkeypatch.setattr("locplan.app.cli.run_tokens", Mock(side_effect=error))
    assert run("info") == (1, "", f"locplan: error: {line}\n")


@pytest.mark.parametrize("position", [0, 2])
def test_verbose_shows_settings_and_times(run, room, position):
    words = ["field", room]
    words.insert(position, "--verbose")
    _, _, err = run(*words)
    assert "locplan.app.cli: field: FieldConfig(" in err
    assert f"{progress.__name__}: computing the field of room: " in err
    assert run("field", room)[2] == ""


def test_long_steps_are_lines_without_terminal(run, room, monkeypatch):
    """Files and continuous integration take neither bars nor colours."""
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setattr(progress.threading, "Timer", ImmediateTimer)
    _, _, err = run("field", room)
    assert err == "locplan: computing the field of room\n"


class ImmediateTimer:
    """A timer whose time is over at once."""

    def __init__(self, _, function):
        self.start = function

    def cancel(self):
        pass

    def join(self):
        pass
