"""docs/README.md against the documents and schemas that are there."""

from __future__ import annotations

import re

from tests.docs.test_schemas import ROOT

DOCS = ROOT / "docs"


def test_every_document_and_schema_is_listed_once() -> None:
    rows = re.findall(
        r"^\| \[([^]]+)\]\(([^)]+)\)", (DOCS / "README.md").read_text(encoding="utf-8"), re.MULTILINE
    )
    listed = [target for _, target in rows]
    there = [
        each.name
        for kind in ("*.md", "*.schema.json")
        for each in DOCS.glob(kind)
        if each.name != "README.md"
    ]
    assert sorted(name for name in listed if "/" not in name) == sorted(there)
    assert all(name == target and (DOCS / target).is_file() for name, target in rows)
    assert len(set(listed)) == len(listed)
