"""docs/conformance.md and its schema against what the command does."""

import re
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest

from occupancy.body import POINT_NAMES, load_profile
from tests.docs.test_schemas import ROOT, faults, run, schema
from tests.occupancy.people import standing
from verifier.conformance import open_recordings
from verifier.outline import SIDES
from verifier.reports.sets_panel import panel_of
from verifier.snapshot import choose_moment, take_snapshot

DOC = (ROOT / "docs/conformance.md").read_text(encoding="utf-8")


def people_file(folder: Path, samples: int = 60, name: str = "clip.npz") -> Path:
    t = 0.01 * np.arange(samples)
    xyz = np.repeat(standing()[None], samples, axis=0)
    xyz[:, :, 0] += 0.2 * np.sin(12.0 * t)[:, None]
    xyz[samples // 2, 0, 0] += 0.3
    np.savez(folder / name, t=t, joints=np.array(POINT_NAMES), xyz=xyz)
    return folder / name


@pytest.fixture(scope="module", params=[1, 30])
def printed(request, tmp_path_factory) -> list[dict[str, Any]]:
    """What the command prints about so many samples."""
    status, found = run("conformance", people_file(tmp_path_factory.mktemp("clip"), request.param))
    assert status == 0
    return found


def test_the_command_prints_what_the_schema_says(printed):
    assert not faults("conformance", printed)
    for each in printed:
        assert (
            each["outside"] == round(each["frames"] * (1.0 - (each["inside"] or 0.0))) or not each["frames"]
        )
    assert {each["horizon_s"] for each in printed} == {0.02, 0.05, 0.1, 0.2, 0.5}
    assert any(each["apart"] for each in printed) == (printed[0]["frames"] > 1)


def test_the_schema_is_closed_and_described(printed):
    jsonschema.Draft202012Validator.check_schema(schema("conformance"))
    items = schema("conformance")["items"]
    assert items["additionalProperties"] is False
    assert items["required"] == list(items["properties"])
    for key, entry in items["properties"].items():
        unit = {"_m": "m", "_s": "s", "m3": "m³"}.get(key[-2:])
        assert unit is None or entry["description"].startswith(f"{unit}, "), key
    for key in printed[0]:
        assert faults("conformance", [{name: value for name, value in printed[0].items() if name != key}])
    assert faults("conformance", [{**printed[0], "grade": 1}])


def table() -> list[tuple[str, str, list[float], float]]:
    """Profile, model, shares in percent and worst excess [m] of every line of the document's table."""
    row = re.compile(r"^ {2}(\w+) +(\w+) +((?:[\d.]+ % +){5}).*? ([+-][\d.]+) m ", re.MULTILINE)
    return [
        (profile, model, [float(share) for share in re.findall(r"[\d.]+", shares)], float(excess))
        for profile, model, shares, excess in row.findall(DOC)
    ]


def test_the_table_shows_what_the_text_says():
    lines = table()
    assert {profile for profile, *_ in lines} == {"extreme", "iso", "tum"}
    for profile, model, shares, excess in lines:
        if profile == "extreme":
            assert shares == [100.0] * 5 and excess < 0.0, model
        if (profile, model) == ("iso", "iso13855"):
            assert min(shares) < 90.0 and excess > 0.1


def test_the_table_has_the_rows_of_the_command(printed):
    rows = [line[:2] for line in table()]
    assert sorted(rows) == sorted({(each["profile"], each["model"]) for each in printed})


@pytest.mark.real_data
def test_the_table_is_what_the_command_prints(real_data, some):
    """Every number of some profiles, of all at full counts: a row that is of an older tree shows."""
    (command,) = re.findall(r"^stopproof (conformance .* --picture .*)$", DOC, re.MULTILINE)
    names = [word.rpartition("/")[2] for word in command.split() if word.endswith(".npz")]
    profiles = some(sorted({profile for profile, *_ in table()}))
    options = (word for profile in profiles for word in ("--profile", profile))
    _, printed = run("conformance", *(real_data / "human" / name for name in names), *options)
    lines = [line for line in table() if line[0] in profiles]
    assert {line[:2] for line in lines} == {(each["profile"], each["model"]) for each in printed}
    for profile, model, shares, excess in lines:
        own = [each for each in printed if (each["profile"], each["model"]) == (profile, model)]
        assert max(each["worst_excess_m"] for each in own) == pytest.approx(excess, abs=0.0006)
        for horizon, share in zip((0.02, 0.05, 0.1, 0.2, 0.5), shares, strict=True):
            here = [each for each in own if each["horizon_s"] == horizon]
            frames = sum(each["frames"] for each in here)
            inside = 100.0 * (1.0 - sum(each["outside"] for each in here) / frames)
            assert share - 1e-9 <= inside < share + 0.01 + 1e-9, "shares are rounded down"


@pytest.mark.real_data
def test_the_text_about_one_frame_is_what_its_picture_says(real_data):
    (command,) = re.findall(r"^stopproof conformance (.* --sets .*)$", DOC, re.MULTILINE)
    recording, option, profile, _, picture = command.split()
    assert option == "--profile"
    (file,) = open_recordings([str(real_data / recording.removeprefix("$DATA/"))], [], None)
    shot = take_snapshot(file, load_profile(profile), (), choose_moment(file, None, None))
    texts = {
        line
        for h in (0, 1)
        for each in shot.predicted[h]
        for line in panel_of(shot, h, each).finding.split("\n")
    }
    quoted = re.findall(r"`((?:\+|inside, )[^`]*)`", DOC)
    assert len(quoted) == 5 and set(quoted) <= texts
    assert 100.0 * (1.0 / np.cos(np.pi / SIDES) - 1.0) < 0.016
    assert 0 < (ROOT / picture).stat().st_size < 400_000
    assert f"]({picture.removeprefix('docs/')})" in DOC
