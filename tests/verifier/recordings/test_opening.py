"""Opening what a cell is about: by path too, and tables; people may be left out."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from robots.errors import SetupError
from tests.verifier.recordings.bags import WRITERS, Item, in_time, text_item, write_ros1
from tests.verifier.recordings.test_foreign_commands import items_of, ours, shell, verdicts
from tests.verifier.scenes import UR5_JOINTS
from tests.verifier.shell import Shell, refused
from verifier import Cell, verify
from verifier.cell import CellError
from verifier.opened import choice_of, open_recording
from verifier.recordings import Recording, RecordingError, inspect_recording
from verifier.recordings.joint_state import decode as decode_joints
from verifier.recordings.topic import JOINT_TOPIC, PEOPLE_TOPIC
from verifier.reports.verification import VerifyReport

__all__ = ["ours", "shell"]
BOOL = "std_msgs/msg/Bool"
BOX = {"kind": "box", "detection_time_s": 0.1, "min_m": [-2, -2, -2], "max_m": [2, 2, 2]}


def cell(**recording: Any) -> Cell:
    people = {"monitored": dict.fromkeys(recording.pop("regions", ()), BOX)}
    return Cell.from_table(
        {"robot": {"name": "ur5", "bare_flange": True}, "recording": recording, "people": people}
    )


def judged(report: VerifyReport) -> list[int]:
    assert len(report.per_cycle.status)
    return list(map(int, report.per_cycle.status))


@pytest.fixture
def two_people(ours: Path, tmp_path: Path) -> Path:
    """A bag with two topics of people: it is not plain which is meant."""
    items = items_of(ours)
    reports = [item for item in items if item[0] == PEOPLE_TOPIC]
    moved = [("/a/people", *item[1:]) for item in reports]
    far = [
        text_item("/b/people", item[2], '{"stamp": 0, "frame": "world", "people": []}') for item in reports
    ]
    joints = [item for item in items if item[0] != PEOPLE_TOPIC]
    return write_ros1(tmp_path / "two.bag", in_time([*joints, *moved, *far]))


def test_a_path_is_opened_as_the_cell_says(two_people: Path, ours: Path) -> None:
    """Also prefixes: the cell names the arm."""
    by_path = verify(two_people, cell(people_topic="/a/people"))
    assert judged(by_path) == judged(verify(ours, cell()))
    with pytest.raises(SetupError, match="no topic /c/people"):
        verify(two_people, cell(people_topic="/c/people"))


def test_nobody_is_assumed_beside_people_who_would_be_refused(
    ours: Path, tmp_path: Path, shell: Shell
) -> None:
    """People of another type on our topic: without them the verdicts are those of nobody."""
    joints = [item for item in items_of(ours) if item[0] != PEOPLE_TOPIC]
    wrong = [text_item("/k", 0, "x"), text_item("/people", joints[0][2], "no report")]
    switch: list[Item] = [("/k", BOOL, joints[5][2], lambda store: store.types[BOOL](data=True))]
    path = write_ros1(tmp_path / "a.bag", in_time([*joints, *switch, wrong[1]]))
    stated = cell(people_topic="/k")
    assert "[recording.switch]" in refused_by(open_recording, path, stated)
    report = verify(path, stated, assume_nobody=True)
    assert judged(report) == judged(verify(ours, cell(), assume_nobody=True))
    (why,) = [each for each in report.assumptions if each.name == "recording.people_not_read"]
    assert "[recording.switch]" in why.source
    cell_file = tmp_path / "cell.toml"
    cell_file.write_text(
        '[robot]\nname = "ur5"\nbare_flange = true\n[recording]\npeople_topic = "/k"\n', encoding="utf-8"
    )
    out = tmp_path / "out.mcap"
    status, _out, err = shell("verify", path, "--cell", cell_file, "--assume-nobody", "--out", out)
    assert (status, err) == (3, "") and Recording(out).file.counts
    status, _out, err = shell("verify", path, "--cell", cell_file)
    assert status == 2 and "[recording.switch]" in err


def refused_by(call: Any, *arguments: Any) -> str:
    with pytest.raises((SetupError, RecordingError)) as caught:
        call(*arguments)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def table_of(path: Path, out: Path) -> Path:
    """The joints of one of our recordings as a table, to the last digit."""
    rows = ["t," + ",".join(UR5_JOINTS)]
    states = [decode_joints(message.data) for message in Recording(path).file.messages([JOINT_TOPIC])]
    for state in states:
        seconds = (state.stamp_ns - states[0].stamp_ns) / 1e9
        rows.append(",".join(map(repr, [seconds, *map(float, state.position)])))
    out.write_text("\n".join(rows), encoding="utf-8")
    return out


def test_tables_of_joints_are_judged_without_an_import(ours: Path, tmp_path: Path, shell: Shell) -> None:
    table = table_of(ours, tmp_path / "a.csv")
    told = verdicts(shell, table, "--assume-nobody")
    assert told == verdicts(shell, ours, "--assume-nobody")
    assert "state with verify --assume-nobody" in refused(
        shell("verify", table, "--robot", "ur5", "--bare-flange")
    )
    assert "does not say of which arm it is" in refused(shell("verify", table, "--assume-nobody"))
    assert "lacks joint" in refused(shell("verify", table, "--robot", "panda", "--assume-nobody"))
    people = tmp_path / "p.csv"
    people.write_text("t,person,head_x,head_y,head_z\n0,a,1,2,3\n0.1,a,1,2,3\n", encoding="utf-8")
    assert "points of people, and no joints" in refused(
        shell("verify", people, "--robot", "ur5", "--assume-nobody")
    )


def test_what_the_cell_says_of_a_source_reaches_its_adapter() -> None:
    stated = cell(
        ros4hri_error_m=0.3,
        floor={"error_m": 0.2, "floor_z_m": -1.0},
        switch={"free_when": False, "age_s": 0.5, "regions": ["a", "b"]},
        regions=["b", "a"],
    )
    choice = choice_of(stated)
    people = choice.people
    assert (people.ros4hri_error_m, choice.regions) == (0.3, ("b", "a"))
    assert people.floor is not None and (people.floor.error_m, people.floor.floor_z_m) == (0.2, -1.0)
    assert people.field is not None and (people.field.free_when, people.field.age_s) == (False, 0.5)


@pytest.mark.parametrize("regions", [[], ["a"], ["a", "b", "c"]])
def test_a_switch_that_does_not_speak_for_all_regions_is_refused(regions: list[str]) -> None:
    with pytest.raises(CellError, match=r"the switch must speak for all of people\.monitored"):
        cell(switch={"free_when": True, "age_s": 0.1, "regions": ["a", "b"]}, regions=regions)


def test_frames_that_are_tilted_have_no_floor() -> None:
    tilted = {"a": {"rpy_deg": [0, 0, 40]}, "b": {"rpy_deg": [0, 1, 0]}, "c": {"rpy_deg": [180, 0, 0]}}
    table = {"recording": {"floor": {"error_m": 0.1}}, "people": {"frames": tilted}}
    floor = choice_of(Cell.from_table(table)).people.floor
    assert floor is not None and floor.tilted == {"b", "c"}


@pytest.mark.parametrize("kind", ["ros1", "ros2 sqlite", "mcap"])
def test_inspect_names_topics_that_show_people_or_may(ours: Path, tmp_path: Path, kind: str) -> None:
    """Text with reports on a topic of another name; a switch and poses, of which nobody can tell."""
    items = items_of(ours)
    joints = [item for item in items if item[0] != PEOPLE_TOPIC]
    reports = [("/k", *item[1:]) for item in items if item[0] == PEOPLE_TOPIC]
    other = [text_item("/log", joints[3][2], "started"), text_item("/log", joints[4][2], '{"people": 3}')]
    name, write = WRITERS[kind]
    found = inspect_recording(write(tmp_path / name, in_time([*joints, *reports, *other])))
    assert found.choices["people_topic"] == ("/k",)
    assert any(
        line.startswith('/k (std_msgs/msg/String) shows people: people_topic = "/k" in [recording]')
        for line in found.remarks
    )
    switch: Item = (
        "/f",
        "std_msgs/msg/Bool",
        joints[5][2],
        lambda s: s.types["std_msgs/msg/Bool"](data=True),
    )
    (tmp_path / "b").mkdir()
    found = inspect_recording(write(tmp_path / "b" / name, in_time([*joints, switch])))
    assert "people_topic" not in found.choices
    assert any("[recording.switch]" in line for line in found.remarks)
