"""The guides' blocks run as they stand, and all links between the pages lead somewhere."""

from __future__ import annotations

import os
import re
import shlex
import shutil
import signal
import stat
import subprocess
import sys
import tempfile
from collections import Counter
from pathlib import Path
from urllib.request import HTTPCookieProcessor, build_opener

import pytest
from support.command_line import TERMINAL_CODE
from support.machine import TIMEOUT
from sybil import Example, Sybil
from sybil.evaluators.python import PythonEvaluator
from sybil.parsers.markdown import CodeBlockParser

from locplan.simulation.drives import LOST_DISTANCE

PROJECT = Path(__file__).resolve().parents[2]
GUIDES = PROJECT / "examples" / "guides"
PAGES = sorted(set(GUIDES.glob("*.md")) - {GUIDES / "README.md"})
"""The guides; their blocks are run, and those of the project's README.md."""
LINKING = (
    *(PROJECT / name for name in ("README.md", "CONTRIBUTING.md")),
    *sorted((PROJECT / "examples").rglob("*.md")),
)
GIVEN = ("maps", "examples/nav2_params.yaml")
"""Files that a reader copies to a folder, as the guides' first page says."""
RUN, SHOWN = ("sh", "python", "console", "text"), ("yaml", "bash")
"""Languages of blocks that are run or compared with output, and of those that are only shown.

A `bash` block needs ROS.
"""
SETS_UP = "python3 -m venv"
"""Beginning of a block that makes an environment; `.ci/run` runs those of README.md."""


QUICK = {"locplan tune maps/": "--paths 5 --drives 2", "python examples/paper.py paper": "0.1"}
"""Further options of commands that take long, by their beginning; no page depends on these."""
PROGRAMS = f"{shlex.quote(sys.executable)} {shlex.quote(str(PROJECT / 'examples'))}/"
"""Beginning of a line that runs a program of the project from another folder."""
QUICK_TUNE = """
from locplan.advice import preset_choice, tuning
from locplan.__main__ import main

preset_choice.LEVEL_DRIVES = tuning.LEVEL_DRIVES = 8  # instead of 64
main()
"""
"""A program that is `locplan tune` with fewer drives at each level of disturbance."""
FINISHED: dict[str, tuple[Path, str]] = {}
"""Files and output of blocks that read only a reader's first files, by text."""
PAGE_COLUMNS = "104"
"""Width of the terminal whose output the pages show."""
NUMBER = re.compile(r"\d+(?:\.\d+)?")


def run_in_shell(example: Example) -> None:
    """Run a block as a user's shell would, up to its first failure."""
    text = example.parsed
    if text.startswith(SETS_UP):
        return
    if text in FINISHED:
        files, example.namespace["printed"] = FINISHED[text]
        shutil.copytree(files, Path.cwd(), dirs_exist_ok=True)
        return
    first_files = {file.name for file in Path.cwd().iterdir()}
    lines = [
        " ".join([line, *(more for start, more in QUICK.items() if line.startswith(start))])
        for line in text.splitlines()
    ]
    lines = [re.sub("^python examples/", lambda _: PROGRAMS, line) for line in lines]
    done = subprocess.run(
        ["sh", "-ec", "\n".join(lines)],
        capture_output=True,
        text=True,
        env={**os.environ, "COLUMNS": PAGE_COLUMNS},
    )
    assert done.returncode == 0, f"{example.path}:{example.line}\n{done.stdout}{done.stderr}"
    example.namespace["printed"] = done.stdout
    if first_files == {Path(name).name for name in GIVEN}:
        files = shutil.copytree(
            Path.cwd(),
            Path(tempfile.mkdtemp(dir=Path.cwd().parent)),
            ignore=shutil.ignore_patterns(*first_files),
            dirs_exist_ok=True,
        )
        FINISHED[text] = files, done.stdout


def is_same_word(shown: str, printed: str) -> bool:
    """True if two words are equal, or differ only by numbers of about the same size."""
    if NUMBER.sub("0", shown) != NUMBER.sub("0", printed):
        return False
    numbers = [[float(n) for n in NUMBER.findall(word)] for word in (shown, printed)]
    return all(
        abs(one - two) <= max(0.2 * abs(two), 5.0 if one == int(one) and two == int(two) else 0.02)
        for one, two in zip(*numbers, strict=True)
    )


def find_excerpt(excerpt: list[str], words: list[str], start: int) -> int | None:
    """Return the index after the first place from `start` on at which words hold an excerpt."""
    for first in range(start, len(words) - len(excerpt) + 1):
        if all(map(is_same_word, excerpt, words[first:])):
            return first + len(excerpt)
    return None


def find_wrong_excerpt(shown: str, printed: str) -> str | None:
    """Return the first part of shown output, split at lines of `...`, that was not printed."""
    words, place = printed.split(), 0
    for part in re.split(r"^ *\.\.\. *$", shown, flags=re.MULTILINE):
        if (end := find_excerpt(part.split(), words, place)) is None:
            return part
        place = end
    return None


def compare_with_output(example: Example) -> None:
    """Fail if a block shows output that the command before it did not print."""
    printed = example.namespace.get("printed")
    place = f"{example.path}:{example.line}"
    assert printed is not None, f"{place}: a text block shows the output of the block before it"
    wrong = find_wrong_excerpt(example.parsed, printed)
    assert wrong is None, f"{place}: not printed:\n{wrong}\nbut:\n{printed}"


def run_in_terminal(example: Example) -> None:
    """Serve the page of a block that shows a terminal, after what it installs, and end it."""
    lines = example.parsed.replace("$ ", "").strip().replace("\n", " && ")
    *installed, command = lines.split(" && ")
    assert all(line.startswith("pip install") for line in installed)
    program, *arguments = shlex.split(command)
    assert program == "locplan"
    line = [sys.executable, "-c", TERMINAL_CODE, *arguments, "--no-browser"]
    with subprocess.Popen(line, stdout=subprocess.PIPE, text=True) as page:
        try:
            address = page.stdout.readline().strip()
            with build_opener(HTTPCookieProcessor()).open(address, timeout=TIMEOUT) as answer:
                assert b"<title>" in answer.read()
        finally:
            page.send_signal(signal.SIGINT)
    assert page.returncode == 130


PARSED = Sybil(
    [
        CodeBlockParser("sh", run_in_shell),
        CodeBlockParser("console", run_in_terminal),
        CodeBlockParser("python", PythonEvaluator()),
        CodeBlockParser("text", compare_with_output),
    ]
)


@pytest.fixture
def given_folder(tmp_path, monkeypatch):
    """A reader's folder is the current one, and `locplan` is a command."""
    for name in GIVEN:
        source = PROJECT / name
        copy = shutil.copytree if source.is_dir() else shutil.copy
        copy(source, tmp_path / source.name)
    commands = tmp_path.parent / f"{tmp_path.name}_commands"
    commands.mkdir()
    command = commands / "locplan"
    quick_tune = commands / "tune.py"
    quick_tune.write_text(QUICK_TUNE, "utf-8")
    command.write_text(
        f"""#!/bin/sh
[ "$1" = tune ] && exec "{sys.executable}" "{quick_tune}" "$@"
exec "{sys.executable}" -m locplan "$@"
""",
        "utf-8",
    )
    command.chmod(command.stat().st_mode | stat.S_IXUSR)
    monkeypatch.setenv("PATH", str(commands), prepend=os.pathsep)
    monkeypatch.setenv("PYTHONPATH", str(PROJECT), prepend=os.pathsep)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.long
@pytest.mark.skipif(sys.platform == "win32", reason="the guides are for the shells of Unix")
@pytest.mark.parametrize("page", [*PAGES, PROJECT / "README.md"], ids=lambda page: page.stem)
def test_code_blocks_of_page_run(page, given_folder, monkeypatch):
    """A block may use the names and files of earlier blocks."""
    monkeypatch.setattr("webbrowser.open", lambda address: False)
    document = PARSED.parse(page)
    document.namespace["__name__"] = "__main__"  # functions go to other processes by value
    for example in document.examples():
        example.evaluate()


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_guide_skips_no_code_block(page):
    text = page.read_text("utf-8")
    fences = re.findall(r"^ *```(.*)$", text, re.MULTILINE)
    languages = fences[::2]
    assert set(fences[1::2]) <= {""}
    assert set(languages) <= {*RUN, *SHOWN}
    assert SETS_UP not in text
    found = len(list(PARSED.parse(page).examples()))
    assert found == sum(language in RUN for language in languages)


def test_shown_output_tolerates_close_numbers():
    printed = "a  b 10\nc d\nerror 0.45 [0.34, 0.61]"
    assert find_wrong_excerpt("a b 12\n...\nerror 0.50 [0.34, 0.61]", printed) is None
    assert find_wrong_excerpt("a b 12\n...\nerror 0.60 [0.34, 0.61]", printed) is not None
    assert find_wrong_excerpt("a c", printed) == "a c"
    assert find_wrong_excerpt("c d\n...\na b 10", printed) is not None


def test_index_lists_every_guide():
    index = (GUIDES / "README.md").read_text("utf-8")
    for page in PAGES:
        assert f"]({page.name})" in index, page.name


def without_code(text: str) -> str:
    """Markdown without blocks and spans of code."""
    return re.sub(r"`[^`\n]*`", "", re.sub(r"^ *```.*?^ *```$", "", text, flags=re.M | re.S))


@pytest.mark.parametrize("page", LINKING, ids=lambda page: page.name)
def test_page_defines_lost_at_most_once(page):
    """So that one edit a page follows one of `LOST_DISTANCE`; shown output aside."""
    words = " ".join(without_code(page.read_text("utf-8")).split())
    pattern = r"\boff by (?:more than|over|>) ([\d.]+ m|a metre)\b(?! at the goal)"
    assert re.findall(pattern, words) in ([], [f"{LOST_DISTANCE:g} m"])


def anchors(text: str) -> set[str]:
    """Anchors of the headings of a page, made as GitHub does."""
    count: Counter[str] = Counter()
    found = set()
    bare = re.sub(r"^ *```.*?^ *```$", "", text, flags=re.MULTILINE | re.DOTALL)
    for heading in re.findall(r"^#+ +(.*?)\s*$", bare, re.MULTILINE):
        words = re.sub(r"\]\([^)]*\)", "", heading).lower()
        anchor = re.sub(r"[^\w\- ]", "", words).replace(" ", "-")
        found.add(f"{anchor}-{count[anchor]}" if count[anchor] else anchor)
        count[anchor] += 1
    return found


def test_anchors_equal_github_anchors():
    text = "# Two `words`, and: [a](b.md)\n\n```sh\n# no heading\n```\n## A\n## A\n"
    assert anchors(text) == {"two-words-and-a", "a", "a-1"}


@pytest.mark.parametrize("page", LINKING, ids=lambda page: str(page.relative_to(PROJECT)))
def test_links_between_pages_lead_somewhere(page):
    for link in re.findall(r"\]\(([^)\s]+)\)", without_code(page.read_text("utf-8"))):
        if re.match(r"[a-z]+:", link):
            continue
        place, _, anchor = link.partition("#")
        target = (page.parent / place).resolve() if place else page
        assert target.exists(), f"{page.name}: {link}"
        assert target.is_relative_to(PROJECT), f"{page.name}: {link}"
        if anchor:
            assert anchor in anchors(target.read_text("utf-8")), f"{page.name}: {link}"
