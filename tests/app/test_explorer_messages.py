"""Questions of the page: values that are checked, and messages that are none."""

from __future__ import annotations

import pytest

from locplan.app.explorer.messages import Cancelled, CancelToken, Question, read_question
from locplan.errors import LocplanError

VALUES = {"n": 3, "x": "1", "far": [1e9, 0], "t": "a\u202eb", "big": 2**80, "nothing": None}


@pytest.mark.parametrize(
    ("name", "read"),
    [
        ("x", lambda q: q.number("x", 0, 5, None)),
        ("n", lambda q: q.number("n", 4, 5, None)),
        ("n", lambda q: q.choice("n", ("a", "b"), None)),
        ("n", lambda q: q.flag("n")),
        ("n", lambda q: q.text("n", None)),
        ("t", lambda q: q.text("t", None)),
        ("far", lambda q: q.position("far")),
        ("big", lambda q: q.number("big", 0, 5, None)),
        ("n", lambda q: q.mapping("n")),
        ("n", lambda q: q.items("n", 5)),
        ("n", lambda q: q.positions("n")),
    ],
)
def test_question_rejects_wrong_value_by_name(name, read):
    with pytest.raises(LocplanError, match=rf"^{name} must") as error:
        read(Question("plan", 1, VALUES))
    assert "\n" not in str(error.value)


def test_question_reads_default_for_null():
    question = Question("plan", 1, VALUES)
    assert question.number("n", 0, 5, None) == 3
    assert question.number("nothing", 0, 5, 2.5) == 2.5
    assert question.choice("nothing", ("a",), "a") == "a"
    assert question.text("nothing", "text") == "text"
    assert question.positions("nothing") == []
    assert not question.has("nothing")


def test_question_is_read_from_message():
    question = read_question('{"do": "at", "id": 7, "x": 1}', ["at"])
    assert (question.do, question.id, question.values["x"]) == ("at", 7, 1)
    with pytest.raises(LocplanError, match="do must be one of at") as error:
        read_question('{"do": "plan", "id": 7}', ["at"])
    assert error.value.number == 7


def test_cancelled_work_ends_at_check():
    is_over = []
    cancel = CancelToken(lambda: bool(is_over))
    cancel.check()
    is_over.append(True)
    with pytest.raises(Cancelled):
        cancel.check()
