"""The text of a cell file, and options beside it."""

from __future__ import annotations

from pathlib import Path

import pytest

from verifier.cell import Cell
from verifier.cell_reading import CellError
from verifier.cell_template import template


def read(folder: Path, text: str) -> Cell:
    path = folder / "cell.toml"
    path.write_text(text, encoding="utf-8")
    return Cell.from_toml(path)


def test_a_byte_order_mark_is_no_mistake(tmp_path: Path) -> None:
    assert read(tmp_path, "\ufeffcycle_s = 0.02\n").cycle_s == 0.02


@pytest.mark.parametrize("value", ["my____tool.toml", "____/tool.toml", "tool.____", "a ____ b", "_____"])
def test_a_blank_within_a_name_is_none(tmp_path: Path, value: str) -> None:
    tool = read(tmp_path, f"[robot]\ntool = '{value}'  # ____\n").robot.tool
    assert tool == str(tmp_path / value)


@pytest.mark.parametrize(
    "line",
    [
        "tool = '____'",
        'tool="____"  # a tool',
        "max_sample_gap_s = ____",
        "joints = [____]",
        "joints = ['a', '____', 'b']",
        "joints = [\n ____,\n]",
    ],
)
def test_a_blank_in_place_of_a_value_is_refused_with_its_line(tmp_path: Path, line: str) -> None:
    with pytest.raises(CellError, match=r"fill in every ____: line [23]: "):
        read(tmp_path, f"[robot]\n{line}\n")


@pytest.mark.parametrize("value", ["{x = 1}", "true", "'x'", "[1]"])
def test_a_key_that_takes_two_types_is_named_once(tmp_path: Path, value: str) -> None:
    with pytest.raises(CellError) as caught:
        read(tmp_path, f"[robot.tracking]\nposition_error_rad = {value}\n")
    text = str(caught.value)
    assert text.endswith(': must be a number or "measured"')
    assert "robot.tracking.position_error_rad" in text
    assert "constrained" not in text and "literal" not in text and "more" not in text


def test_other_keys_that_break_a_rule_are_counted_once(tmp_path: Path) -> None:
    with pytest.raises(CellError, match=r"cycle_s = -1\.0: .* \(and 1 more\)$"):
        read(tmp_path, "cycle_s = -1\n[robot.tracking]\nposition_error_rad = 'x'\n")


def test_a_misspelt_key_is_named_before_the_one_that_is_missing_for_it(tmp_path: Path) -> None:
    text = "[robot.silence]\nhold = 0.02\ndeceleration_rad_s2 = 5.0\n"
    with pytest.raises(CellError, match=r"robot\.silence\.hold = 0\.02: unknown key; .* \(and 1 more\)$"):
        read(tmp_path, text)


@pytest.mark.parametrize(("key", "option"), [("urdf", "robot"), ("tool", "tool")])
def test_one_file_named_in_two_ways_agrees(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, key: str, option: str
) -> None:
    (tmp_path / "arm.urdf").write_text("<robot/>")
    (tmp_path / "other.urdf").write_text("<robot/>")
    (tmp_path / "link.urdf").symlink_to("arm.urdf")
    cell = read(tmp_path, f"[robot]\n{key} = 'arm.urdf'\n")
    monkeypatch.chdir(tmp_path)
    for same in ("./arm.urdf", f"../{tmp_path.name}/arm.urdf", f"{tmp_path}/arm.urdf", "./link.urdf"):
        chosen = cell.with_options(**{option: same})
        assert getattr(chosen.robot, key) == str(tmp_path / "arm.urdf")
    with pytest.raises(CellError, match=r"--\w+ \./other\.urdf: the cell says .*; they must agree"):
        cell.with_options(**{option: "./other.urdf"})


def test_a_name_of_the_catalogue_is_no_path(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "ur5").write_text("<robot/>")
    cell = read(tmp_path, "[robot]\nname = 'ur5'\n")
    monkeypatch.chdir(tmp_path)
    with pytest.raises(CellError, match="they must agree"):
        cell.with_options(robot="./ur5")


@pytest.mark.parametrize(
    "name",
    ['x"\nbare_flange = true\ny = "', "a\\", "tab\tand \x1b[2J", "\u2028", "\U0001f600", "\x7f", "ünï", "'"],
)
def test_names_of_a_recording_add_no_keys_to_a_template(tmp_path: Path, name: str) -> None:
    text = template(name, [name])
    assert text.count("\n") == template("ur5", ["camera"]).count("\n")
    assert all(line.isprintable() for line in text.split("\n"))
    filled = text.replace('tool = "____"', "").replace("____", "0.0")
    cell = read(tmp_path, filled)
    assert cell.robot.name == name
    assert list(cell.people.frames) == [name]
    assert not cell.robot.bare_flange


def test_half_a_character_does_not_break_the_template(tmp_path: Path) -> None:
    (tmp_path / "cell.toml").write_bytes(template("\ud800", ["\udfff"]).encode())
    with pytest.raises(CellError, match="fill in"):
        Cell.from_toml(tmp_path / "cell.toml")
