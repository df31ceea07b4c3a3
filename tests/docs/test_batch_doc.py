"""The document about many cycles at once: its example runs, and its names exist."""

from __future__ import annotations

import re

import numpy as np
import pytest

from tests.source_files import ROOT
from verifier.batch import BatchResult, BatchVerifier

TEXT = (ROOT / "docs" / "batch.md").read_text(encoding="utf-8")


@pytest.mark.rarely("tests/verifier/test_batch.py, and the names of the text in every run")
def test_the_example_runs(capsys: pytest.CaptureFixture[str]) -> None:
    (code,) = re.findall(r"^```python\n(.*?)^```", TEXT, re.MULTILINE | re.DOTALL)
    printed = []
    # one process first: two that start cold would compile the same at the same time
    assert "jobs=2" in code
    for jobs in ("jobs=1", "jobs=2"):
        found: dict[str, object] = {}
        exec(compile(code.replace("jobs=2", jobs), "docs/batch.md", "exec"), found)
        result = found["result"]
        assert isinstance(result, BatchResult)
        printed.append(capsys.readouterr().out)
        verified, total = map(int, re.findall(r"\d+", printed[-1]))
        assert 0 < verified < total == len(result.t)
        assert np.any(result.bounded)
    assert printed[0] == printed[1]


def test_its_names_exist() -> None:
    for name in re.findall(r"^- `(\w+)\(", TEXT, re.MULTILINE):
        assert hasattr(BatchVerifier, name) or name == "verify_batch"
    fields = re.search(r"has, for each of N cycles, (.*)\.", TEXT)
    assert fields is not None
    assert re.findall(r"`(\w+)`", fields.group(1)) == list(BatchResult.__dataclass_fields__)
