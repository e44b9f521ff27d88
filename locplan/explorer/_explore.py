"""Opening the explorer from Python, in a browser or in a notebook's frame; the drives it shows."""

from __future__ import annotations

import os
import sys
import threading
import webbrowser
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from locplan._util.checks import file_path, instance, printable, shown, whole
from locplan._util.progress import ProgressCallback
from locplan._util.public import needed
from locplan._util.tables import finite
from locplan.costs import Costmap
from locplan.errors import ConfigError, RecordingError
from locplan.field import CovarianceField, Estimator, FieldConfig, Fused, Sad, config_of
from locplan.maps import OccupancyGrid, check_grid
from locplan.robots import Robot

if TYPE_CHECKING:
    from locplan.explorer._scene import Opening
    from locplan.explorer._server import Server
    from locplan.explorer._session import Session
    from locplan.recordings import Recording

MAX_POSES = 5000
"""Number of poses that the page gets of a drive at most."""


class Explorer:
    """A page that is served on this machine, until it is closed or the program ends.

    It is made by `locplan.explore`.

    Parameters
    ----------
    server : Server
        The server of the page, which runs.
    """

    def __init__(self, server: Server) -> None:
        self._server = server

    def __repr__(self) -> str:
        return f"Explorer({self.address})"

    def __enter__(self) -> Explorer:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def address(self) -> str:
        """Address of the page, with the secret that lets one in."""
        return self._server.address

    @property
    def session(self) -> Session:
        """The map, its field and its costs behind the page, which answer its questions."""
        return self._server.session

    @property
    def grid(self) -> OccupancyGrid:
        """The map as it was edited on the page."""
        return self.session.grid

    @property
    def field(self) -> CovarianceField | None:
        """The field that the page shows; None before it is there."""
        return self.session.field

    def _repr_html_(self) -> str | None:
        """A frame with the page itself in a notebook, and a link to it below.

        The frame stays empty where the notebook's browser runs on another machine, or where the
        notebook forbids frames.
        """
        if not self._server.framed:
            return None
        link = escape(self.address, quote=True)
        return (
            f'<iframe src="{link}" title="locplan explorer" width="100%" height="720"'
            ' style="border: 0" allow="clipboard-write; fullscreen"></iframe>'
            f'<a href="{link}" target="_blank" rel="noopener">Open in a tab of its own</a>'
        )

    def open(self) -> None:
        """Open the page in the browser."""
        webbrowser.open(self.address)

    def wait(self) -> None:
        """Wait until the page is closed by `close`, or by Ctrl-C."""
        self._server.wait()

    def close(self) -> None:
        """End the server."""
        self._server.stop()


def explore(
    grid: OccupancyGrid,
    field: CovarianceField | None = None,
    robot: Robot | None = None,
    *,
    estimator: FieldConfig | Estimator | None = None,
    port: int = 0,
    open_browser: bool = True,
    folder: str | os.PathLike[str] | None = None,
    drives: Sequence[Any] = (),
) -> Explorer:
    """Open a page on this machine where the map's weak spots and paths are explored.

    A person drags start and goal, changes weight, estimator and lidar, draws walls, and sees what
    follows. Nobody on another machine can open the page. The call returns at once; the page lives
    until the explorer is closed or the program ends. A script ends with ``.wait()``.

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    field : CovarianceField, optional
        The map's field; by default it is read from the cache, or computed while the page is used.
    robot : Robot, optional
        The robot; where its lidar is not known, it has the field's.
    estimator : FieldConfig or Estimator, optional
        Settings of the field; by default `Fused` of the lidar, or `Sad` without one.
    port : int, default 0
        Port of the server, 0 to 65535; 0 takes any free one. Name one to find the page again.
    open_browser : bool, default True
        False opens no browser. In a notebook none is opened: the page is displayed there.
    folder : path, optional
        Folder that the page may write maps and exports to; without it, it writes none.
    drives : sequence of Recording or path, default ()
        Recorded drives to show: recordings or their files, see `locplan.recordings.read_drive`.

    Returns
    -------
    Explorer
        The page, which a notebook displays.

    Raises
    ------
    LocplanError
        If an argument is out of its range, the port is taken, or a library is missing.

    Examples
    --------
    >>> import locplan
    >>> grid = locplan.maps.environments.make("two_corridors", resolution=0.1)
    >>> with locplan.explore(grid, open_browser=False) as page:
    ...     page.address.startswith("http://127.0.0.1:")
    True
    """
    from locplan.explorer._scene import Opening

    check_grid(grid)
    robot = Robot() if robot is None else robot
    instance("robot", robot, Robot, 'such as locplan.Robot("turtlebot4")')
    if field is not None and estimator is None:
        config = field.config
    elif estimator is None:
        config = FieldConfig(Fused.of(robot.lidar) if robot.lidar else Sad())
    else:
        config = config_of(estimator)
    opening = Opening(
        config,
        robot,
        folder=None if folder is None else Path(file_path("folder", folder)),
        drives=tuple(RecordedDrive.of(each) for each in drives),
    )
    module = sys.modules.get("IPython")
    shell = module.get_ipython() if module is not None else None
    framed = getattr(shell, "kernel", None) is not None  # a notebook's shows HTML
    explorer = opened(grid, opening, port=port, field=field, framed=framed)
    if open_browser and not framed:
        explorer.open()
    return explorer


def check_installed() -> None:
    """Raise a LocplanError unless the libraries of the server are installed."""
    for library in ("starlette", "uvicorn", "websockets"):
        needed(library, "explore", "the explorer")


def opened(
    grid: OccupancyGrid,
    opening: Opening,
    *,
    port: int = 0,
    field: CovarianceField | None = None,
    framed: bool = False,
) -> Explorer:
    """Serve a page, and begin to compute its field.

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    opening : Opening
        What the page begins with.
    port : int, default 0
        Port of the server, 0 to 65535; 0 takes any free one.
    field : CovarianceField, optional
        The map's field, if it is there already.
    framed : bool, default False
        True for a page that a notebook displays.

    Returns
    -------
    Explorer
        The page.

    Raises
    ------
    LocplanError
        If an argument is out of its range, the port is taken, or a library is missing.
    """
    check_installed()
    from locplan.explorer._server import Server
    from locplan.explorer._session import Session

    whole("port", port, 0, 65535)
    _check_stops(grid, opening)
    session = Session(grid, opening)
    if not np.isfinite(session.scene.costs.density).any():
        raise ConfigError(
            f"a robot of radius {opening.robot.radius:g} m has no room on this map; give it a"
            " smaller footprint or margin"
        )
    server = Server(session, port, framed=framed)
    server.start()
    session.begin(field)
    threading.Thread(target=session.prepare, daemon=True).start()
    return Explorer(server)


def _check_stops(grid: OccupancyGrid, opening: Opening) -> None:
    """Raise a PoseError if a place of the first path lies outside the map.

    One in a wall is moved by the page to the nearest free cell.
    """
    named = {"start": opening.start, "goal": opening.goal}
    named |= {f"waypoint {n}": xy for n, xy in enumerate(opening.via, 1)}
    for role, xy in named.items():
        if xy is not None and not grid.contains(*grid.world_to_cell(*xy[:2])):
            # A blank costmap makes the sentence of the planners, with the nearest free place.
            Costmap.blank(grid, robot=opening.robot).cell_of(xy, role)


@dataclass(frozen=True, eq=False)
class RecordedDrive:
    """A recorded drive that the page can show."""

    name: str
    """Name of the drive, that of its file."""
    recording: Recording
    """Its scans and poses."""

    @classmethod
    def of(
        cls,
        drive: RecordedDrive | Recording | str | os.PathLike[str],
        progress: ProgressCallback | None = None,
    ) -> RecordedDrive:
        """A drive of a recording, or of its file; a ConfigError of anything else.

        Parameters
        ----------
        drive : RecordedDrive, Recording or path
            The drive; for files see `locplan.recordings.read_drive`.
        progress : callable, optional
            Called with (done, total) messages of a file.
        """
        from locplan.recordings import Recording, read_drive

        if isinstance(drive, RecordedDrive):
            return drive
        if isinstance(drive, Recording):
            return cls(printable(drive.source.file) or "recorded drive", drive)
        if isinstance(drive, (str, os.PathLike)):
            return cls(printable(Path(drive).name), read_drive(drive, progress=progress))
        raise ConfigError(f"a drive must be a recording or its file, not {shown(drive)}")

    def about(self) -> dict[str, object]:
        """Name, duration and sizes, fit for JSON."""
        times, scans = self.recording.times, len(self.recording)
        duration = None if times is None else float(times[-1] - times[0])
        poses = min(scans, MAX_POSES)
        return {"name": self.name, "duration": duration, "poses": poses, "scans": scans}

    def shown(
        self,
        grid: OccupancyGrid,
        *,
        matched: bool = False,
        threads: int | None = None,
        progress: ProgressCallback | None = None,
    ) -> dict[str, object]:
        """Poses of the drive, evenly spaced over its scans, and the scans that are unlike a map.

        A scan is unlike the map if fewer than 60 % of its returns end within two cells of a wall,
        at least 0.1 m: the share from which `locplan.recordings.fit_to_map` says that a map fits.
        One with fewer than 10 returns is not judged. "sd" is the largest standard deviation of the
        position of each scan [m], of scans that were `matched` with the map, which takes up to a
        millisecond each; "t" is the time since the first scan [s], or the number of the pose
        without times.

        Parameters
        ----------
        grid : OccupancyGrid
            The map.
        matched : bool, default False
            True matches the scans with the map.
        threads : int, optional
            Number of threads; all cores by default.
        progress : callable, optional
            Called with (done, total) scans.
        """
        from locplan.recordings import match_scans, scans_unlike

        recording, count = self.recording, len(self.recording)
        kept = np.unique(np.linspace(0, count - 1, min(count, MAX_POSES)).round().astype(np.int64))
        # Of the whole recording nothing is copied where few scans are without a return.
        x, y, heading = recording.poses[kept].round(4).T.tolist()
        times: list[float] = [*map(float, range(len(kept)))]
        if recording.times is not None:
            times = (recording.times[kept] - recording.times[kept[0]]).round(3).tolist()
        deviation = np.full(len(kept), np.nan)
        if matched:
            with suppress(RecordingError):  # no scan on this map is matched well enough
                found = match_scans(recording[kept], grid, threads=threads, progress=progress)
                deviation = found.position_std.round(4)
        return {
            "t": times,
            "timed": recording.times is not None,
            **{"x": x, "y": y, "heading": heading},
            "sd": finite(deviation.tolist()),
            "unlike": scans_unlike(recording, grid, kept).astype(int).tolist(),
            "scans": count,
        }
