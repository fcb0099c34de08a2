"""The paper about the software: its references are in its bibliography, and nothing else is."""

from __future__ import annotations

import re
from pathlib import Path

import yaml

PAPER = Path(__file__).parents[2] / "docs" / "paper"
TEXT = (PAPER / "paper.md").read_text(encoding="utf-8")
HEAD, BODY = TEXT.split("---\n", 2)[1:]
ENTRIES = {
    key: dict(re.findall(r"^\s*(\w+)\s*=\s*\{(.*)\},?$", fields, re.MULTILINE))
    for key, fields in re.findall(
        r"^@\w+\{(\w+),\n(.*?)^\}", (PAPER / "paper.bib").read_text(), re.MULTILINE | re.DOTALL
    )
}


def test_each_reference_is_in_the_bibliography_and_none_is_unused() -> None:
    cited = set(re.findall(r"@(\w+)", "".join(re.findall(r"\[(@[^\]]+)\]", BODY))))
    assert cited == set(ENTRIES) and len(cited) > 8


def test_each_entry_can_be_found() -> None:
    for key, fields in ENTRIES.items():
        assert fields["title"] and fields["author"], key
        assert re.fullmatch(r"10\.\d{4,9}/\S+", fields.get("doi", "")) or fields.get("url", "").startswith(
            "https://"
        ), key
    citation = yaml.safe_load((PAPER.parents[1] / "CITATION.cff").read_text())
    assert ENTRIES["li2013image"]["doi"] == citation["references"][0]["doi"]


def test_the_head_has_what_the_journal_asks_for() -> None:
    head = yaml.safe_load(HEAD)
    citation = yaml.safe_load((PAPER.parents[1] / "CITATION.cff").read_text())
    assert head["title"] == citation["title"] and head["bibliography"] == "paper.bib" and head["tags"] and head["date"]
    assert [author["name"] for author in head["authors"]] == [author["name"] for author in citation["authors"]]
    heads = re.findall(r"^# (.*)$", BODY, re.MULTILINE)
    assert {"Summary", "Statement of need", "State of the field", "References"} <= set(heads)
    assert 250 <= len(BODY.split()) <= 1000


def test_it_is_no_page_of_the_site() -> None:
    assert (
        '"paper"'
        in (PAPER.parent / "conf.py").read_text(encoding="utf-8").partition("exclude_patterns")[2].partition("]")[0]
    )
