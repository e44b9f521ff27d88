"""The pages of public names are made without a warning, and their links lead somewhere."""

from __future__ import annotations

import importlib.util
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest

import locplan

SCRIPT = Path(__file__).resolve().parents[2] / "examples" / "api.py"


class Page(HTMLParser):
    """The links of a page, and the names within it that links may have."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.links: set[str] = set()
        self.names: set[str] = set()
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        named = dict(attrs)
        self.names.add(named.get("id") or "")
        if tag in ("a", "link"):
            self.links.add(named.get("href") or "")


@pytest.mark.long
def test_pages_of_all_public_names_have_no_dead_link(tmp_path):
    spec = importlib.util.spec_from_file_location("api", SCRIPT)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    module.main(str(tmp_path))

    pages = {path: Page(path.read_text("utf-8")) for path in tmp_path.rglob("*.html")}
    dead = []
    for path, page in pages.items():
        for link in page.links:
            parts = urlsplit(link)
            if parts.scheme:
                continue
            target = (path.parent / parts.path).resolve() if parts.path else path
            known = pages[target].names if target in pages else None
            if known is None or (parts.fragment and unquote(parts.fragment) not in known):
                dead.append((path.name, link))
    assert dead == []
    shown = pages[tmp_path / "locplan.html"].names | {path.stem for path in pages}
    assert {name for name in locplan.__all__ if not name.startswith("_")} <= shown
