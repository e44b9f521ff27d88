import logging
import sys
import threading
from types import SimpleNamespace

import pytest

from locplan._support import progress
from locplan._support.progress import show_progress_bar, show_spinner


@pytest.fixture
def at_once(monkeypatch):
    """Timers whose time comes as soon as they are started, or never."""
    allowed = [True]

    class Timer(threading.Thread):
        def __init__(self, _: float, action) -> None:
            super().__init__(target=action if allowed[0] else lambda: None)

        def start(self) -> None:
            super().start()
            self.join()

        def cancel(self) -> None:
            pass

    monkeypatch.setattr(threading, "Timer", Timer)
    return allowed


@pytest.fixture
def terminal(monkeypatch):
    monkeypatch.setattr(progress, "is_terminal", lambda: True)


@pytest.fixture
def log(caplog):
    caplog.set_level(logging.INFO, "locplan")
    return caplog


@pytest.mark.usefixtures("at_once", "terminal")
def test_terminal_shows_work_until_it_ends(capsys, log):
    with show_spinner("drawing"):
        pass
    out, err = capsys.readouterr()
    assert out == ""
    assert "drawing" in err
    assert err.endswith("\x1b[2K")  # the line is taken away again
    assert not log.records


@pytest.mark.usefixtures("at_once")
def test_work_is_logged_once_without_terminal(capsys, log, monkeypatch):
    """Continuous integration sets FORCE_COLOR, and writes to a file."""
    monkeypatch.setenv("FORCE_COLOR", "1")
    with show_spinner("drawing"):
        pass
    with show_progress_bar("simulating", "drives") as report:
        report(1, 2)
        report(2, 2)
    assert log.messages == ["drawing", "simulating"]
    assert capsys.readouterr() == ("", "")


def test_duration_is_logged_as_detail(caplog):
    caplog.set_level(logging.DEBUG, "locplan")
    with pytest.raises(ValueError, match="no"), show_spinner("drawing"):
        raise ValueError("no")
    (message,) = caplog.messages
    assert message.startswith("drawing: ")


@pytest.mark.usefixtures("terminal")
def test_short_work_is_not_shown(at_once, capsys):
    at_once[0] = False
    with show_spinner("drawing"):
        pass
    assert capsys.readouterr().err == ""


def test_short_work_is_not_logged(at_once, log):
    at_once[0] = False
    with show_spinner("drawing"):
        pass
    assert not log.records


@pytest.mark.usefixtures("at_once", "terminal")
def test_display_ends_with_error(capsys):
    with pytest.raises(ValueError, match="no"), show_spinner("drawing"):
        raise ValueError("no")
    assert capsys.readouterr().err.endswith("\x1b[2K")


def test_dumb_terminal_gets_lines(monkeypatch):
    monkeypatch.setattr(sys, "stderr", SimpleNamespace(isatty=lambda: True))
    monkeypatch.setenv("TERM", "xterm")
    assert progress.is_terminal()
    monkeypatch.setenv("TERM", "dumb")
    assert not progress.is_terminal()


@pytest.mark.parametrize("stream", [None, SimpleNamespace(isatty=lambda: False)])
def test_redirected_stderr_is_no_terminal(monkeypatch, stream):
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setattr(sys, "stderr", stream)
    assert not progress.is_terminal()
