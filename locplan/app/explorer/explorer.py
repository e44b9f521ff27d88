"""The explorer from Python, in a browser or in a notebook."""

from __future__ import annotations

import os
import sys
import threading
import webbrowser
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from locplan._support.checks import check_file_path, check_instance, check_integer
from locplan._support.public import require_extra
from locplan.errors import ConfigError
from locplan.field.config import FieldConfig, config_from_settings
from locplan.field.estimator import Estimator
from locplan.field.field import CovarianceField
from locplan.field.fisher import Fused
from locplan.field.sad import Sad
from locplan.maps.grid import OccupancyGrid, check_grid
from locplan.maps.zones import Zones, check_zones_on_map, normalize_zones
from locplan.planning.costmap import Costmap
from locplan.robots.robot import Robot

if TYPE_CHECKING:
    from locplan.app.explorer.scene import StartSettings
    from locplan.app.explorer.server import ExplorerServer
    from locplan.app.explorer.session import Session


class Explorer:
    """A page served on this machine until it is closed or the program ends.

    `locplan.explore` returns it.

    Parameters
    ----------
    server : Server
        The running server of the page.
    """

    def __init__(self, server: ExplorerServer) -> None:
        self._server = server

    def __repr__(self) -> str:
        return f"Explorer({self.address})"

    def __enter__(self) -> Explorer:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def address(self) -> str:
        """Address of the page, with its secret."""
        return self._server.address

    @property
    def session(self) -> Session:
        """Session that answers the page's questions."""
        return self._server.session

    @property
    def grid(self) -> OccupancyGrid:
        """The map with the changes of the page."""
        return self.session.grid

    @property
    def field(self) -> CovarianceField | None:
        """The field that the page shows; None while it is being computed."""
        return self.session.field

    def _repr_html_(self) -> str:
        """Return a frame with the page for a notebook, and a link to it below.

        The frame stays empty if the browser runs on another machine or the notebook forbids frames.
        """
        link = escape(self.address, quote=True)
        return (
            f'<iframe src="{link}" title="locplan explorer" width="100%" height="720"'
            ' style="border: 0" allow="clipboard-write; fullscreen"></iframe>'
            f'<a href="{link}" target="_blank" rel="noopener">Open in a new tab</a>'
        )

    def open(self) -> None:
        """Open the page in the browser."""
        webbrowser.open(self.address)

    def wait(self) -> None:
        """Wait until `close` or Ctrl-C closes the page."""
        self._server.wait()

    def close(self) -> None:
        """Stop the server."""
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
    zones: Zones | None = None,
) -> Explorer:
    """Open a page on this machine that shows the weak spots and paths of a map.

    The page simulates routes, edits the map, the lidar and zones, and exports for Nav2. Other
    machines cannot open it. The call returns at once. The page stays available until the explorer
    is closed or the program ends, so end a script with ``.wait()``.

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    field : CovarianceField, optional
        The map's field. By default it is read from the cache or computed in the background.
    robot : Robot, optional
        The robot. Without a lidar, it gets the lidar of the field.
    estimator : FieldConfig or Estimator, optional
        Settings of the field. By default `Fused` with a lidar, otherwise `Sad`.
    port : int, default 0
        Port of the server, 0 to 65535. 0 takes any free one.
    open_browser : bool, default True
        If True, open a browser, except in a notebook, which displays the page itself.
    folder : path, optional
        Folder for exports of the page. Without it, exports are disabled.
    zones : Zones, optional
        Initial zones, at most 1500. The page can edit and remove them.

    Returns
    -------
    Explorer
        The page. A notebook displays it.

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
    from locplan.app.explorer.scene import StartSettings
    from locplan.app.explorer.sites import changes_from_zones

    check_grid(grid)
    zones = normalize_zones(zones)
    check_zones_on_map(zones, grid)
    robot = Robot() if robot is None else robot
    check_instance("robot", robot, Robot, 'such as locplan.Robot("turtlebot4")')
    if field is not None and estimator is None:
        config = field.config
    elif estimator is None:
        config = FieldConfig(Fused(robot.lidar) if robot.lidar else Sad())
    else:
        config = config_from_settings(estimator)
    target = None if folder is None else Path(check_file_path("folder", folder))
    module = sys.modules.get("IPython")
    shell = module.get_ipython() if module is not None else None
    is_notebook = getattr(shell, "kernel", None) is not None
    opening = StartSettings(config, robot, folder=target, changes=changes_from_zones(zones))
    explorer = open_explorer(grid, opening, port=port, field=field)
    if open_browser and not is_notebook:
        explorer.open()
    return explorer


def check_installed() -> None:
    """Raise a LocplanError unless the libraries of the server are installed."""
    for library in ("starlette", "uvicorn", "websockets"):
        require_extra(library, "explore", "the explorer")


def open_explorer(
    grid: OccupancyGrid,
    start_settings: StartSettings,
    *,
    port: int = 0,
    field: CovarianceField | None = None,
) -> Explorer:
    """Serve a page, and start to compute its field.

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    start_settings : Opening
        The settings of the session.
    port : int, default 0
        Port of the server, 0 to 65535; 0 takes any free one.
    field : CovarianceField, optional
        The map's field, if it is already known.

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
    from locplan.app.explorer.server import ExplorerServer
    from locplan.app.explorer.session import Session

    check_integer("port", port, 0, 65535)
    session = Session(grid, start_settings)
    _check_stops(session.scene.costs, start_settings)
    if not np.isfinite(session.scene.costs.density).any():
        raise ConfigError(
            f"a robot of radius {start_settings.robot.radius:g} m fits nowhere on this map;"
            " reduce its"
            " footprint or margin"
        )
    server = ExplorerServer(session, port)
    server.start()
    session.begin(field)
    threading.Thread(target=session.prepare, daemon=True).start()
    return Explorer(server)


def _check_stops(costs: Costmap, start_settings: StartSettings) -> None:
    """Raise a PoseError if a stop of the first route lies outside the map."""
    stops = {"start": start_settings.start, "goal": start_settings.goal}
    stops |= {f"waypoint {n}": xy for n, xy in enumerate(start_settings.via, 1)}
    for role, xy in stops.items():
        if xy is not None and not costs.grid.contains(*costs.grid.cell(xy[:2])):
            costs.find_cell(xy, role)
