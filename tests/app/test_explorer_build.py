"""The page of the explorer as it was built from its sources."""

import hashlib
import json
import re
from pathlib import Path

import numpy as np

import locplan
from locplan._support.drawing import FIELD_COLOURS, RECOMMENDED

PAGE = Path(locplan.__file__).parent / "app" / "explorer" / "page"
BUILT = PAGE / "dist"
FILES = ("build.mjs", "icon.svg", "index.html", "package-lock.json", "package.json")


def test_built_page_names_digest_of_sources():
    """If this fails, run `npm ci && npm run build` in the folder `page`."""
    files = [*FILES, *(f"src/{file.name}" for file in (PAGE / "src").iterdir())]
    digest = hashlib.sha256()
    for name in sorted(files):
        digest.update(f"{name}\n".encode() + (PAGE / name).read_bytes() + b"\n")
    first_line = (BUILT / "page.js").read_text().partition("\n")[0]
    assert first_line.split()[-2] == digest.hexdigest()


def test_built_page_has_four_files():
    assert sorted(file.name for file in BUILT.iterdir()) == [
        "icon.svg",
        "index.html",
        "page.css",
        "page.js",
    ]


def test_built_page_contains_licences_of_libraries():
    script = (BUILT / "page.js").read_text()
    for name, version in json.loads((PAGE / "package.json").read_text())["dependencies"].items():
        assert re.search(rf"^{re.escape(name)} {re.escape(version)}$", script, re.M), name


def test_lock_file_names_no_registry():
    lock = json.loads((PAGE / "package-lock.json").read_text())
    assert all("resolved" not in package for package in lock["packages"].values())


def test_page_has_no_inline_code():
    page = (BUILT / "index.html").read_text()
    assert not re.search(r" style=|<style| on\w+=|<script>|https?://", page)


def test_recommended_path_has_one_colour():
    """The page draws recommended paths as pictures do."""
    assert f"--route:{RECOMMENDED};" in (PAGE / "src" / "page.css").read_text().replace(" ", "")


def test_page_has_colours_of_pictures():
    """The page draws a field in the colours of `FIELD_COLOURS`, which begin at a lighter one."""
    text = re.search(r'const STOPS = "(\w+)"', (PAGE / "src" / "theme.js").read_text())[1]
    stops = np.frombuffer(bytes.fromhex(text), np.uint8).reshape(-1, 3)
    shares = np.linspace(1.0, 0.0, len(stops)) / 0.8  # pictures leave out the darkest fifth
    shown = shares <= 1
    colours = FIELD_COLOURS(shares[shown], bytes=True)[:, :3]
    np.testing.assert_allclose(stops[shown].astype(int), colours.astype(int), atol=4)


def test_texts_name_no_command_or_option():
    for file in (PAGE / "src").glob("*.js"):
        code = re.sub(r"^\s*//.*$", "", file.read_text(), flags=re.M)
        for text in re.findall(r"`[^`]*`|\"[^\"\n]*\"", code):
            assert not re.search(r"\blocplan \w|(?<![\w-])--[a-z]", text), (file.name, text)
