"""The orders of a comparison, each with all that decides it, and the journal of their runs.

Costmaps are shared by all processes: one file for each array, mapped into memory.
"""

from __future__ import annotations

import hashlib
import itertools
import json
import logging
import math
import os
import pickle
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from locplan import __version__
from locplan._util.checks import file_path, shown
from locplan._util.files import errors_in_one_line, make_folder
from locplan._util.progress import ProgressCallback
from locplan._util.reading import opened, parsed_json
from locplan._util.saved import made
from locplan._util.tables import finite
from locplan.comparison._specs import PlannerSpec
from locplan.comparison._statistics import STATUSES, Run, Task, grouped
from locplan.costs import Costmap
from locplan.errors import ConfigError, LocplanError
from locplan.planners import Position, check_ends

if TYPE_CHECKING:
    from locplan.comparison._result import Case

LOG = logging.getLogger(__name__)
Key = tuple[Task, str]
"""A task, and the digest of everything that decides its result."""


class Journal:
    """A JSON-lines file with one line a run; a context manager.

    Each run stands beside the digest of everything that decided it. Where maps, settings or
    planners have changed since, or others were added, only unchanged runs are taken from the
    journal.

    Parameters
    ----------
    file : path
        The file, which need not exist.
    resume : bool, default False
        True lets the file hold runs, which are `runs` then.
    anew : bool, default False
        True forgets the runs in the file.

    Raises
    ------
    LocplanError
        If the file cannot be written, is no journal, or holds runs and may not.
    """

    def __init__(
        self, file: str | os.PathLike[str], *, resume: bool = False, anew: bool = False
    ) -> None:
        self.path = file_path("a journal", file)
        self._made_folder = not self.path.parent.exists()
        make_folder(self.path.parent)
        with errors_in_one_line(self.path):
            if self.path.exists():
                opened(self.path, 2**28).close()
            self._file = self.path.open("a+", encoding="ascii")
        try:
            self._lock()
            self.runs = self._read()
            if anew:
                self._file.truncate(0)
                self.runs = self._read()
            if self.runs and not resume:
                raise LocplanError(
                    f"{self.path}: holds {len(self.runs)} runs; go on with them by --resume"
                    " (resume=True), begin anew by --force (anew=True), or name another place"
                )
        except BaseException:
            with suppress(OSError):
                self._file.close()
            raise

    def __enter__(self) -> Journal:
        return self

    def __exit__(self, kind: object, error: object, trace: object) -> None:
        # Closing writes what could not be written before.
        with errors_in_one_line(self.path) if error is None else suppress(OSError):
            self._file.close()
        if error is not None and not self.runs:  # nothing was run: leave nothing behind
            self.path.unlink(missing_ok=True)
            if self._made_folder:
                with suppress(OSError):  # another process has written into it
                    self.path.parent.rmdir()

    def add(self, run: Run, digest: str) -> None:
        """Append a run with its digest; numbers that are not finite become null.

        Parameters
        ----------
        run : Run
            The run.
        digest : str
            Digest of everything that decided it.
        """
        self._append({"digest": digest, **finite(asdict(run))})
        self.runs[run.task, digest] = run

    def _read(self) -> dict[Key, Run]:
        """The runs in the file; the torn last line of a killed process is cut off."""
        self._file.seek(0)
        try:
            *lines, torn = self._file.read().split("\n")
        except UnicodeDecodeError:
            raise LocplanError(f"{self.path}: is no journal of a comparison") from None
        if torn and lines:
            self._file.truncate(sum(len(line) + 1 for line in lines))
        head = {"format": "locplan comparison 1"}
        if not lines and json.dumps(head).startswith(torn):
            self._file.truncate(0)
            self._append(head)
            return {}
        if not lines or lines[0] != json.dumps(head):
            raise LocplanError(f"{self.path}: is no journal of a comparison; name another file")
        return dict(self._parsed(n, line) for n, line in enumerate(lines[1:], 2))

    def _parsed(self, number: int, line: str) -> tuple[Key, Run]:
        try:
            about = parsed_json(line)
            digest = made(str, about.pop("digest"))
            run: Run = made(Run, about)
            if run.status not in STATUSES or math.isnan(run.task.weight):
                raise ValueError("is no run")
            return (run.task, digest), run
        except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError):
            raise LocplanError(
                f"{self.path}: line {number} is damaged; delete the line to make its run anew"
            ) from None

    def _append(self, about: Mapping[str, Any]) -> None:
        with errors_in_one_line(self.path):
            self._file.write(json.dumps(about, allow_nan=False) + "\n")
            self._file.flush()

    def _lock(self) -> None:
        try:
            import fcntl
        except ModuleNotFoundError:
            return  # a system without locks (Windows)
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise LocplanError(
                f"{self.path}: another comparison writes to it; wait, or name another file"
            ) from None
        except OSError:
            return  # a file system without locks


@dataclass(frozen=True)
class Order:
    """A task with everything that a worker needs for it."""

    task: Task
    costs: Path
    """Folder of the shared costmap."""
    start: Position
    goal: Position
    planner: int
    """Index of the planner among those that the worker was given."""
    digest: str
    """Digest of everything that decides the result."""


def orders_of(
    case: Case,
    costs: Costmap,
    home: Path,
    specs: Sequence[PlannerSpec],
    weights: Sequence[float],
    seeds: Sequence[int],
) -> Iterator[Order]:
    """The orders of a case, whose costmap is in the folder `home`."""
    _check_queries(case, costs, {spec.planner.space for spec in specs})
    decisive = [__version__, _content(costs)]
    identities = [spec.identity() for spec in specs]
    for weight, query, (n, spec) in itertools.product(weights, case.queries, enumerate(specs)):
        for seed in spec.seeds(seeds):
            task = Task(case.map, case.config, query.name, weight, spec.label, int(seed))
            ends = query.start, query.goal
            about = [*decisive, weight, *ends, identities[n], int(seed)]
            text = json.dumps(about, sort_keys=True, default=repr)
            digest = hashlib.blake2b(text.encode(), digest_size=16).hexdigest()
            yield Order(task, home, *ends, n, digest)


def _check_queries(case: Case, costs: Costmap, spaces: Iterable[str]) -> None:
    """Raise a LocplanError unless all planners' spaces hold the ends of all queries."""
    names = [query.name for query in case.queries]
    if not names or len(set(names)) < len(names):
        raise ConfigError(f"map {shown(case.map)} needs queries, each with a name of its own")
    for query, space in itertools.product(case.queries, {"R2", *spaces}):
        headed = slice(None) if space != "R2" else slice(2)
        try:
            check_ends(costs, query.start[headed], query.goal[headed], space=space)
        except LocplanError as error:
            where = f"map {shown(case.map)}, query {shown(query.name)}"
            raise LocplanError(f"{where}: {error}") from None


def _content(costs: Costmap) -> str:
    """A digest of everything in a costmap that paths and measures depend on."""
    content = hashlib.blake2b(digest_size=16)
    # The simulated choice takes its lidar from the settings.
    settings = costs.settings and json.dumps(costs.settings.to_json(), sort_keys=True)
    robot = [costs.robot.digest] if costs.robot else []
    content.update(repr((costs.grid.digest, costs.robot_radius, settings, *robot)).encode())
    for layer in (costs.density, costs.u, costs.e, costs.u_of_heading, costs.e_of_heading):
        if layer is not None:
            content.update(np.ascontiguousarray(layer).view(np.uint8).data)
    return content.hexdigest()


def runs_of(
    orders: Sequence[Order],
    specs: Sequence[PlannerSpec],
    start: Callable[[Sequence[Order]], Iterator[Run]],
    journal: Journal | None,
    progress: ProgressCallback | None,
) -> list[Run]:
    """The runs of all orders, in their order; those that the journal has are not made again."""
    known = journal.runs if journal else {}
    done = {order.task: known.get((order.task, order.digest)) for order in orders}
    runs = {task: run for task, run in done.items() if run and not run.ended}
    left = [order for order in orders if order.task not in runs]
    for spec in specs:
        count = sum(task.planner == spec.label for task in runs)
        if spec.guarded and count:
            LOG.warning("planner %s: %d runs cached, version %s", spec.label, count, spec.version)
    digests = {order.task: order.digest for order in left}
    if progress:
        progress(len(runs), len(orders))
    for run in start(_longest_first(left, specs)):
        runs[run.task] = run
        if journal:
            journal.add(run, digests[run.task])
        if progress:
            progress(len(runs), len(orders))
    return [runs[order.task] for order in orders]


def _longest_first(orders: Sequence[Order], specs: Sequence[PlannerSpec]) -> list[Order]:
    """Sort by costmap, and within each put long runs first, so that none is left at the end."""

    def limit(order: Order) -> float:
        spec = specs[order.planner]
        unknown = math.inf if spec.guarded else 0.0
        return unknown if spec.time_limit is None else spec.time_limit

    groups = grouped(orders, lambda order: (order.costs, order.task.weight))
    return [each for own in groups.values() for each in sorted(own, key=limit, reverse=True)]


def put_costmap(costs: Costmap, folder: Path) -> None:
    """Write a costmap into a new folder, each of its arrays to a file of its own."""
    # Paths are measured with these: made once for all, and in no planner's time.
    _ = costs.grid.clearance, costs.u_of_heading
    buffers: list[pickle.PickleBuffer] = []
    about = pickle.dumps(costs, protocol=5, buffer_callback=buffers.append)
    try:
        folder.mkdir()
        for n, buffer in enumerate(buffers):
            (folder / f"{n}.raw").write_bytes(buffer.raw())
        (folder / "about.pickle").write_bytes(about)
    except OSError as error:
        why = error.strerror or error
        raise LocplanError(f"{folder}: cannot be written ({why}); TMPDIR names another") from None


@lru_cache(maxsize=1)
def read_costmap(folder: Path) -> Costmap:
    """Read a costmap, whose read-only arrays all processes share in memory; the last is kept."""
    names = (folder / f"{n}.raw" for n in itertools.count())
    files = itertools.takewhile(Path.exists, names)
    buffers = [np.memmap(file, mode="r") for file in files]
    costs: Costmap = pickle.loads((folder / "about.pickle").read_bytes(), buffers=buffers)
    return costs


@lru_cache(maxsize=1)
def weighted_costmap(folder: Path, weight: float) -> Costmap:
    """The costmap with a weight, which is 0 for one without a field; the last one is kept."""
    costs = read_costmap(folder)
    if math.isnan(costs.weight) and weight == 0:
        return costs
    return costs if costs.weight == weight else costs.with_weight(weight)
