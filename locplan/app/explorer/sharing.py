"""Shared pages: the current view in one file that needs no server."""

from __future__ import annotations

import base64
import hashlib
import json
import re
import zlib
from collections.abc import Mapping
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from locplan._support.kernels.arrays import Octets
from locplan._support.reading import make_file_stamp
from locplan._support.tables import nan_to_none
from locplan.app.explorer.exports import make_map_file_name
from locplan.app.explorer.layers import make_cell_classes
from locplan.app.explorer.plans import plan_route
from locplan.app.explorer.scene import MapScene
from locplan.app.explorer.state import describe_session, describe_state
from locplan.errors import ConfigError

if TYPE_CHECKING:
    from locplan.app.explorer.messages import Question, QuestionJob
    from locplan.app.explorer.session import Session

KIND, VERSION = "explorer", 1
PAGE = Path(__file__).parent / "page" / "dist"
"""Folder of the files that the page is made of."""
STYLE = '<link rel="stylesheet" href="page.css">'
SCRIPT = '<script type="module" src="page.js"></script>'
ICON = '<link rel="icon" href="icon.svg">'
"""Elements of index.html that a shared page replaces by inline ones."""


def share_page(
    session: Session, scene: MapScene, question: Question, job: QuestionJob
) -> dict[str, Any]:
    """Make a page of the current view that needs no server, and store it for a download.

    Equal views make equal pages: they contain no date and no path of this machine.
    """
    scene.check_field()
    job.progress(0, 2)
    has_route = question.has("start") and question.has("goal")
    path = plan_route(session, scene, question, job) if has_route else None
    basis = {**scene.basis, "route": question.text("route", None)}
    job.progress(1, 2)
    state, facts = describe_state(session), describe_session(session)
    layers = session.find_layers(str(scene.digest))
    if session.scene is not scene:
        raise ConfigError("the map or its field has changed; share the page again")
    facts |= {"can_export": False, "lidars": [], "distros": []}  # these need a server
    data = {
        "file": make_file_stamp(KIND, VERSION),
        "about": facts,
        "state": {**state, "busy": None},
        "cells": _encode_array(make_cell_classes(scene.site.grid.cells)),
        "layers": {name: _encode_array(layer.texels) for name, layer in layers.items()},
        "plan": path and {"basis": basis, **path},
        "view": question.mapping("view"),
    }
    name = scene.site.grid.name or "map"
    page = make_page(f"{name} – locplan", nan_to_none(data)).encode()
    file = f"{make_map_file_name(name)}-locplan.html"
    return {"download": session.add_download(file, page)}


def _encode_array(values: Octets) -> str:
    """Return the compressed bytes of an array as base64 text."""
    return base64.b64encode(zlib.compress(np.ascontiguousarray(values).tobytes(), 9)).decode()


def make_page(title: str, data: Mapping[str, Any]) -> str:
    """Return the page in one file, with ``window.LOCPLAN = data``.

    Its security policy allows only its own scripts, and no server.

    Parameters
    ----------
    title : str
        Title of the page.
    data : mapping
        Data that the page shows, for JSON.
    """
    text = json.dumps(data, allow_nan=False, separators=(",", ":"))  # ASCII only
    for letter in "<>&":  # texts of the user stand in a script
        text = text.replace(letter, f"\\u{ord(letter):04x}")
    begin = f"window.LOCPLAN = {text};"
    # These occur only in strings and patterns, where the backslash changes nothing.
    script = re.sub(r"<(?=/script|!--)", r"\\x3c", _read_page_file("page.js"), flags=re.I)
    style = _read_page_file("page.css").replace("</style", "<\\/style")
    icon = base64.b64encode(_read_page_file("icon.svg").encode()).decode()
    policy = (
        f"default-src 'none'; script-src {_hash_source(begin)} {_hash_source(script)};"
        f" style-src {_hash_source(style)}; img-src data: blob:; base-uri 'none';"
        " form-action 'none'"
    )
    meta = f'<meta http-equiv="Content-Security-Policy" content="{policy}">'
    page = re.sub(r"<title>.*?</title>", "", _read_page_file("index.html"), count=1, flags=re.S)
    page_parts = {
        "<head>": f"<head>\n{meta}\n<title>{escape(title)}</title>",
        STYLE: f"<style>{style}</style>",
        ICON: f'<link rel="icon" href="data:image/svg+xml;base64,{icon}">',
        SCRIPT: f'<script>{begin}</script>\n<script type="module">{script}</script>',
    }
    pattern = "|".join(map(re.escape, page_parts))
    return re.sub(pattern, lambda match: page_parts[match[0]], page)


def _hash_source(text: str) -> str:
    """Return the hash of a text for a security policy that allows only this text."""
    digest = hashlib.sha256(text.encode()).digest()
    return f"'sha256-{base64.b64encode(digest).decode()}'"


def _read_page_file(name: str) -> str:
    """Return the text of a file of the page."""
    return (PAGE / name).read_text("utf-8")
