"""The document about many cycles at once: its example runs, and its names exist."""

from __future__ import annotations

import re

import numpy as np
import pytest

from tests.source_files import ROOT
from verifier.batch import BatchResult, BatchVerifier

TEXT = (ROOT / "docs" / "batch.md").read_text(encoding="utf-8")


def test_the_example_runs(capsys: pytest.CaptureFixture[str]) -> None:
    (code,) = re.findall(r"^```python\n(.*?)^```", TEXT, re.MULTILINE | re.DOTALL)
    found: dict[str, object] = {}
    exec(compile(code, "docs/batch.md", "exec"), found)
    result = found["result"]
    assert isinstance(result, BatchResult)
    verified, total = map(int, re.findall(r"\d+", capsys.readouterr().out))
    assert 0 < verified < total == len(result.t)
    assert np.any(result.bounded)


def test_its_names_exist() -> None:
    for name in re.findall(r"^- `(\w+)\(", TEXT, re.MULTILINE):
        assert hasattr(BatchVerifier, name) or name == "verify_batch"
    fields = re.search(r"has, for each of N cycles, (.*)\.", TEXT)
    assert fields is not None
    assert re.findall(r"`(\w+)`", fields.group(1)) == list(BatchResult.__dataclass_fields__)
