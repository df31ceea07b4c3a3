"""Potentials by PyTorch against those of the compiled loops."""

from __future__ import annotations

from collections.abc import Callable
from importlib.util import find_spec

import numpy as np
import pytest

from modes.planning import torch_field
from modes.planning.potential_field import Field, FieldSettings
from robots.errors import SetupError
from robots.model import RobotModel
from tests.modes.planning.test_potential_field import configurations, somebody

BODIES = somebody(np.array([0.6, 0.1, 0.6]), 3)


@pytest.mark.parametrize("variant", ["surface", "as_printed"])
@pytest.mark.parametrize("name", ["ur16e", "panda"])
def test_both_find_the_same(
    name: str,
    variant: str,
    arm: Callable[[str], RobotModel],
    rng: np.random.Generator,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    pytest.importorskip("torch")
    monkeypatch.setattr(torch_field, "_AT_ONCE", 50_000)  # several rounds
    field = Field(arm(name), FieldSettings(variant=variant, decay=0.7))  # type: ignore[arg-type]  # variants are plain texts here
    q = configurations(field.robot, rng, 100)
    found = torch_field.potentials(field, q, BODIES, "cpu")
    assert found.max() > 1.0
    np.testing.assert_allclose(found, field.potentials(q, BODIES), rtol=1e-9, atol=1e-9)
    assert torch_field.potentials(field, q[:0], BODIES, "cpu").shape == (0,)


def test_what_is_missing_is_said(arm: Callable[[str], RobotModel]) -> None:
    field = Field(arm("ur16e"))
    if find_spec("torch") is None:
        with pytest.raises(SetupError, match=r"pip install 'stopproof\[train\]'"):
            torch_field.potentials(field, np.zeros((1, 6)), BODIES, "cpu")
        return
    with pytest.raises(SetupError, match=r"shape \(1, 7\) do not fit ur16e"):
        torch_field.potentials(field, np.zeros((1, 7)), BODIES, "cpu")
    if not pytest.importorskip("torch").cuda.is_available():
        with pytest.raises(SetupError, match="torch has no CUDA here"):
            torch_field.potentials(field, np.zeros((1, 6)), BODIES, "cuda")
