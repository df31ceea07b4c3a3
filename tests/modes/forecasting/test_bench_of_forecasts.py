"""The bench prints its tables for any folder of people; how long anything takes is no matter of a test."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from modes.forecasting.network import FORECASTERS
from modes.forecasting.skeleton import Joint
from modes.forecasting.synthetic import person
from tests.source_files import ROOT

NAMES = {
    "l_shoulder": Joint.LSHO, "r_shoulder": Joint.RSHO, "l_elbow": Joint.LAEL, "r_elbow": Joint.RAEL,
    "l_wrist": Joint.LWPS, "r_wrist": Joint.RWPS, "l_hip": Joint.LHIP, "r_hip": Joint.RHIP,
    "l_knee": Joint.LKNE, "r_knee": Joint.RKNE, "l_ankle": Joint.LHEE, "r_ankle": Joint.RHEE,
}  # fmt: skip


def test_the_bench_counts_the_people_it_is_given(tmp_path: Path) -> None:
    pytest.importorskip("onnxruntime", reason="networks need onnxruntime: the extra forecast")
    joints = person(4.0, 30.0, 0)
    middle = [joints[:, [a, b]].mean(axis=1) for a, b in ((Joint.LHIP, Joint.RHIP), (Joint.CLAV, Joint.C7))]
    xyz = np.stack([*middle, *(joints[:, joint] for joint in NAMES.values())], axis=1)
    names = np.array(["pelvis", "neck_base", *NAMES])
    np.savez(tmp_path / "made_up_0.npz", t=np.arange(len(joints)) / 30.0, joints=names, xyz=xyz)
    command = [sys.executable, "-m", "bench.forecasting", "--recordings", str(tmp_path), "--repeats", "2"]
    done = subprocess.run([*command, "--json", "-"], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert found["windows"] == {"made_up": 20, "all": 20}
    assert set(found["forecasts"]["all"]) == set(FORECASTERS)
    held, gone = (found["forecasts"]["all"]["hold"][each]["mean"] for each in ("0.1", "1"))
    assert 0.0 < held < gone
    assert found["filling"]["made_up"]["carry"]["inside"]["mean"] > 0.0
    refused = subprocess.run(
        [*command[:4], str(tmp_path / "none")], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert refused.returncode == 1 and "0 recordings of people" in refused.stderr
