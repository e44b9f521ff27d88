"""Measured numbers on README.md, the guides and the JOSS paper equal those of the evidence.

A number on a page is followed by a comment with the key of its row in the table of claims, such as
`0.90<!-- evidence: lasers.fused.pooled -->`. It may be a value with or without its interval, a
range `0.1 to 0.2` of the row's interval, or a count `3 of 8` of the row's value and n.
"""

from __future__ import annotations

import csv
import re
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
CLAIMS = ROOT / "examples" / "evidence" / "claims.csv"
GUIDES = ROOT / "examples" / "guides"
PAPER = ROOT / "examples" / "joss" / "paper.md"
PAGES = [ROOT / "README.md", PAPER, *sorted(set(GUIDES.glob("*.md")) - {GUIDES / "evidence.md"})]
NUMBER = r"-?\d[\d,]*(?:\.\d+)?"
INTERVAL = rf"\[{NUMBER}(?: ?%)?, {NUMBER}(?: ?%)?\]"
CLAIM = re.compile(
    rf"(?P<value>{NUMBER})(?: (?P<link>of|to)(?: all)? (?P<second>{NUMBER}))?"
    rf"(?P<unit> ?%| [a-z]+)?(?: (?P<interval>{INTERVAL}))?\s*<!-- evidence: (?P<key>[\w.-]+) -->"
)
"""A number with the key of its claim."""
RESULT = re.compile(rf"{NUMBER}(?: to {NUMBER})? ?%(?: {INTERVAL})?|{INTERVAL}")
"""A share or an interval, which only a measurement gives."""


@cache
def read_claims() -> dict[str, dict[str, str]]:
    """Return the rows of the table of claims by key."""
    with CLAIMS.open(encoding="utf-8", newline="") as file:
        return {row["key"]: row for row in csv.DictReader(file)}


def to_number(text: str) -> float:
    """Return the number that a text shows."""
    return float(text.replace(",", ""))


def shows(text: str, value: str, factor: float) -> bool:
    """True if a text shows a value of the table, rounded to the text's decimals."""
    decimals = len(text.partition(".")[2])
    tolerance = 0.5 * 10.0**-decimals + 1e-9
    return value != "" and abs(to_number(text) - factor * float(value)) <= tolerance


def is_shown_right(claim: re.Match[str], row: dict[str, str]) -> bool:
    """True if a number on a page is that of its row."""
    is_share = (claim["unit"] or "").strip() == "%" and row["unit"] != "%"
    factor = 100.0 if is_share else 1.0
    if claim["link"] == "to":
        numbers = [(claim["value"], row["low"]), (claim["second"], row["high"])]
    elif claim["link"] == "of":
        is_count = row["unit"] == f"of {row['n']}"
        numbers = [(claim["value"], row["value"] if is_count else ""), (claim["second"], row["n"])]
    else:
        numbers = [(claim["value"], row["value"])]
    if claim["interval"]:
        bounds = re.findall(NUMBER, claim["interval"])
        numbers += zip(bounds, (row["low"], row["high"]), strict=True)
    return all(shows(text, value, factor) for text, value in numbers)


def find_wrong_claims(text: str, rows: dict[str, dict[str, str]]) -> list[str]:
    """Return the numbers of a page that differ from their rows, or name none."""
    claims = list(CLAIM.finditer(text))
    wrong = [c[0] for c in claims if c["key"] not in rows or not is_shown_right(c, rows[c["key"]])]
    if len(claims) != text.count("<!-- evidence:"):
        wrong.append(f"{text.count('<!-- evidence:')} comments, {len(claims)} numbers before one")
    return wrong


def find_untagged_results(text: str) -> list[str]:
    """Return the shares and intervals in a page's prose that neither claim nor output shows."""
    output = " ".join(" ".join(re.findall(r"^```text$(.*?)^```$", text, re.M | re.S)).split())
    prose = re.sub(r"^ *```.*?^ *```$", "", text, flags=re.M | re.S)
    prose = " ".join(CLAIM.sub("", re.sub(r"`[^`\n]*`|\]\([^)]*\)(\{[^}]*\})?", "", prose)).split())
    prose = re.sub(r"\b95 %( confidence)? intervals?\b", "", prose)
    return [m[0] for m in RESULT.finditer(prose) if m[0] not in output]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_page_shows_numbers_of_evidence(page):
    text = page.read_text("utf-8")
    assert find_wrong_claims(text, read_claims()) == []
    assert find_untagged_results(text) == []


def test_paper_tags_every_number():
    text = PAPER.read_text("utf-8").split("---\n", 2)[2]
    rest = re.sub(r"\[@\w+\]|\(\w+\.png\)\{.*?\}|95 %\s+intervals", "", CLAIM.sub("", text))
    rest = re.sub(r"\b2D|\bNav2|\bROS 1|\bLF-3PM|\bFigure \d", "", rest)
    assert re.findall(r"\S*\d\S*", rest) == []


def test_readme_tags_every_measured_number():
    text = (ROOT / "README.md").read_text("utf-8")
    evidence = re.search(r"^## Does it work\?$(.*?)^## ", text, re.M | re.S)
    assert evidence
    rest = re.sub(r"\*\*.*?\*\*|\]\([^)]*\)|2D|Nav2", "", CLAIM.sub("", evidence[1]))
    assert re.findall(r"\d\S*", rest) == []


ROWS = {
    "rank": {"value": "0.901", "low": "0.875", "high": "0.921", "unit": "", "n": "1222"},
    "arrived": {"value": "1", "low": "0.2", "high": "4", "unit": "of 8", "n": "8"},
}


@pytest.mark.parametrize(
    ("text", "wrong"),
    [
        ("0.90<!-- evidence: rank -->", False),
        ("0.9 [0.88, 0.92]<!-- evidence: rank -->", False),
        ("0.88 to 0.92<!-- evidence: rank -->", False),
        ("90 % [88, 92]<!-- evidence: rank -->", False),
        ("1 of 8 robots<!-- evidence: arrived -->", False),
        ("0.91<!-- evidence: rank -->", True),
        ("0.90 [0.80, 0.92]<!-- evidence: rank -->", True),
        ("2 of 8 robots<!-- evidence: arrived -->", True),
        ("0.90<!-- evidence: unknown -->", True),
        ("a number<!-- evidence: rank -->", True),
    ],
)
def test_wrong_number_is_found(text, wrong):
    assert bool(find_wrong_claims(text, ROWS)) is wrong


def test_untagged_share_is_found():
    assert find_untagged_results("Errors fall by 20 % [10, 30].") == ["20 % [10, 30]"]
    assert find_untagged_results("```text\nlost 20 %\n```\nIt is 20 %, by a 95 % interval.") == []
    assert find_untagged_results("90 % [88, 92]<!-- evidence: rank --> of them") == []
