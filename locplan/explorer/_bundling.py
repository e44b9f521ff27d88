"""One page out of the explorer's own files: modules, style and icon within the HTML."""

from __future__ import annotations

import base64
import hashlib
import json
import re
from collections.abc import Mapping
from html import escape
from pathlib import Path

from locplan.errors import LocplanError

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
