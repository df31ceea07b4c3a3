"""Models and profiles side by side."""

from __future__ import annotations

import json
import re
from pathlib import Path

import jsonschema
import numpy as np
import pytest

from occupancy.body import load_profile, profile_names
from occupancy.humans.catalog import MODEL_NAMES, build_models
from occupancy.humans.options import ModelError
from robots.errors import SetupError
from tests.source_files import ROOT
from tests.verifier.scenes import CELL, Scene, far, person_at
from tests.verifier.shell import Shell, refused
from verifier import Cell, Status, verify
from verifier.comparison import Compared, beliefs, compare, table, waived_lines
from verifier.setup import build_robot


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Somebody walks up at 1.3 m/s."""
    scene = Scene(people={"p1": lambda t: person_at(3.2 - 1.3 * t, 0.0)})
    return scene.write(tmp_path_factory.mktemp("comparison") / "r.mcap")


@pytest.fixture(scope="module")
def rows(recording: Path) -> list[Compared]:
    return compare(recording, Cell.from_table(CELL))


def test_every_model_of_every_profile_stands_there_once(rows: list[Compared]) -> None:
    found = [(row.profile, row.models) for row in rows]
    assert len(set(found)) == len(found)
    for profile in profile_names():
        for model in MODEL_NAMES:
            assert ((profile, (model,)) in found) == (model in load_profile(profile).models)
        known = tuple(name for name in MODEL_NAMES if name in load_profile(profile).models)
        assert (profile, known) in found
    assert found[0] == ("iso", ("iso13855",))


def test_one_profile_has_one_approach_speed() -> None:
    people = {**CELL["people"], "approach_speed_m_s": 1.6}
    cells = list(beliefs(Cell.from_table({**CELL, "people": people})))
    assert {each.people.approach_speed_m_s for each in cells if each.people.profile == "iso"} == {1.6}
    assert {each.people.approach_speed_m_s for each in cells if each.people.profile != "iso"} == {2.0}


def test_rows_are_those_of_runs_of_their_own(recording: Path, rows: list[Compared]) -> None:
    for row in rows[:: max(1, len(rows) // 4)]:
        people = {**CELL["people"], "profile": row.profile, "models": row.models}
        report = verify(recording, Cell.from_table({**CELL, "people": people}))
        counts = (row.verified, row.not_verified, row.contradicted, row.not_checked)
        wanted = (Status.VERIFIED, Status.NOT_VERIFIED, Status.CONTRADICTED, Status.NOT_CHECKED)
        assert counts == tuple(report.count(status) for status in wanted)
        assert row.time_lost_s == pytest.approx(0.01 * (counts[1] + counts[2]))
        assert row.exit_status == report.exit_status


def test_more_models_never_verify_less(rows: list[Compared]) -> None:
    for profile in profile_names():
        own = [row for row in rows if row.profile == profile and row.contradicted == 0]
        together = max(own, key=lambda row: len(row.models))
        assert all(row.verified <= together.verified for row in own)


def test_a_faster_profile_costs_time_and_says_what_it_rests_on(rows: list[Compared]) -> None:
    iso = next(row for row in rows if row.profile == "iso" and row.models == ("iso13855",))
    extreme = next(row for row in rows if row.profile == "extreme" and row.models == ("iso13855",))
    assert extreme.time_lost_s > iso.time_lost_s > 0.0
    assert "m/s (assumed)" in extreme.weakest and "m/s (sourced)" in iso.weakest
    gentle = next(row for row in rows if row.models == ("articulated_acceleration",))
    assert "acceleration" in gentle.weakest or "speed" in gentle.weakest


def test_what_the_recording_contradicts_is_the_weakest(tmp_path: Path) -> None:
    jump = Scene(duration=1.0, people={"p1": lambda t: person_at(4.0 if t < 0.5 else 2.5, 0.0)})
    (row, *_) = compare(jump.write(tmp_path / "r.mcap"), Cell.from_table(CELL))
    assert row.contradicted > 0 and row.weakest == "A1 people: contradicted by this recording"
    assert row.exit_status == 1


def test_the_table_has_a_line_for_each_row(rows: list[Compared]) -> None:
    lines = table(rows)
    assert len(lines) == len(rows) + 1
    assert lines[0].split("  ")[0].strip() == "profile"
    for row, line in zip(rows, lines[1:], strict=True):
        assert line.startswith(row.profile) and f"{row.time_lost_s:.2f} s" in line


def test_the_cycles_of_a_row_add_up_in_the_table(recording: Path, rows: list[Compared]) -> None:
    cycles = verify(recording, Cell.from_table(CELL)).cycles
    heads, *lines = (re.split(r"  +", line) for line in table(rows))
    counts = [heads.index(name) for name in ("verified", "not verified", "contradicted", "not checked")]
    assert {sum(int(line[i]) for i in counts) for line in lines} == {cycles}
    assert any(int(line[counts[3]]) for line in lines)


# ----------------------------------------------------------------------------------- choosing in the cell


@pytest.mark.parametrize(
    ("people", "told"),
    [
        ({"models": ["guess"]}, "guess; known: iso13855"),
        ({"models": []}, "none is named"),
        ({"profile": "olympic"}, "there are extreme, iso, tum"),
        ({"profile": "tum", "approach_speed_m_s": 2.0}, "belongs to profile iso"),
    ],
)
def test_cells_refuse(people: dict[str, object], told: str) -> None:
    with pytest.raises(SetupError, match=told):
        Cell.from_table({"people": people})


def test_a_model_that_does_not_follow_from_the_profile_is_refused(tmp_path: Path) -> None:
    path = Scene(duration=0.5, people={"p1": far}).write(tmp_path / "r.mcap")
    cell = Cell.from_table({**CELL, "people": {"models": ["articulated_acceleration"]}})
    with pytest.raises(SetupError, match="articulated_acceleration does not follow from profile iso"):
        verify(path, cell)


def test_models_are_named_once_and_asked_in_one_order() -> None:
    profile = load_profile("tum")
    with pytest.raises(ModelError, match="name each once"):
        build_models(profile, ["iso13855", "iso13855"])
    found = build_models(profile, ["articulated_position", "iso13855"])
    assert [model.name for model in found] == ["iso13855", "articulated_position"]
    assert [model.index for model in found] == [0, 1]
    assert all(model.name in MODEL_NAMES for model in found)


def test_a_profile_file_of_ones_own(tmp_path: Path) -> None:
    source = Path(load_profile.__code__.co_filename).parent / "profiles" / "tum.toml"
    text = source.read_text(encoding="utf-8").replace('name = "tum"', 'name = "ours"')
    (tmp_path / "ours.toml").write_text(text, encoding="utf-8")
    (tmp_path / "cell.toml").write_text('[robot]\nbare_flange = true\n[people]\nprofile = "ours.toml"\n')
    recording = Scene(duration=0.5, people={"p1": far}).write(tmp_path / "r.mcap")
    report = verify(recording, Cell.from_toml(tmp_path / "cell.toml"))
    assert report.profile.startswith("ours (")
    title = load_profile("tum").title
    assert f"people.profile is a file of its own: {title}" in report.notes
    bundled = verify(
        recording, Cell.from_table({"robot": {"bare_flange": True}, "people": {"profile": "tum"}})
    )
    assert not [note for note in bundled.notes if "people.profile" in note]


@pytest.mark.rarely("test_every_model_of_every_profile_stands_there_once")
def test_a_profile_file_of_ones_own_is_compared_with_each_of_its_models(tmp_path: Path, shell: Shell) -> None:
    source = Path(load_profile.__code__.co_filename).parent / "profiles" / "iso.toml"
    text = source.read_text(encoding="utf-8").replace('name = "iso"', 'name = "ours"')
    (tmp_path / "ours.toml").write_text(text, encoding="utf-8")
    cell = tmp_path / "cell.toml"
    cell.write_text(
        '[robot]\nbare_flange = true\naccept_assumed = ["limits"]\n[people]\nprofile = "ours.toml"\n'
        'models = ["pedestrian", "iso13855"]\n',
        encoding="utf-8",
    )
    own = str(tmp_path / "ours.toml")
    follow = tuple(name for name in MODEL_NAMES if name in load_profile("iso").models)
    found = [(each.people.profile, set(each.people.models)) for each in beliefs(Cell.from_toml(cell))]
    wanted = [{"pedestrian", "iso13855"}, *({name} for name in follow), set(follow)]
    assert len(follow) > 2
    assert found[: len(wanted)] == [(own, models) for models in wanted]
    assert {profile for profile, _models in found[len(wanted) :]} == {*profile_names()}
    recording = Scene(duration=0.3, people={"p1": far}).write(tmp_path / "r.mcap")
    rows = compare(recording, Cell.from_toml(cell))
    same = {row.models: row for row in rows if row.profile == "iso"}
    for row in rows[1 : len(wanted)]:
        assert (row.profile, row.verified) == (own, same[row.models].verified)
    assert rows[len(wanted) - 1].verified > 0
    lines = table(rows)
    assert "pedestrian, iso13855" in lines[1] and "all that follow" in lines[len(wanted)]


def test_models_help_one_another(tmp_path: Path) -> None:
    """A hand that is fast but tied to a shoulder far away: what speed leaves open, position proves."""
    scene = Scene(people={"p1": lambda _t: person_at(3.2, 0.0)})
    path = scene.write(tmp_path / "r.mcap")

    def status(*models: str) -> np.ndarray:
        people = {"latency_s": 0.03, "profile": "extreme", "models": models}
        return verify(path, Cell.from_table({**CELL, "people": people})).per_cycle.status

    speed, position = status("articulated_velocity"), status("articulated_position")
    both = status("articulated_velocity", "articulated_position")
    verified = Status.VERIFIED
    assert ((both == verified) >= ((speed == verified) | (position == verified))).all()
    assert (both == verified).sum() > (speed == verified).sum()


# -------------------------------------------------------------------------------------- the command line


def test_the_command_prints_the_table_and_what_the_schema_says(
    recording: Path, rows: list[Compared], tmp_path: Path, shell: Shell
) -> None:
    cell = tmp_path / "cell.toml"
    cell.write_text('[robot]\nbare_flange = true\naccept_assumed = ["limits"]\n[people]\nlatency_s = 0.03\n')
    status, out, _err = shell("verify", recording, "--cell", cell, "--compare", "--json", tmp_path / "c.json")
    assert status == rows[0].exit_status
    assert out.splitlines()[: len(rows) + 1] == table(rows)
    assert "time lost: recorded time" in out and "Simulated." in out
    printed = json.loads((tmp_path / "c.json").read_text())
    assert printed == [row.to_dict() for row in rows]
    schema = json.loads((ROOT / "docs/compare.schema.json").read_text(encoding="utf-8"))
    jsonschema.Draft202012Validator(schema).validate(printed)
    less = [{key: value for key, value in printed[0].items() if key != "weakest"}]
    assert list(jsonschema.Draft202012Validator(schema).iter_errors(less))


@pytest.mark.parametrize("option", [("--picture", "p.png"), ("--out", "o.mcap"), ("--assume-nobody",)])
def test_what_is_about_one_run_is_refused(recording: Path, shell: Shell, option: tuple[str, ...]) -> None:
    assert f"--compare: {option[0]} is about one run" in refused(
        shell("verify", recording, "--bare-flange", "--compare", *option)
    )


def test_the_hash_of_a_cell_does_not_depend_on_where_its_files_lie(tmp_path: Path) -> None:
    found = set()
    for folder in ("one", "two"):
        (tmp_path / folder).mkdir()
        for name in ("demo.toml", "gripper.toml"):
            (tmp_path / folder / name).write_bytes((ROOT / "data" / name).read_bytes())
        cell = Cell.from_toml(tmp_path / folder / "demo.toml")
        found.add(cell.content_hash(build_robot(cell).content_hash))
    assert len(found) == 1


def test_nobody_rests_on_limits_that_their_model_does_without(rows: list[Compared]) -> None:
    arms = [row for row in rows if row.models == ("arm_reach",) and not row.contradicted]
    assert arms
    for row in arms:
        assert not any(name in row.weakest for name in ("flexion", "arm.extension =", "torso_rate"))


def test_what_the_cell_waives_is_said(tmp_path: Path) -> None:
    path = Scene(duration=0.3, people={"p1": far}).write(tmp_path / "r.mcap")
    people = {**CELL["people"], "models": ["iso13855"]}
    rows = compare(path, Cell.from_table({"people": people}))
    assert rows[0].exit_status == 3
    lines = waived_lines(rows)
    assert all(line.startswith("waived: ") for line in lines)
    assert any("no tool declared" in line for line in lines) and list(rows[0].to_dict()["waived"]) != []


def test_profile_files_do_not_pass_for_bundled_ones(tmp_path: Path) -> None:
    source = Path(load_profile.__code__.co_filename).parent / "profiles" / "tum.toml"
    text = source.read_text(encoding="utf-8")
    (tmp_path / "ours.toml").write_text(text, encoding="utf-8")
    with pytest.raises(SetupError, match=r"profile ours.toml: name 'tum' is that of a bundled profile"):
        load_profile(tmp_path / "ours.toml")
    wrong = text.replace('name = "tum"', 'name = "ours"').replace('"pedestrian"', '"pedestrain"')
    (tmp_path / "ours.toml").write_text(wrong, encoding="utf-8")
    with pytest.raises(ModelError, match="profile ours names a model 'pedestrain' that is not known"):
        build_models(load_profile(tmp_path / "ours.toml"), ["iso13855"])
