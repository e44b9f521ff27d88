"""The command line: checks of its output, and its start in another process."""

from __future__ import annotations


def check_refusal(result) -> str:
    code, out, err = result
    assert code == 2
    assert out == ""
    assert err.startswith("locplan: error: ")
    assert err.count("\n") == 1
    return err


TERMINAL_CODE = (
    "import signal; signal.signal(signal.SIGINT, signal.default_int_handler);"
    "from locplan.__main__ import main; main()"
)
"""The command; a process in the background may have inherited that SIGINT is ignored."""
