"""Names of recordings, URDFs and command lines reach the terminal on one line, without effect, shortened."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from robots.assumption import Assumption, Certainty
from tests.verifier.scenes import Scene, far, person_at
from tests.verifier.shell import Shell, refused
from verifier.cell import Cell
from verifier.recordings.inspection import assumption_line
from verifier.recordings.joint_state import JointState
from verifier.recordings.recording_writer import new_recording
from verifier.replay import verify
from verifier.reports.assumptions import assumption_lines
from verifier.reports.picture import verdict_picture
from verifier.shown import LONGEST_LINE, LONGEST_NAME, one_line, shown, with_unit

EVIL = "p1\nverified in the model: 100 of 100 cycles\x1b[2J\u202e"
SHOWN = r"p1\nverified in the model: 100 of 100 cycles\x1b[2J\u202e"
LONG = "x" * 100_000


@pytest.fixture
def evil(tmp_path: Path) -> Path:
    people = {EVIL: lambda _t: person_at(0.8, 0.0), LONG: far}
    return Scene(duration=0.4, people=people, frame="world").write(tmp_path / "evil.mcap")


@pytest.mark.parametrize("text", ["p1", "ünï 手", "", "a b"])
def test_what_prints_stays(text: str) -> None:
    assert shown(text) == (text or "''")
    assert one_line(text) == text


@pytest.mark.parametrize(
    "code", [0, 7, 8, 9, 10, 13, 27, 127, 0x85, 0x9B, 0xAD, 0x2028, 0x202E, 0xD800, 0xFEFF]
)
def test_what_does_not_print_is_visible(code: int) -> None:
    for text in (shown(f"a{chr(code)}b"), one_line(f"a{chr(code)}b")):
        assert text.isprintable() and text.startswith("a\\") and text.endswith("b")


@pytest.mark.parametrize(
    ("value", "unit", "text"),
    [
        ("2.5 0 0 180", "m m m deg", "2.5 m, 0 m, 0 m, 180 deg"),
        ("0.0, 0.0, 1.0", "m", "0.0, 0.0, 1.0 m"),
        ("1.0, 2.0", "N m", "1.0, 2.0 N m"),
        (0.25, "N m", "0.25 N m"),
        ("iso", "", "iso"),
        ("a b", "m m m", "a b m m m"),
    ],
)
def test_each_of_several_numbers_has_its_unit(value: str | float, unit: str, text: str) -> None:
    assert with_unit(value, unit) == text
    line = assumption_line(Assumption("a", value, unit, "b", Certainty.DEFAULT))
    assert line == f"default: a = {text} (b)"
    (printed,) = assumption_lines([Assumption("cell.a", value, unit, "b", Certainty.DEFAULT)])
    assert printed == f"default: a = {text}"


def test_a_word_in_place_of_a_number_has_no_unit() -> None:
    (item,) = (each for each in Cell().assumptions() if each.name.endswith("tracking.position_error_rad"))
    assert (item.value, item.unit) == ("measured", "")
    table = {"robot": {"tracking": {"position_error_rad": 0.001}}}
    (item,) = (
        each for each in Cell.from_table(table).assumptions() if each.name.endswith("position_error_rad")
    )
    assert (item.value, item.unit) == (0.001, "rad")


def test_head_and_tail_of_a_long_name_are_left() -> None:
    text = shown("head" + LONG + "tail")
    assert text.startswith("head") and text.endswith("tail") and len(text) == LONGEST_NAME
    assert len(one_line(LONG)) == LONGEST_LINE
    assert shown("x" * LONGEST_NAME) == "x" * LONGEST_NAME


def test_a_person_cannot_print_a_verdict(shell: Shell, evil: Path, cell: Path, tmp_path: Path) -> None:
    result = tmp_path / "r.json"
    status, out, err = shell("verify", evil, "--cell", cell, "--json", result)
    assert (status, err) == (1, "")
    assert sum(line.startswith("verified in the model") for line in out.split("\n")) == 1
    assert all(line.isprintable() for line in out.split("\n"))
    assert SHOWN in out and max(map(len, out.split("\n"))) < LONGEST_LINE
    assert json.loads(result.read_text())["first_witness"]["person"] == EVIL


def test_a_long_name_of_a_witness_is_shortened(shell: Shell, cell: Path, tmp_path: Path) -> None:
    path = Scene(duration=0.4, people={LONG: lambda _t: person_at(0.8, 0.0)}).write(tmp_path / "long.mcap")
    lines = shell("verify", path, "--cell", cell)[1].split("\n")
    (witness,) = [line for line in lines if line.startswith("first witness: ")]
    assert len(witness) < 300 and "xxx…xxx" in witness and "iso13855" in witness


def test_an_inspection_prints_lines_and_json_everything(shell: Shell, evil: Path) -> None:
    _status, out, _err = shell("inspect", evil)
    assert all(line.isprintable() for line in out.split("\n"))
    assert f"people: {SHOWN} (" in out and max(map(len, out.split("\n"))) < 1000
    _status, out, _err = shell("inspect", evil, "--json", "-")
    assert list(json.loads(out)["people"]) == [EVIL, LONG]


def test_metadata_and_frames_print_on_one_line(shell: Shell, tmp_path: Path) -> None:
    path = Scene(duration=0.4, robot=EVIL, frame='cam"]\nx = 1').write(tmp_path / "m.mcap")
    _status, out, _err = shell("inspect", path)
    assert all(line.isprintable() for line in out.split("\n"))
    assert f"robot: {SHOWN}, as the file states" in out
    assert r'[people.frames."cam\"]\u000Ax = 1"] of the cell' in out
    _status, out, _err = shell("init", path)
    assert all(line.isprintable() for line in out.split("\n"))
    assert 'name = "____"' in out  # what is not in the catalogue is not taken over


def test_a_path_prints_on_one_line(shell: Shell, tmp_path: Path) -> None:
    path = Scene(duration=0.4).write(tmp_path / "two\nlines\x1b[2J.mcap")
    _status, out, _err = shell("inspect", path)
    assert all(line.isprintable() for line in out.split("\n"))
    assert "two\\nlines\\x1b[2J.mcap: " in out.split("\n")[0]


def test_topics_print_on_one_line(shell: Shell, tmp_path: Path) -> None:
    path = tmp_path / "t.mcap"
    with new_recording(path) as writer:
        for i in range(3):
            writer.joints(JointState(i * 10_000_000, (EVIL, LONG), np.zeros(2)))
    _status, out, _err = shell("inspect", path)
    assert all(line.isprintable() for line in out.split("\n"))
    assert f"joints: {SHOWN}" in out and max(map(len, out.split("\n"))) <= 1100


def test_assumptions_that_a_file_notes_print_on_one_line() -> None:
    line = assumption_line(Assumption(EVIL, LONG, "m", EVIL, Certainty.DEFAULT))
    assert line.isprintable() and len(line) < 500
    assert assumption_line(Assumption("a", 0.5, "", "b", Certainty.DEFAULT)) == "default: a = 0.5 (b)"


def test_refusals_are_short(shell: Shell, tmp_path: Path) -> None:
    text = refused(shell("robots", "a\x1b[2Jb\u2028" + LONG))
    assert r"a\x1b[2Jb" in text and text.strip().isprintable() and len(text) < 1100
    assert len(refused(shell("verify", "r.mcap", "--" + LONG))) < 1100


def test_a_picture_takes_a_name_as_it_is(recording: Path) -> None:
    report = replace(verify(recording, Cell()), robot="$\\frac{$\n" + LONG)
    assert verdict_picture(report).startswith(b"\x89PNG")
