"""What is taken away from the page: exports, the command of the path shown, and a page of its own.

The shared page is one file out of the explorer's own: modules, style and icon within the HTML."""

from __future__ import annotations

import base64
import dataclasses
import hashlib
import json
import math
import re
import shlex
import warnings
import zlib
from collections.abc import Mapping
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from locplan._kernels.arrays import Octets
from locplan._util.checks import printable
from locplan._util.files import make_folder
from locplan._util.runs import Recipe, Spelled, as_argument, number_text
from locplan._util.tables import finite
from locplan.errors import ConfigError, LocplanError
from locplan.explorer._asks import Ask
from locplan.explorer._plans import plan
from locplan.explorer._scene import MAX_DRIVES
from locplan.explorer._state import cells_of
from locplan.export import ExportJob, distribution, formats
from locplan.field import config_spelled, lidar_of
from locplan.planners import AWARE, Position
from locplan.robots import robot_spelled

if TYPE_CHECKING:
    from locplan.explorer._asks import Ask, Work
    from locplan.explorer._session import Session
    from locplan.explorer._view import View


def export(session: Session, ask: Ask, work: Work) -> dict[str, object]:
    """Write an export of the view, as `locplan export` does; only "path" exports its way.

    Nothing that is there is replaced without `force`: the export gets a number behind its name.
    With it, a file is replaced, and a folder if it is an export of ours without changes.
    """
    offered = ("nav2-keepout", "nav2-speed", "path")
    to = ask.one_of("to", offered, offered[0])
    distro, opening = ask.text("distro", None), session.opening
    folder, force = opening.folder, opening.force
    view = session.view(ask)
    work.progress(0, 1, "writing")
    if folder is None:
        raise ConfigError("exports need a folder: start the explorer with --folder FOLDER")
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
    job = ExportJob(view.costs, view.field, paths, view.robot)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", UserWarning)
        format.write(target, job, options)
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


def reproduce(session: Session, ask: Ask, work: Work) -> dict[str, str]:
    """Answer with the command and the code that plan the path shown, or choose, once more.

    Both plan as the page does for a path at rest, through all waypoints, with the planner
    any-angle, on a field that has the spacing of the page's everywhere. With a number of drives
    they choose by drives, for which the field is finer near the paths, as the page does.
    """
    drives = ask.whole("drives", 2, MAX_DRIVES, 0)
    view, file = session.view(ask), session.map_file
    config, robot, (start, *_, goal) = view.field.config, view.robot, view.stops
    assumed = not config.estimator.casts_rays and robot.lidar == lidar_of(config)
    if assumed and not drives:  # commands assume the same lidar; what is driven has a known one
        robot = dataclasses.replace(robot, lidar=None)
    spelled = config_spelled(config, robot.lidar, whole=not drives)
    settings: dict[str, Any] = {
        "start": _end("start", start),
        "goal": _end("goal", goal),
        "robot": robot_spelled(robot),
        "config": spelled._replace(argument="costs"),
        **view.cost_settings,
        "drives": drives,
    }
    settings |= _more(session, view, drives)
    if config.estimator.casts_rays and not drives:  # options say that by the spacing
        whole = "lambda grid, points=None: locplan.load_or_compute(grid, config)"
        settings["compute"] = Spelled((), whole)
    notes = []
    if file is None:
        notes = ['No file of this map is known: locplan.save_map(grid, "map.yaml") writes one']
    elif session.edited:
        notes = [
            f"{printable(file)} is not the map on the page, which was edited since (or an edit"
            " undone).",
            "For the page's map: save it on the page under a new name, and copy this once more.",
        ]
    unsaid = []
    if spelled.after:
        unsaid = [f"{spelled.words[-1]} is written by the Python code"]
        if robot.lidar and robot.lidar != getattr(config.estimator, "lidar", None):
            unsaid += ["the command cannot say the lidar: take the Python code"]
    recipe = Recipe("plan", "choose", file or "map.yaml", settings, notes)
    shell = dataclasses.replace(recipe, notes=[*notes, *unsaid]).shell
    if drives:
        shell += " --output chosen"
    if "filter_map" in settings and "locplan.mend(" in settings["filter_map"].code:
        shell = f"locplan mend {shlex.quote(as_argument(recipe.map_file))} --output mended\n{shell}"
    return {"shell": shell, "python": f"{recipe.python}\nprint(result.table())\n"}


def _end(name: str, pose: Position) -> Any:
    """An end for `Recipe`, whose heading is in degrees for a shell, and in radians in Python."""
    if len(pose) == 2:
        return pose
    texts = [number_text(each) for each in (*pose[:2], math.degrees(pose[2]))]
    return Spelled((f"--{name}", ",".join(texts)), repr(tuple(map(float, pose))))


def _more(session: Session, view: View, drives: int) -> dict[str, Any]:
    """Planner, filter's map and waypoints, where they are not the usual ones."""
    more: dict[str, Any] = _filter_map(session, view) if drives else {}
    if view.planner:
        words = ("--planner", view.planner)
        more["planner"] = Spelled(words, f"[{view.planner!r}]", argument="candidates")
    if via := view.stops[1:-1]:
        more["via"] = [xy[:2] for xy in via]
    return more


def _filter_map(session: Session, view: View) -> dict[str, Any]:
    """The setting of the filter's map, if it is not the one that is driven in."""
    if view.filter_map is None:
        return {}
    report, file, code = (
        session.opening.report,
        "mended/map_amcl.yaml",
        "locplan.mend(grid).filter_map",
    )
    if report and report.filter_file:
        file = str(report.filter_file)
        code = f"locplan.load_map({file!r})"
    return {"filter_map": Spelled(("--filter-map", file), code)}


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
    about |= {name: type(about[name])() for name in ("can", "drives", "distros", "lidars")}
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
