"""A page of the present view that opens from the disk: read-only, without any server."""

from __future__ import annotations

import base64
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from locplan.errors import ConfigError
from locplan.explorer._bundling import one_page
from locplan.explorer._exporting import plain_name
from locplan.explorer._plans import plan
from locplan.explorer._state import about, state
from locplan.explorer._textures import cells_of
from locplan.explorer._wire import Ask

if TYPE_CHECKING:
    from locplan.explorer._asks import Work
    from locplan.explorer._session import Session

LIVE = ("can", "drives", "distros", "lidars")
"""Entries of `about` that only a server can serve."""


WAY = ("start", "goal", "via", "weight")
"""Entries of a view that say which path is shown."""


@dataclass(frozen=True)
class SharedPage:
    """A page to hand on."""

    title: str
    """Title of the page: the map and the estimator."""
    content: bytes
    """The page, HTML in UTF-8."""

    @property
    def size(self) -> int:
        """Size of the page [bytes]."""
        return len(self.content)


def shared_page(
    told: Mapping[str, Any],
    shown: Mapping[str, Any],
    cells: NDArray[np.uint8],
    layers: Mapping[str, NDArray[np.uint8]],
    answer: Mapping[str, Any] | None = None,
    view: Mapping[str, Any] | None = None,
) -> SharedPage:
    """Make a page that shows a view without a server.

    Equal views make equal pages: there is no date in them, and no path of the machine.

    Parameters
    ----------
    told, shown : mapping
        What the program and the map are, and what is shown, as the server tells them.
    cells : (H, W) array of uint8
        Classes of the map's cells, row 0 on top.
    layers : mapping of str to (h, w) array of uint8
        Steps of each layer on the lattice, row 0 on top.
    answer : mapping, optional
        Answer to the ask for both paths.
    view : mapping, optional
        What the page wants to find again: layer, colours, zoom.
    """
    lasting = {name: value for name, value in told.items() if name not in LIVE}
    lasting |= {name: type(told[name])() for name in LIVE if name in told}
    data = {
        "about": lasting,
        "state": {**shown, "busy": None},
        "cells": _packed(cells),
        "layers": {name: _packed(texels) for name, texels in layers.items()},
        "answer": None if answer is None else dict(answer),
        "view": dict(view or {}),
    }
    field = shown.get("field") or {}
    parts = [told.get("map", {}).get("name") or "map", field.get("estimator"), "locplan"]
    title = " · ".join(str(part) for part in parts if part)
    return SharedPage(title, one_page(title, data).encode())


def share(session: Session, ask: Ask, work: Work) -> dict[str, object]:
    """Answer the ask for a page of the present view: it is kept to be downloaded."""
    scene, textures = session.scene, session.layers()
    if not textures:
        raise ConfigError("the field is still being computed; wait until it is there")
    view = ask.mapping("view")
    way = Ask("plan", ask.id, {name: view.get(name) for name in WAY})
    work.progress(0, 2, "planning")
    answer = plan(session, way, work) if way.has("start") and way.has("goal") else None
    work.progress(1, 2, "packing")
    page = shared_page(
        about(session),
        state(session),
        cells_of(session.grid.cells),
        {name: each.texels for name, each in textures.items()},
        answer,
        view,
    )
    if session.scene is not scene:
        raise ConfigError("the map or its field was changed meanwhile; share the view again")
    name = f"{plain_name(session.name)}-locplan.html"
    key = session.add_download(name, page.content, "text/html")
    return {"download": key, "name": name, "bytes": page.size}


def _packed(values: NDArray[np.uint8]) -> str:
    """Bytes of an array, deflated, as text."""
    return base64.b64encode(zlib.compress(np.ascontiguousarray(values).tobytes(), 9)).decode()
