"""Paths that follow while a marker is dragged: the shortest one, and the aware one."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeAlias

from locplan._util.checks import RESOLUTIONS
from locplan.costs import Path
from locplan.errors import ConfigError
from locplan.explorer._drafts import Coarse, coarse_of, drafted
from locplan.explorer._profiles import PathAnswer, path_answer
from locplan.explorer._scene import Scene
from locplan.explorer._searches import Flood, Halved, index_of
from locplan.explorer._session import KEPT_BYTES, Session
from locplan.explorer._snap import FACTOR, snapped
from locplan.explorer._wire import Ask
from locplan.maps import OccupancyGrid
from locplan.planners import AnyAngle, Position, any_angle_path

if TYPE_CHECKING:
    from locplan.explorer._asks import Work

SHORTEST_WEIGHT = 1e-6
"""Weight of the shortest path: of the many on a grid it is the one that sees most."""
DRAFT_CELLS = 1500
"""Longest side of a map on which drafts are planned on its own cells [cells]."""
PATH_BYTES = 20_000
"""Bytes that a path may take, roughly."""
Check: TypeAlias = Callable[[], None]
"""Function that raises where a plan is not wanted any more."""


@dataclass(frozen=True, eq=False)
class PlanAnswer:
    """Both paths over the stops, or the reason why there are none."""

    stops: tuple[Position, ...]
    """Start, waypoints and goal, where the robot can stand [m]."""
    draft: bool
    """Whether the paths are drafts, which finer ones are to follow."""
    shortest: PathAnswer | None
    """The shortest path."""
    aware: PathAnswer | None
    """The localizability-aware path."""
    why: str = ""
    """Reason why a path is missing."""

    def to_json(self) -> dict[str, Any]:
        """The answer, fit for JSON."""
        start, *via, goal = map(list, self.stops)
        about: dict[str, Any] = {"start": start, "goal": goal, "via": via, "draft": self.draft}
        about["aware"] = self.aware and self.aware.to_json()
        about["shortest"] = self.shortest and self.shortest.to_json()
        return {**about, "why": self.why} if self.why else about


def plan(session: Session, ask: Ask, work: Work) -> dict[str, Any]:
    """Answer with both paths over start, waypoints and goal."""
    stops = [ask.position("start"), *ask.positions("via"), ask.position("goal")]
    weight, held = session.weight_of(ask), held_stop(ask, len(stops))
    draft = ask.flag("draft")
    check = work.cancel.check
    return planned(session, stops, weight, held=held, draft=draft, check=check).to_json()


def planned(
    session: Session,
    stops: Sequence[Position],
    weight: float,
    *,
    held: int | None = None,
    draft: bool = False,
    check: Check = lambda: None,
) -> PlanAnswer:
    """Plan both paths.

    They are those of `locplan.planners.plan_beside_shortest`, also where they come from searches
    that are kept from the other end.

    Parameters
    ----------
    session : Session
        The session, whose present scene is planned on.
    stops : sequence of (x, y)
        Start, waypoints and goal in the world [m].
    weight : float
        Metres of detour accepted per degenerate metre.
    held : int, optional
        Index of the stop that is dragged.
    draft : bool
        True takes a coarser map where the map is large.
    check : callable
        It is called between the paths and in their searches, and raises to end the plan.
    """
    scene = session.scene
    placed = snapped(session.parts(scene), stops, held)
    if draft and _has_drafts(scene.costs.grid):
        found = drafted(session, scene, placed, (SHORTEST_WEIGHT, weight), held, check)
        if found is not None:
            return PlanAnswer(tuple(placed), True, *found)
    shortest = _over(session, scene, placed, SHORTEST_WEIGHT, held, check)
    check()
    if shortest is None:
        why = f"no path joins them for a robot of radius {session.robot.radius:g} m"
        return PlanAnswer(tuple(placed), False, None, None, why)
    if scene.field is None:
        why = "the field is still being computed"
        answer = path_answer(_halved(session, scene, SHORTEST_WEIGHT).costs, scene, shortest)
        return PlanAnswer(tuple(placed), False, answer, None, why)
    aware = _over(session, scene, placed, weight, held, check)
    check()
    costs = _halved(session, scene, weight).costs
    answers = [path_answer(costs, scene, path) for path in (shortest, aware) if path]
    # Any-angle paths are improved from two beginnings, and the better one of the two counts.
    best = min(answers, key=lambda one: one.length), min(answers, key=lambda one: one.cost)
    return PlanAnswer(tuple(placed), False, *best)


def idle(session: Session, ask: Ask, work: Work) -> dict[str, Any]:
    """Prepare drafts and search from the stops, so that the next drag finds that done.

    Where a stop is held, its drag has begun: only the stops beside it are searched from. While a
    field is computed nothing is done: its costs will be others, and both have no room at once.
    """
    if session.busy is not None:
        return {"ok": False}
    scene, weight = session.scene, session.weight_of(ask)
    stops = [ask.position("start"), *ask.positions("via"), ask.position("goal")]
    held = held_stop(ask, len(stops))
    placed = snapped(session.parts(scene), stops, held)
    weights = (SHORTEST_WEIGHT, weight) if scene.field else (SHORTEST_WEIGHT,)
    check = work.cancel.check
    for each in weights if held is None and _has_drafts(scene.costs.grid) else ():
        check()
        coarse_of(session, scene, each)
    halved = [_halved(session, scene, each) for each in weights]
    room = KEPT_BYTES - Flood.expected(halved[0].bordered)
    room -= sum(each.bordered.half.nbytes + Coarse.expected(each.bordered) for each in halved)
    for stop in _first_to_rest(placed) if held is None else _beside(placed, held):
        room -= sum(each.bordered.half.size for each in halved)
        if room < 0:
            break  # one search would only push out another
        # A drag that has begun waits for these; else one after the other takes less memory.
        with ThreadPoolExecutor(1 if held is None else len(weights)) as pool:
            made = [pool.submit(_flood, session, scene, each, stop, check) for each in weights]
        for one in made:
            one.result()
    return {"ok": True}


def _first_to_rest(stops: Sequence[Position]) -> list[Position]:
    """The stops in the order in which a drag may need them: the ends move most."""
    start, *via, goal = stops
    ends = [via[-1], via[0], start, goal, *via[1:-1]] if via else [start, goal]
    return list(dict.fromkeys(ends))


def _beside(stops: Sequence[Position], held: int) -> list[Position]:
    """The stops beside the one that is dragged."""
    return [stops[n] for n in (held - 1, held + 1) if 0 <= n < len(stops)]


def is_slow(session: Session, ask: Ask) -> bool:
    """Whether a plan takes so long that drafts must not wait for it."""
    return _has_drafts(session.grid) and ask.values.get("draft") is not True


def _has_drafts(grid: OccupancyGrid) -> bool:
    """Whether drafts are planned on larger cells: those of a map may have 10 m at most."""
    large = max(grid.shape) > DRAFT_CELLS
    return large and grid.resolution * FACTOR <= RESOLUTIONS[1]


def held_stop(ask: Ask, count: int) -> int | None:
    """Index of the stop that is held: "start", "goal" or "via:K"; None without one."""
    hold = ask.text("hold")
    if hold in (None, ""):
        return None
    names = {"start": 0, "goal": count - 1} | {f"via:{k}": k + 1 for k in range(count - 2)}
    if hold not in names:
        raise ConfigError(f"hold must be one of {', '.join(names)}")
    return names[hold]


def _over(
    session: Session,
    scene: Scene,
    stops: Sequence[Position],
    weight: float,
    held: int | None,
    check: Check,
) -> Path | None:
    """The path over all stops, leg by leg; None if a leg has none."""
    legs: list[Path] = []
    for n, (start, goal) in enumerate(itertools.pairwise(stops)):
        check()
        moving = None if held is None else {n: "start", n + 1: "goal"}.get(held)
        leg = _leg(session, scene, weight, start, goal, moving, check)
        if leg is None:
            return None
        legs.append(leg)
    return legs[0] if len(legs) == 1 else Path.joined(legs)


def _leg(
    session: Session,
    scene: Scene,
    weight: float,
    start: Position,
    goal: Position,
    moving: str | None,
    check: Check,
) -> Path | None:
    """The any-angle path of a leg, of which one end may be moving; None if there is none.

    A search from an end that rests is kept, and serves paths to it and from it. It is finished even
    where the plan is not: the next one needs it.
    """
    key = ("leg", scene.serial, weight, start, goal)
    if kept := session.kept.get(key):
        return kept  # type: ignore[no-any-return]
    halved = _halved(session, scene, weight)
    costs, bordered = halved.costs, halved.bordered
    if moving is not None:
        _flood(session, scene, weight, goal if moving == "start" else start)
    first, last = (index_of(costs, end) for end in (start, goal))
    flood: Flood | None = session.kept.get(_flood_key(scene, weight, first))
    if flood is not None:
        cells = flood.cells_to(bordered, last)
    else:
        flood = session.kept.get(_flood_key(scene, weight, last))
        cells = None if flood is None else flood.cells_from(bordered, first)
    if flood is None:
        check()
        path = AnyAngle().solve_prepared(costs, bordered, start, goal, check).path
    else:
        path = None if cells is None else any_angle_path(costs, bordered, cells, start, goal)
    return None if path is None else session.kept.put(key, path, PATH_BYTES)


def _halved(session: Session, scene: Scene, weight: float) -> Halved:
    """The costmap at a weight, or the blank one before there is a field."""

    def make() -> Halved:
        costs = scene.costs
        return Halved.of(costs if scene.field is None else costs.with_weight(weight))

    key = ("halved", scene.serial, weight)
    expected = 2 * scene.costs.density.nbytes
    return session.kept.made(key, make, lambda made: made.bordered.half.nbytes, expected)


def _flood_key(scene: Scene, weight: float, source: int) -> tuple[object, ...]:
    return "flood", scene.serial, weight, source


def _flood(
    session: Session, scene: Scene, weight: float, end: Position, check: Check | None = None
) -> Flood:
    """The search from an end of a leg, which is kept."""
    halved = _halved(session, scene, weight)
    source = index_of(halved.costs, end)
    key = _flood_key(scene, weight, source)
    return session.kept.made(
        key,
        lambda: Flood.of(halved.bordered, source, check),
        lambda made: made.steps.nbytes,
        Flood.expected(halved.bordered),
    )
