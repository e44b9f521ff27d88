"""Answers that take long: the simulated choice of the way shown, landmarks, look-alikes, drives."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from locplan._util.checks import FARTHEST, whole
from locplan.costs import Path
from locplan.errors import ConfigError
from locplan.explorer._scene import MAX_DRIVES, Texture, rounded, snapped
from locplan.landmarks import parsed_object, place_landmarks
from locplan.matching import ScanDatabase
from locplan.robots import Robot
from locplan.simulation import Simulator, choose, drive_closed, seen_on
from locplan.twins import PLACE_HEADINGS, PLACE_SPACING, Twins, find_twins

if TYPE_CHECKING:
    from locplan.explorer._asks import Ask, Work
    from locplan.explorer._session import Session


def simulate(session: Session, ask: Ask, work: Work) -> dict[str, object]:
    """Answer the ask for the simulated choice of the way shown by its summary.

    Candidates are driven just as `locplan plan` does with these settings. Of the page's field it
    takes the points that a field for this choice has. Work that is cancelled ends after the drives
    that are under way; the searches before the first drive run out.
    """
    view, drives = session.view(ask), ask.whole("drives", 2, MAX_DRIVES, 64)
    work.progress(0, drives, "planning")
    start, *via, goal = view.stops
    choice = choose(
        view.grid,
        start,
        goal,
        view.robot,
        costs=view.field.config,
        compute=view.field_at if view.whole else None,
        via=via,
        drives=drives,
        candidates=[view.planner] if view.planner else (),
        filter_map=view.filter_map,
        threads=session.opening.threads,
        progress=work.progress,
        **view.cost_settings,
    )
    if choice.path is None:
        raise ConfigError("no path joins start and goal; move one of them")
    return {**choice.summary(), "driven": choice.driven}


def steer(session: Session, ask: Ask, work: Work) -> dict[str, object]:
    """Answer the ask for a closed-loop drive along a path: the first of 16 that fails, if one does.

    It is the robot's pose, what it believes and what it sees, twice a second.
    """
    path = Path(np.array(ask.positions("xy", 5000)), ask.angles("heading", 5000))
    view = session.view(ask)
    own, threads = view.filter_map, session.opening.threads
    simulator = Simulator(view.grid, view.robot, filter_map=own, threads=threads)
    found = drive_closed(simulator, {"": path}, range(16), progress=work.progress)[""]
    failing = (n for n, each in enumerate(found.drives) if each.outcome != "arrived")
    number = next(failing, 0)
    drive = found.drives[number]
    truth = drive.truth[::5]
    x, y, heading = map(list, zip(*rounded(truth), strict=True))
    return {
        "what": f"Drive {number + 1}: {drive.outcome}; {found.words} arrive",
        "t": (0.5 * np.arange(len(truth))).tolist(),
        **{"x": x, "y": y, "heading": heading},
        "believed": rounded(drive.believed[::5]),
        "sees": [rounded(each) for each in seen_on(simulator, number, truth)],
    }


ALIKE = 3.0
"""Excess up to which a pose counts as a look-alike [nats]; a likelihood of a twentieth."""


def landmarks(session: Session, ask: Ask, work: Work) -> dict[str, object]:
    """Answer the ask for landmarks along the way shown by their summary, verified by drives.

    What the lidar sees along the way is computed before the first step, and runs out where the work
    is cancelled.
    """
    view = session.view(ask)
    kind = parsed_object(ask.text("object", "pole:0.2"))
    count = ask.whole("count", 1, 20, 3)
    drives = ask.whole("drives", 0, MAX_DRIVES, 16)
    if drives:
        whole("drives", drives, 2)
    work.progress(0, count, "planning")
    threads = session.opening.threads
    made = place_landmarks(
        view.grid,
        kind,
        count,
        paths={"shown": view.path()},
        robot=view.robot,
        threads=threads,
        progress=work.progress,
    )
    found = None
    if drives and len(made):
        found = made.verify(drives, random_sets=1, threads=threads, progress=work.progress)
    return made.summary(found)


def twins(session: Session, ask: Ask, work: Work) -> dict[str, object]:
    """Answer the ask for the look-alikes of a place."""
    x, y = (ask.number(name, -FARTHEST, FARTHEST, None) for name in ("x", "y"))
    if x is None or y is None:
        raise ConfigError("look-alikes need a place: x and y in metres")
    (place,) = snapped(session.scene.parts, [(x, y)])
    robot = session.robot
    database = database_of(session, robot, work)
    work.progress(0, 1, "comparing places")
    found = find_twins(
        database.grid, robot, places=[place], database=database, progress=work.progress
    )
    at: Any = found.summary(starts=())["at"]
    alike = [each for each in at["twins"] if each["excess"] <= ALIKE]
    return {**at, "twins": alike}


def database_of(session: Session, robot: Robot, work: Work) -> ScanDatabase:
    """What the lidar sees at all places of the map, made once and kept with the costmaps."""
    grid, lidar = session.grid, robot.known_lidar

    def prepared() -> ScanDatabase:
        made = ScanDatabase(grid, lidar, robot.radius)
        made.prepare(lambda done, total: work.progress(done, total, "looking from all places"))
        return made

    work.progress(0, 1, "looking from all places")
    return session.kept.made(
        ("scans", session.scene.serial, grid.digest, lidar),
        prepared,
        lambda made: made.everywhere.bytes,
        20 * grid.cells.size,  # about what it takes
    )


def spacing_of(database: ScanDatabase) -> float:
    """The usual distance of places [m], or a greater one where that would take too long."""
    every, cell = database.everywhere, database.grid.resolution
    headings = 1 if database.lidar.sees_alike_in_all_headings else PLACE_HEADINGS
    # 40 s of a core, of which a pose takes 3.5 ms and each place that it is compared with 0.2 us.
    poses = 40.0 / (3.5e-3 + 0.2e-6 * len(every.positions))
    spacing = math.sqrt(float(every.fits.sum()) * cell**2 * headings / poses)
    return max(PLACE_SPACING, math.ceil(10 * spacing) / 10, cell)


def texture_of(found: Twins, stride: int, digest: str) -> Texture:
    """The least excess of another place on the lattice of a field of this stride [cells]."""
    worst = 12.0  # from here on all places count as the same, a likelihood of 6e-6
    excess = found.layer("excess", stride=stride)
    return Texture(
        "twins",
        "Look-alikes: excess of the best",
        "nat",
        1.0,
        1,
        False,
        (worst, 0.0),
        np.clip(excess, 0.0, worst),
        "How much worse the best other place explains a scan than the right one. At 0 both explain"
        f" it equally well, at {ALIKE:g} nats the other is {math.exp(-ALIKE):.0%} as likely;"
        f" {worst:g} also stands for more. Places are {found.spacing:g} m apart.",
        digest,
    )


def twins_everywhere(session: Session, ask: Ask, work: Work) -> dict[str, object]:
    """Answer the ask for the look-alikes of all places: they become a layer of every page."""
    digest, field, robot = session.twins_digest, session.scene.field, session.robot
    if field is None:
        raise ConfigError("the field is still being computed; wait until it is there")
    database = database_of(session, robot, work)

    def progress(done: int, total: int) -> None:
        if session.twins_digest != digest:
            raise ConfigError("the map or the lidar was changed meanwhile; search again")
        work.progress(done, total, "comparing places")

    progress(0, 1)
    spacing = spacing_of(database)
    found = find_twins(database.grid, robot, spacing=spacing, database=database, progress=progress)
    progress(1, 1)
    session.twins = texture_of(found, field.stride, digest)
    session.tell({"event": "state"})
    about = {"share": found.share, "places": len(found), "spacing": spacing}
    return {"layer": "twins", "alike": ALIKE, **about}


def drive_of(session: Session, ask: Ask) -> tuple[int, Any]:
    """Number of the recorded drive that is asked for, and the drive."""
    drives = session.opening.drives
    if not drives:
        raise ConfigError("there is no recorded drive; start the explorer with --drive FILE")
    number = ask.whole("drive", 0, len(drives) - 1, None)
    if number is None:
        raise ConfigError("drive must be the number of a recorded drive")
    return number, drives[number]


def drive(session: Session, ask: Ask, work: Work) -> dict[str, Any]:
    """Answer the ask for the poses of a recorded drive, before its scans are matched."""
    return dict(drive_of(session, ask)[1].shown(session.grid))


def match(session: Session, ask: Ask, work: Work) -> dict[str, object]:
    """Answer the ask for the deviations that the scans of a drive have on the present map.

    They are kept, so that a drive that is shown again has them at once.
    """
    number, asked = drive_of(session, ask)
    grid, how = session.grid, {"threads": session.opening.threads, "progress": work.progress}
    found: dict[str, Any] = session.files.made(
        ("match", number, grid.digest),
        lambda: asked.shown(grid, matched=True, **how),
        lambda made: 200 * len(made["t"]),
    )
    return {"map": grid.digest, "sd": found["sd"], "unlike": found["unlike"]}
