"""What is taken away from the page: exports, and a page of its own.

The shared page is one file out of the explorer's own: modules, style and icon within the HTML."""

from __future__ import annotations

import base64
import dataclasses
import hashlib
import json
import re
import warnings
import zlib
from collections.abc import Mapping
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from locplan._support.files import make_folder
from locplan._support.kernels.arrays import Octets
from locplan._support.tables import finite
from locplan.app.explorer.plans import plan
from locplan.app.explorer.requests import Ask
from locplan.app.explorer.state import cells_of
from locplan.errors import ConfigError, LocplanError
from locplan.export.parameters import distribution
from locplan.export.registry import ExportJob, formats
from locplan.planning.plans import AWARE

if TYPE_CHECKING:
    from locplan.app.explorer.requests import Ask, Work
    from locplan.app.explorer.session import Session


def export(session: Session, ask: Ask, work: Work) -> dict[str, object]:
    """Write an export of the view, as `locplan export` does; only "path" exports its way.

    Without `force` the export gets a number behind its name if there is one of this name. With
    it, files of the same names are overwritten.
    """
    offered = ("nav2-keepout", "nav2-speed", "path")
    to = ask.one_of("to", offered, offered[0])
    distro, opening = ask.text("distro", None), session.opening
    folder, force = opening.folder, opening.force
    view = session.view(ask)
    work.progress(0, 1, "writing")
    if folder is None:
        raise ConfigError("exports need a folder: start the explorer with --output FOLDER")
    format = formats()[to]
    if distro is not None:
        distribution(distro)
    has_distro = any(each.name == "distro" for each in dataclasses.fields(format.options))
    options: Any = format.options(**({"distro": distro} if distro and has_distro else {}))
    suffix = "".join(format.suffixes[:1])
    stem = f"{plain_name(view.grid.name)}-{to}"
    target = folder / f"{stem}{suffix}" if force else _unused(folder, stem, suffix)
    paths = {AWARE: view.path()} if format.paths == "one" else {}
    make_folder(folder)
    format.check_target(target, force=force)
    job = ExportJob(view.costs, view.field, paths, view.robot, force=force)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", UserWarning)
        format.export(target, job, options)
    written = [target] if target.is_file() else sorted(target.rglob("*"))
    return {
        "folder": str(folder),
        "files": [each.relative_to(folder).as_posix() for each in written if each.is_file()],
        "warnings": [*dict.fromkeys(str(each.message) for each in caught)],
    }


def plain_name(name: str) -> str:
    """A map's name as the name of a file: letters, digits, dots, dashes and underlines."""
    return re.sub(r"[^\w.-]+", "_", name).strip("._-")[:80] or "map"


def _unused(folder: Path, stem: str, suffix: str) -> Path:
    """A name in the folder that nothing has, with a number where others are there."""
    for number in range(1, 1001):
        target = folder / f"{stem}{f'-{number}' if number > 1 else ''}{suffix}"
        if not target.exists() and not target.is_symlink():
            return target
    raise LocplanError(f"{folder}: holds 1000 such exports; remove some")


STATIC = Path(__file__).parent / "static"
IMPORT = re.compile(r'^import (?:\{[^}]*\} from )?"\./([\w-]+\.js)";\n', re.M)
FILE = re.compile(r'<(?:link|script)[^>]* (?:href|src)="static/([\w.-]+)">(?:</script>)?\n?')


def share(session: Session, ask: Ask, work: Work) -> dict[str, object]:
    """Answer the ask for a page of the present view: it is kept to be downloaded.

    Equal views make equal pages: there is no date in them, and no path of the machine.
    """
    scene, textures = session.scene, session.layers()
    if not textures:
        raise ConfigError("the field is still being computed; wait until it is there")
    view = ask.mapping("view")
    way = Ask("plan", ask.id, {name: view.get(name) for name in ("start", "goal", "via", "weight")})
    work.progress(0, 2, "planning")
    answer = plan(session, way, work) if way.has("start") and way.has("goal") else None
    work.progress(1, 2, "packing")
    about, shown = session.about(), session.state()
    # Only a server can serve these.
    about |= {name: type(about[name])() for name in ("can", "distros", "lidars")}
    data = {
        "about": about,
        "state": {**shown, "busy": None},
        "cells": _packed(cells_of(session.grid.cells)),
        "layers": {name: _packed(each.texels) for name, each in textures.items()},
        "answer": answer,
        "view": view,
    }
    name, estimator = about["map"]["name"] or "map", shown["field"]["estimator"]
    page = one_page(f"{name} · {estimator} · locplan", finite(data)).encode()
    if session.scene is not scene:
        raise ConfigError("the map or its field was changed meanwhile; share the view again")
    file = f"{plain_name(session.grid.name)}-locplan.html"
    key = session.add_download(file, page, "text/html")
    return {"download": key, "name": file, "bytes": len(page)}


def _packed(values: Octets) -> str:
    """Bytes of an array, deflated, as text."""
    return base64.b64encode(zlib.compress(np.ascontiguousarray(values).tobytes(), 9)).decode()


def one_page(title: str, data: Mapping[str, object]) -> str:
    """The page with all that it needs inside, and ``window.LOCPLAN = data``.

    Its policy lets it run what it carries, and ask nobody for anything.

    Parameters
    ----------
    title : str
        Title of the page.
    data : mapping
        What the page shows, fit for JSON.

    Raises
    ------
    LocplanError
        If the files do not fit together.
    """
    text = json.dumps(data, allow_nan=False, separators=(",", ":"))  # ASCII only
    for letter in "<>&":  # whatever texts are in it, it can stand in a script
        text = text.replace(letter, f"\\u{ord(letter):04x}")
    inside: dict[str, list[str]] = {"script": [f"window.LOCPLAN = {text};"], "style": []}

    def inlined(match: re.Match[str]) -> str:
        file = STATIC / match[1]
        if file.suffix == ".svg":
            icon = base64.b64encode(_text(file).encode()).decode()
            return f'<link rel="icon" href="data:image/svg+xml;base64,{icon}">\n'
        if file.suffix == ".css":
            inside["style"].append(_text(file).replace("</style", "<\\/style"))
            return f"<style>{inside['style'][-1]}</style>\n"
        inside["script"].append(_one_script(file))
        begin, main = inside["script"]
        return f'<script>{begin}</script>\n<script type="module">{main}</script>\n'

    page = _text(STATIC / "index.html")
    if page.count("<head>") != 1 or "static/" in FILE.sub("", page):
        raise LocplanError(f"{STATIC / 'index.html'}: is no page that can be shared")
    page = re.sub(r"<title>.*?</title>", "<title></title>", page, flags=re.S)
    page = FILE.sub(inlined, page).replace("<title></title>", f"<title>{escape(title)}</title>", 1)
    policy = (
        f"default-src 'none'; script-src {_hashes(inside['script'])};"
        f" style-src {_hashes(inside['style'])}; img-src data: blob:; base-uri 'none';"
        " form-action 'none'"
    )
    meta = f'<meta http-equiv="Content-Security-Policy" content="{policy}">'
    return page.replace("<head>", f"<head>\n{meta}", 1)


def _one_script(main: Path) -> str:
    """All modules that the main one imports, and itself, as one script.

    Modules name no two things alike at their top level, so that they can share one scope.
    """
    texts: dict[str, str] = {}
    under_way: set[str] = set()

    def add(name: str) -> None:
        if name in under_way:  # perhaps in a circle, which functions bear
            return
        under_way.add(name)
        text = _text(STATIC / name)
        for other in IMPORT.findall(text):
            add(other)
        text = IMPORT.sub("", text)
        texts[name] = re.sub(
            r"^export (?=(async )?(function|const|let|class)\b)", "", text, flags=re.M
        )

    add(main.name)
    script = "\n".join(texts.values())
    if left := re.search(r"^(import|export)\b.*", script, re.M):
        raise LocplanError(f"a module of the page cannot be joined to others: {left.group()}")
    # Within texts and patterns, the only places where these stand, a backslash changes nothing.
    return re.sub(r"<(?=/script|!--)", r"\\x3c", script, flags=re.I)


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
