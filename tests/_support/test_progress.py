import threading

import pytest

from locplan._support.progress import show_spinner


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


@pytest.mark.parametrize("terminal", [True, False])
def test_a_terminal_shows_what_is_done(at_once, monkeypatch, capsys, terminal):
    if terminal:
        monkeypatch.setenv("FORCE_COLOR", "1")
    else:
        monkeypatch.delenv("FORCE_COLOR", raising=False)
        monkeypatch.setattr(threading, "Timer", None)  # none is made
    with show_spinner("drawing"):
        pass
    out, err = capsys.readouterr()
    assert out == ""
    assert ("drawing" in err) == terminal
    assert err == "" or err.endswith("\x1b[2K")  # the line is taken away again


def test_nothing_is_shown_of_what_is_done_soon(at_once, monkeypatch, capsys):
    at_once[0] = False
    monkeypatch.setenv("FORCE_COLOR", "1")
    with show_spinner("drawing"):
        pass
    assert capsys.readouterr().err == ""


def test_it_ends_with_an_error(at_once, monkeypatch, capsys):
    monkeypatch.setenv("FORCE_COLOR", "1")
    with pytest.raises(ValueError, match="no"), show_spinner("drawing"):
        raise ValueError("no")
    assert capsys.readouterr().err.endswith("\x1b[2K")
