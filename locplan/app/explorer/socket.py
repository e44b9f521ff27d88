"""Socket of a page: receives questions, sends answers and events."""

from __future__ import annotations

import asyncio
import itertools
import json
from collections.abc import Coroutine, Mapping
from concurrent.futures import Executor
from contextlib import suppress
from typing import Any

from starlette.websockets import WebSocket, WebSocketDisconnect

from locplan._support.checks import check_integer
from locplan._support.tables import nan_to_none
from locplan.app.explorer.messages import (
    BadMessage,
    Cancelled,
    CancelToken,
    Question,
    QuestionJob,
    format_sentence,
    read_question,
)
from locplan.app.explorer.questions import QUESTIONS
from locplan.app.explorer.session import Session
from locplan.app.explorer.state import describe_state
from locplan.errors import LocplanError, format_one_line


class PageSocket:
    """Socket of one page, which numbers its questions."""

    def __init__(self, session: Session, lanes: Mapping[str, Executor], socket: WebSocket) -> None:
        self._session, self._lanes, self._socket = session, lanes, socket
        self._sending = asyncio.Lock()
        self._loop = asyncio.get_running_loop()
        self._turns = itertools.count()
        self._newest: dict[str, int] = {}
        self._waiting: dict[int, CancelToken] = {}
        self._tasks: set[asyncio.Task[None]] = set()
        self._has_new_state = asyncio.Event()

    async def run(self) -> None:
        """Answer questions until the page closes."""
        await self._socket.accept()
        self._session.listeners.append(self._receive_event)
        self._has_new_state.set()
        self._start_task(self._send_states())
        try:
            while True:
                message = await self._socket.receive()
                if message["type"] != "websocket.receive":
                    break
                await self._start_answer(message.get("text") or "")
        except (WebSocketDisconnect, RuntimeError):  # the latter: it closed during a write
            pass
        finally:
            self._session.listeners.remove(self._receive_event)
            for cancel in self._waiting.values():
                cancel.cancel()
            for task in list(self._tasks):
                task.cancel()

    async def _start_answer(self, text: str) -> None:
        """Begin to answer a message."""
        try:
            question = read_question(text, [*QUESTIONS, "cancel"])
            if question.do == "cancel":
                await self._send(self._cancel(question))
                return
            if question.id in self._waiting:
                raise BadMessage("a question with this id is already waiting", question.id)
        except BadMessage as error:
            await self._send({"re": error.number, "error": str(error)})
            return
        cancel, turn = CancelToken(), next(self._turns)
        self._waiting[question.id] = cancel
        if not QUESTIONS[question.do].is_queued:
            self._newest[question.do] = turn
        if QUESTIONS[question.do].follow_up:
            self._session.n_plans += 1
        self._start_task(self._answer(question, cancel, turn))

    def _cancel(self, question: Question) -> dict[str, Any]:
        """Cancel a question, and return the answer to the cancel message."""
        try:
            number = check_integer("of", question.values.get("of"), 0)
        except LocplanError as error:
            return {"re": question.id, "error": str(error)}
        if number in self._waiting:
            self._waiting[number].cancel()
        return {"re": question.id, "ok": True}

    async def _answer(self, question: Question, cancel: CancelToken, turn: int) -> None:
        """Answer a question in its lane, then run its follow-up there."""
        # A newer question of the same kind also cancels this one.
        either = CancelToken(
            lambda: cancel.is_cancelled or self._newest.get(question.do, turn) != turn
        )
        job = QuestionJob(self._make_progress_callback(question.id, either), either.check)
        handler, session = QUESTIONS[question.do], self._session
        lane = self._lanes[handler.lane]

        def compute_answer() -> dict[str, Any]:
            either.check()
            return handler.answer(session, question, job)

        try:
            answer = await self._loop.run_in_executor(lane, compute_answer)
        except Cancelled:
            answer = {"cancelled": True} if cancel.is_cancelled else {"stale": True}
        except LocplanError as error:
            answer = {"error": format_sentence(str(error))}
        except Exception as error:  # an error of the explorer must not close the page
            answer = {
                "error": format_one_line(f"{question.do} failed: {type(error).__name__}: {error}")
            }
        finally:
            del self._waiting[question.id]
        await self._send({"re": question.id, **answer})
        if handler.follow_up and "basis" in answer:
            n_plans = session.n_plans  # a new plan of any page cancels the follow-up
            over = CancelToken(lambda: either.is_cancelled or session.n_plans != n_plans)
            job = QuestionJob(job.progress, over.check)
            with suppress(Cancelled, LocplanError, MemoryError, RuntimeError):
                await self._loop.run_in_executor(
                    lane, handler.follow_up, session, session.scene, question, job
                )

    def _make_progress_callback(self, number: int, cancel: CancelToken) -> Any:
        def progress(n_done: int, total: int, *_: object) -> None:
            cancel.check()
            answer = {"progress": number, "done": int(n_done), "total": int(total)}
            self._loop.call_soon_threadsafe(self._post_message, answer)

        return progress

    def _receive_event(self, event: dict[str, Any]) -> None:
        """Pass on an event of the session, from any thread."""
        with suppress(RuntimeError):  # the server has ended
            self._loop.call_soon_threadsafe(self._post_message, event)

    def _post_message(self, message: dict[str, Any]) -> None:
        if message.get("event") == "state":
            self._has_new_state.set()
        else:
            self._start_task(self._send(message))

    async def _send_states(self) -> None:
        """Send the session's state whenever it changes.

        A thread collects the state, so that the loop can answer meanwhile.
        """
        while True:
            await self._has_new_state.wait()
            self._has_new_state.clear()
            state = await self._loop.run_in_executor(None, describe_state, self._session)
            await self._send({"event": "state", **state})

    def _start_task(self, work: Coroutine[Any, Any, None]) -> None:
        """Start a task that is cancelled when the page closes."""
        task = self._loop.create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def _send(self, answer: dict[str, Any]) -> None:
        text = _encode_message(answer)
        async with self._sending:
            with suppress(WebSocketDisconnect, RuntimeError):  # the page has closed
                await self._socket.send_text(text)


def _encode_message(answer: dict[str, Any]) -> str:
    """Return a message as JSON, with null for NaN and infinity."""
    try:
        return json.dumps(answer, allow_nan=False, separators=(",", ":"))
    except ValueError:
        return json.dumps(nan_to_none(answer), allow_nan=False, separators=(",", ":"))
