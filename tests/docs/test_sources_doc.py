"""docs/sources.md against the adapters and tables: types, joint sets, numbers, and its JSON is read."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np

from verifier.recordings import limb_test
from verifier.recordings.decoded import Decoded
from verifier.recordings.joint_sets import joint_sets
from verifier.recordings.people_report import COLUMN
from verifier.recordings.people_sources import ADAPTERS, SourceOptions, floor, new_adapters, skeletons, source

DOC = (Path(__file__).resolve().parents[2] / "docs/sources.md").read_text(encoding="utf-8")


def test_every_type_is_in_the_table() -> None:
    table = DOC.split("## ", 1)[0]
    named = set(re.findall(r"`((?:\w+/msg/\w+)|stopproof\.\w+)`", table))
    assert named == set(ADAPTERS)


def test_every_joint_set_is_in_the_table() -> None:
    rows = re.findall(r"^\| `(\w+)` \| (\d+) \| (\w+) \|$", DOC, re.MULTILINE)
    known = joint_sets().values()
    assert rows == [(each.name, str(len(each.joints)), each.certainty.value) for each in known]


def test_the_numbers_are_those_of_the_code() -> None:
    low, high = limb_test.limb_lengths().limits["forearm"]
    for said in (
        f"first {limb_test.BODIES} bodies",
        f"factor of {limb_test.limb_lengths().longest_ratio}",
        f"(a person's: {low} to {high} m)",
        f"error of {source.ROS4HRI_ERROR_M} m",
        f"below {skeletons.VISIBLE} it is inferred",
        f"{0.5 * floor.HIGHEST_PELVIS_M} m above the floor",
        f"from 0 to {floor.HIGHEST_PELVIS_M} m",
    ):
        assert said in DOC, said


def test_the_json_is_read() -> None:
    (text,) = re.findall(r"```json\n(.*?)```", DOC, re.DOTALL)
    reader = new_adapters(SourceOptions())["stopproof.Skeletons"]
    (report,) = reader.read(Decoded("/skeletons", "stopproof.Skeletons", 12_300_000_000, json.loads(text)))
    assert not report.flaws
    (person,) = report.people
    assert np.isnan(person.xyz[COLUMN["r_wrist"]]).all()
    assert np.isfinite(person.xyz[COLUMN["l_wrist"]]).all() and not person.measured >> COLUMN["l_wrist"] & 1
    assert person.measured >> COLUMN["head"] & 1
    reader.finish()
