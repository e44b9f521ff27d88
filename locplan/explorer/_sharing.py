"""A page of the present view that opens from the disk: read-only, without any server.

It is one page out of the explorer's own files: modules, style and icon within the HTML.
"""

from __future__ import annotations

import base64
import hashlib
import json
import re
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from locplan.errors import ConfigError, LocplanError
from locplan.explorer._asks import Ask
from locplan.explorer._exporting import plain_name
from locplan.explorer._plans import plan
from locplan.explorer._textures import cells_of

if TYPE_CHECKING:
    from locplan.explorer._asks import Work
    from locplan.explorer._session import Session

STATIC = Path(__file__).parent / "static"
PAGE, MAIN = "index.html", "main.js"
IMPORT = re.compile(r'^import \{[^}]*\} from "\./([\w-]+\.js)";\n', re.M)
SIDE_EFFECT = re.compile(r'^import "\./([\w-]+\.js)";\n', re.M)
EXPORT = re.compile(r"^export (?=(async )?(function|const|let|class)\b)", re.M)
STYLE = re.compile(r'<link rel="stylesheet" href="static/([\w-]+\.css)">\n?')
ICON = re.compile(r'<link rel="icon" href="static/([\w-]+\.svg)">\n?')
SCRIPT = re.compile(rf'<script type="module" src="static/{MAIN}"></script>\n?')
TITLE = re.compile(r"<title>.*?</title>", re.S)
POLICY = (
    "default-src 'none'; script-src {scripts}; style-src {styles}; img-src data: blob:;"
    " base-uri 'none'; form-action 'none'"
)
"""Content security policy of the page: it runs what it carries, and asks nobody for anything."""
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
    about: Mapping[str, Any],
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
    about, shown : mapping
        What the program and the map are, and what is shown, as the server sends them.
    cells : (H, W) array of uint8
        Classes of the map's cells, row 0 on top.
    layers : mapping of str to (h, w) array of uint8
        Steps of each layer on the lattice, row 0 on top.
    answer : mapping, optional
        Answer to the ask for both paths.
    view : mapping, optional
        What the page wants to find again: layer, colours, zoom.
    """
    lasting = {name: value for name, value in about.items() if name not in LIVE}
    lasting |= {name: type(about[name])() for name in LIVE if name in about}
    data = {
        "about": lasting,
        "state": {**shown, "busy": None},
        "cells": _packed(cells),
        "layers": {name: _packed(texels) for name, texels in layers.items()},
        "answer": None if answer is None else dict(answer),
        "view": dict(view or {}),
    }
    field = shown.get("field") or {}
    parts = [about.get("map", {}).get("name") or "map", field.get("estimator"), "locplan"]
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
        session.about(),
        session.state(),
        cells_of(session.grid.cells),
        {name: each.texels for name, each in textures.items()},
        answer,
        view,
    )
    if session.scene is not scene:
        raise ConfigError("the map or its field was changed meanwhile; share the view again")
    name = f"{plain_name(session.grid.name)}-locplan.html"
    key = session.add_download(name, page.content, "text/html")
    return {"download": key, "name": name, "bytes": page.size}


def _packed(values: NDArray[np.uint8]) -> str:
    """Bytes of an array, deflated, as text."""
    return base64.b64encode(zlib.compress(np.ascontiguousarray(values).tobytes(), 9)).decode()


def one_page(title: str, data: Mapping[str, object], static: Path = STATIC) -> str:
    """The page with all that it needs inside, and ``window.LOCPLAN = data``.

    Parameters
    ----------
    title : str
        Title of the page.
    data : mapping
        What the page shows, fit for JSON.
    static : path
        The folder of the page's files.

    Raises
    ------
    LocplanError
        If the files do not fit together.
    """
    page = _text(static / PAGE)
    scripts = [f"window.LOCPLAN = {json_in_html(data)};", one_script(static)]
    styles = [_text(static / name).replace("</style", "<\\/style") for name in STYLE.findall(page)]
    policy = POLICY.format(scripts=_hashes(scripts), styles=_hashes(styles) or "'none'")
    page = STYLE.sub("", ICON.sub(_icon(static), page))
    page, found = SCRIPT.subn("", page)
    page, named = TITLE.subn(lambda _: f"<title>{escape(title)}</title>", page, count=1)
    head, body, rest = page.partition("</head>")
    inner, end, after = rest.rpartition("</body>")
    if not (found == named == 1 and body and end) or 'src="static' in page:
        raise LocplanError(f"{static / PAGE}: is no page that can be shared")
    return "".join(
        [
            head.replace("<head>", f'<head>\n<meta http-equiv="Content-Security-Policy" '
                         f'content="{policy}">', 1),
            *(f"<style>{style}</style>\n" for style in styles),
            body,
            inner,
            f"<script>{scripts[0]}</script>\n",
            f'<script type="module">{scripts[1]}</script>\n',
            end,
            after,
        ]
    )  # fmt: skip


def one_script(static: Path = STATIC) -> str:
    """All modules that the main one imports, and itself, as one script.

    Modules name no two things alike at their top level, so that they can share one scope.
    """
    texts: dict[str, str] = {}
    under_way: set[str] = set()

    def add(name: str) -> None:
        if name in texts or name in under_way:  # the latter is a circle, which functions bear
            return
        under_way.add(name)
        text = _text(static / name)
        for other in [*IMPORT.findall(text), *SIDE_EFFECT.findall(text)]:
            add(other)
        texts[name] = EXPORT.sub("", SIDE_EFFECT.sub("", IMPORT.sub("", text)))

    add(MAIN)
    script = "\n".join(texts.values())
    if left := re.search(r"^(import|export)\b.*", script, re.M):
        raise LocplanError(f"a module of the page cannot be joined to others: {left.group()}")
    # Within texts and patterns, the only places where these stand, a backslash changes nothing.
    return re.sub(r"<(?=/script|!--)", r"\\x3c", script, flags=re.I)


def json_in_html(data: object) -> str:
    """JSON that can stand in a script of an HTML page, whatever texts are in it."""
    text = json.dumps(data, allow_nan=False, separators=(",", ":"))  # ASCII only
    for letter in "<>&":
        text = text.replace(letter, f"\\u{ord(letter):04x}")
    return text


def _icon(static: Path) -> str:
    """The icon within the page."""
    files = ICON.findall(_text(static / PAGE))
    if not files:
        return ""
    text = base64.b64encode((static / files[0]).read_bytes()).decode()
    return f'<link rel="icon" href="data:image/svg+xml;base64,{text}">\n'


def _hashes(texts: list[str]) -> str:
    """Sources of a policy that allow just these texts."""
    digests = (hashlib.sha256(text.encode()).digest() for text in texts)
    return " ".join(f"'sha256-{base64.b64encode(digest).decode()}'" for digest in digests)


def _text(file: Path) -> str:
    """A file of the page, with line ends that do not depend on the system."""
    try:
        return file.read_bytes().decode().replace("\r\n", "\n")
    except OSError as error:
        raise LocplanError(f"{file}: cannot be read ({error.strerror}); reinstall it") from None
