"""The JOSS paper is short, cites its bibliography, shows its figures, and marks its gaps."""

from __future__ import annotations

import importlib.util
import re
from pathlib import Path
from types import SimpleNamespace

import yaml

import locplan

FOLDER = Path(__file__).resolve().parents[2] / "examples" / "joss"
PAPER = FOLDER / "paper.md"
MAX_WORDS = 1000
SECTIONS = [
    "Summary",
    "Statement of need",
    "State of the field",
    "Software design",
    "Research impact statement",
    "AI usage disclosure",
    "Acknowledgements",
    "References",
]
"""Sections that JOSS requires, in its order."""
OWNER_FIELDS = ("name", "orcid", "date")
"""Fields of the header that only the owner knows."""
OWNER_SECTIONS = ("Research impact statement", "AI usage disclosure", "Acknowledgements")
"""Sections with a line that only the owner can write."""


def read_paper() -> tuple[str, str]:
    """Return the header and the text of the paper."""
    _, header, text = PAPER.read_text("utf-8").split("---\n", 2)
    return header, text


def split_sections(text: str) -> dict[str, str]:
    """Return the text of each section by its title."""
    titles = re.split(r"^# (.+)$", text, flags=re.M)[1:]
    return dict(zip(titles[::2], titles[1::2], strict=True))


def count_words(text: str) -> int:
    """Return the number of words and numbers in prose and captions."""
    without = r"<!--.*?-->|\[@[^\]]+\]|^#.*$|\]\([^)]*\)(\{[^}]*\})?"
    prose = re.sub(without, " ", text, flags=re.M)
    return len(re.findall(r"[^\W_]\S*", prose))


def find_marks(text: str) -> list[str]:
    """Return the lines of a text that have a mark for the owner."""
    return [line for line in text.splitlines() if "OWNER" in line]


def test_paper_has_sections_of_joss():
    assert list(split_sections(read_paper()[1])) == SECTIONS


def test_paper_has_at_most_thousand_words():
    assert 750 <= count_words(read_paper()[1]) <= MAX_WORDS


def test_header_has_fields_of_joss():
    header = yaml.safe_load(read_paper()[0])
    assert set(header) == {"title", "tags", "authors", "affiliations", "date", "bibliography"}
    assert (FOLDER / header["bibliography"]).is_file()
    indices = {affiliation["index"] for affiliation in header["affiliations"]}
    assert {author["affiliation"] for author in header["authors"]} <= indices


def test_citations_equal_bibliography():
    entries = re.findall(r"^@\w+\{(\w+),$", (FOLDER / "paper.bib").read_text("utf-8"), re.M)
    assert sorted(set(entries)) == sorted(entries)
    assert set(re.findall(r"@(\w+)", read_paper()[1])) == set(entries)


def test_owner_marks_stand_in_allowed_places():
    """Only the owner knows authors, date and users, and writes disclosure and funding."""
    header, text = read_paper()
    pattern = rf"[ -]*({'|'.join(OWNER_FIELDS)}): 'OWNER: "
    assert [mark for mark in find_marks(header) if not re.match(pattern, mark)] == []
    for title, section in split_sections(text).items():
        marks = find_marks(section)
        assert len(marks) <= (title in OWNER_SECTIONS), marks
        assert all(mark.startswith("OWNER: ") for mark in marks)
    marks = find_marks((FOLDER / "paper.bib").read_text("utf-8"))
    assert [mark for mark in marks if not re.match(" *author += ", mark)] == []


def test_program_writes_figures_of_paper(tmp_path, monkeypatch):
    spec = importlib.util.spec_from_file_location("joss_figures", FOLDER / "figures.py")
    program = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(program)
    paths = [locplan.Path([program.START, (18.0, y), program.GOAL]) for y in (15.5, 9.6)]
    choice = SimpleNamespace(shortest=SimpleNamespace(path=paths[0]), path=paths[1])
    monkeypatch.setattr(locplan, "recommend_path", lambda *_: choice)
    program.main(str(tmp_path), 0.8)
    shown = set(re.findall(r"^!\[[^\]]*\]\(([^)]+)\)", read_paper()[1], re.M))
    assert {path.name for path in tmp_path.iterdir()} == shown
    assert all((FOLDER / name).is_file() for name in shown)


def test_words_leave_out_comments_and_citations():
    caption = 'A caption](a.png){width="9%"}'
    text = f"# Title\n\nTwo words<!-- evidence: a.b --> [@key]. ![{caption} 0.9 [0.8, 1]"
    assert count_words(text) == 7
