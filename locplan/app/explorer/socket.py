"""The socket of a page: questions come in, answers and events go out."""

from __future__ import annotations

import asyncio
import itertools
import json
from collections.abc import Coroutine, Mapping
from concurrent.futures import Executor
from contextlib import suppress
from typing import Any

from starlette.websockets import WebSocket, WebSocketDisconnect

from locplan._support.checks import whole
from locplan._support.tables import finite
from locplan.app.explorer.questions import QUESTIONS
from locplan.app.explorer.requests import (
    MAX_ID,
    Ask,
    Cancel,
    Cancelled,
    Unanswerable,
    Work,
    read_ask,
)
from locplan.app.explorer.session import Session
from locplan.errors import LocplanError, one_line


class Link:
    """One page's socket. Its questions have numbers of their own."""

    def __init__(self, session: Session, lanes: Mapping[str, Executor], socket: WebSocket) -> None:
        self._session, self._lanes, self._socket = session, lanes, socket
        self._sending = asyncio.Lock()
        self._loop = asyncio.get_running_loop()
        self._turns = itertools.count()
        self._newest: dict[str, int] = {}
        self._under_way: dict[int, Cancel] = {}
        self._tasks: set[asyncio.Task[None]] = set()
        self._changed = asyncio.Event()

    async def run(self) -> None:
        """Answer until the page goes."""
        await self._socket.accept()
        self._session.listeners.append(self._hear)
        self._changed.set()
        self._begin(self._tell_states())
        try:
            while True:
                message = await self._socket.receive()
                if message["type"] != "websocket.receive":
                    break
                text = message.get("text")
                await self._take(text if text is not None else "")
        except (WebSocketDisconnect, RuntimeError):  # the latter: it closed while it was written to
            pass
        finally:
            self._session.listeners.remove(self._hear)
            for cancel in self._under_way.values():
                cancel.cancel()
            for task in list(self._tasks):
                task.cancel()

    async def _take(self, text: str) -> None:
        """Begin to answer a message."""
        try:
            ask = read_ask(text, [*QUESTIONS, "cancel"])
            if ask.do == "cancel":
                await self._send(self._cancelled(ask))
                return
            if len(self._under_way) >= self._session.opening.limits.waiting:
                raise Unanswerable("too many questions wait; ask again later", ask.id)
            if ask.id in self._under_way:
                raise Unanswerable("a question with this id is under way", ask.id)
        except Unanswerable as error:
            await self._send({"re": error.number, "error": str(error)})
            return
        cancel, turn = Cancel(), next(self._turns)
        self._under_way[ask.id] = cancel
        if not QUESTIONS[ask.do].each:
            self._newest[ask.do] = turn
        self._begin(self._answer(ask, cancel, turn))

    def _cancelled(self, ask: Ask) -> dict[str, Any]:
        """Take a question back, and answer that."""
        try:
            number = whole("of", ask.values.get("of"), 0, MAX_ID)
        except LocplanError as error:
            return {"re": ask.id, "error": str(error)}
        if number in self._under_way:
            self._under_way[number].cancel()
        return {"re": ask.id, "ok": True}

    async def _answer(self, ask: Ask, cancel: Cancel, turn: int) -> None:
        """Answer a question in its lane."""
        # It ends, too, once a newer question of its kind has come.
        either = Cancel(lambda: cancel.cancelled or self._newest.get(ask.do, turn) != turn)
        work = Work(self._progress(ask.id, either), either)
        try:
            lane = self._lanes[QUESTIONS[ask.do].lane_of(self._session, ask)]
            answer = await self._loop.run_in_executor(lane, self._work, ask, work)
        except Cancelled:
            answer = {"cancelled": True} if cancel.cancelled else {"stale": True}
        except LocplanError as error:
            answer = {"error": str(error)}
        except MemoryError:
            answer = {"error": "the memory does not suffice; ask for less"}
        except Exception as error:  # a fault of ours must not end the page
            answer = {"error": one_line(f"{ask.do} failed: {type(error).__name__}: {error}")}
        finally:
            del self._under_way[ask.id]
        await self._send({"re": ask.id, **answer})

    def _work(self, ask: Ask, work: Work) -> dict[str, Any]:
        work.cancel.check()
        return QUESTIONS[ask.do].answer(self._session, ask, work)

    def _progress(self, number: int, cancel: Cancel) -> Any:
        def progress(done: int, total: int, doing: str = "") -> None:
            cancel.check()
            answer: dict[str, Any] = {"progress": number, "done": int(done), "total": int(total)}
            if doing:
                answer["doing"] = doing
            self._loop.call_soon_threadsafe(self._post, answer)

        return progress

    def _hear(self, event: dict[str, Any]) -> None:
        """Pass on an event of the session, from any thread."""
        with suppress(RuntimeError):  # the server has ended
            self._loop.call_soon_threadsafe(self._post, event)

    def _post(self, message: dict[str, Any]) -> None:
        if message.get("event") == "state":
            self._changed.set()
        else:
            self._begin(self._send(message))

    async def _tell_states(self) -> None:
        """Send the session's state whenever it has changed, one after the other.

        It is put together outside the loop, which answers meanwhile.
        """
        while True:
            await self._changed.wait()
            self._changed.clear()
            answer = await self._loop.run_in_executor(None, self._session.state)
            await self._send({"event": "state", **answer})

    def _begin(self, work: Coroutine[Any, Any, None]) -> None:
        """Begin a task of this page, which ends with it."""
        task = self._loop.create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def _send(self, answer: dict[str, Any]) -> None:
        text = _text(answer)
        async with self._sending:
            with suppress(WebSocketDisconnect, RuntimeError):  # the page has gone
                await self._socket.send_text(text)


def _text(answer: dict[str, Any]) -> str:
    """A message as JSON; null stands for NaN and infinity."""
    try:
        return json.dumps(answer, allow_nan=False, separators=(",", ":"))
    except ValueError:
        return json.dumps(finite(answer), allow_nan=False, separators=(",", ":"))
