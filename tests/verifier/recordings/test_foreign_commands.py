"""Every command that takes a recording takes a bag, with the same result."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.verifier.recordings.bags import (
    WRITERS,
    Item,
    in_time,
    joint_item,
    people_item,
    text_item,
    write_ros1,
    write_ros2,
)
from tests.verifier.scenes import UR5_JOINTS, Scene, person_at
from tests.verifier.shell import Shell, refused
from verifier.recordings import Recording
from verifier.recordings.joint_state import JointState
from verifier.recordings.joint_state import decode as decode_joints
from verifier.recordings.mcap_file import McapFile
from verifier.recordings.people_report import COLUMN, PeopleReport, ReportedPerson, encode
from verifier.recordings.people_report import decode as decode_people
from verifier.recordings.topic import JOINT_TOPIC, PEOPLE_TOPIC


@pytest.fixture
def shell(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> Shell:
    monkeypatch.chdir(tmp_path)
    return Shell(monkeypatch, capsys)


@pytest.fixture
def ours(tmp_path: Path) -> Path:
    """Somebody comes near: some cycles are verified, others are not."""
    scene = Scene(people={"p1": lambda t: person_at(1.8 - 1.5 * t, 0.0)}, duration=0.6, robot=None)
    return scene.write(tmp_path / "ours.mcap")


def items_of(path: Path, prefix: str = "") -> list[Item]:
    """What one of our recordings holds, for another library to write."""
    file = Recording(path).file
    items: list[Item] = []
    for message in file.messages([JOINT_TOPIC, PEOPLE_TOPIC]):
        if message.channel.topic == JOINT_TOPIC:
            state = decode_joints(message.data)
            named = replace(state, names=tuple(prefix + name for name in state.names))
            items.append(joint_item(named, arrived_ns=message.log_time))
        else:
            items.append(people_item(decode_people(message.data, message.log_time)))
    return items


def verdicts(shell: Shell, path: Path, *options: object) -> dict[str, object]:
    status, out, err = shell("verify", path, "--robot", "ur5", "--bare-flange", "--json", "-", *options)
    assert err == "" or status in (0, 1, 3), err
    found = json.loads(out)
    return {
        key: found[key]
        for key in ("cycles", "verified", "not_verified", "per_cycle", "tightest", "stop_time_s")
    }


def test_verdicts_are_those_of_the_neutral_format(shell: Shell, ours: Path, tmp_path: Path) -> None:
    expected = verdicts(shell, ours)
    assert expected["verified"] and expected["not_verified"]
    for number, (name, write) in enumerate(WRITERS.values()):
        folder = tmp_path / str(number)
        folder.mkdir()
        assert verdicts(shell, write(folder / name, items_of(ours))) == expected
    prefixed = write_ros2(tmp_path / "left", items_of(ours, "left/"))
    assert verdicts(shell, prefixed) == expected


def test_the_result_names_the_files_and_what_was_translated(shell: Shell, ours: Path, tmp_path: Path) -> None:
    folder = write_ros2(tmp_path / "shift", items_of(ours, "left_"))
    out = tmp_path / "out.mcap"
    command = ("verify", folder, "--robot", "ur5", "--bare-flange", "--json", "-", "--out", out)
    _status, text, _err = shell(*command)
    found = json.loads(text)
    assert found["recording"] == "shift"
    assert {each["file"] for each in found["inputs"]} == {"metadata.yaml", "shift.db3"}
    stated = {each["name"]: each["value"] for each in found["assumptions"]}
    assert stated["recording.joint_prefix"] == "left_"
    assert stated["recording.joints_topic"] == "/joint_states (sensor_msgs/msg/JointState)"
    assert "/verdict" in {channel.topic for channel in McapFile(out).channels.values()}


def test_options_and_cell_choose(shell: Shell, ours: Path, tmp_path: Path) -> None:
    both = in_time([*items_of(ours, "left_"), *(i for i in items_of(ours, "right_") if i[0] == JOINT_TOPIC)])
    path = write_ros1(tmp_path / "two.bag", both)
    line = refused(shell("verify", path, "--robot", "ur5", "--bare-flange"))
    assert "after left_, right_; choose one with --joint-prefix, or joint_prefix in [recording]" in line
    expected = verdicts(shell, ours)
    assert verdicts(shell, path, "--joint-prefix", "right_") == expected
    (tmp_path / "cell.toml").write_text('[recording]\njoint_prefix = "left_"\n')
    assert verdicts(shell, path, "--cell", tmp_path / "cell.toml") == expected
    line = refused(shell("verify", path, "--cell", tmp_path / "cell.toml", "--joint-prefix", "right_"))
    assert "--joint-prefix right_: the cell says left_; they must agree" in line


def test_inspect_shows_what_is_there_and_init_asks_for_the_choice(
    shell: Shell, ours: Path, tmp_path: Path
) -> None:
    items = [
        (f"/{side}{t}", k, ns, m) for t, k, ns, m in items_of(ours) for side in ("a", "b") if t == JOINT_TOPIC
    ]
    path = write_ros1(
        tmp_path / "a.bag", in_time([*items, *(i for i in items_of(ours) if i[0] == PEOPLE_TOPIC)])
    )
    status, out, _err = shell("inspect", path, "--json", "-")
    found = json.loads(out)
    assert status == 0
    assert found["choices"] == {"joints_topic": ["/a/joint_states", "/b/joint_states"]}
    assert [t["name"] for t in found["topics"]] == ["/a/joint_states", "/b/joint_states", "/people"]
    assert any("several topics with joints" in remark for remark in found["remarks"])
    _status, out, _err = shell("init", path)
    assert 'joints_topic = "____"  # one of "/a/joint_states", "/b/joint_states"' in out
    status, out, _err = shell("inspect", path, "--joints-topic", "/a/joint_states", "--json", "-")
    chosen = json.loads(out)
    assert chosen["joints"] == list(UR5_JOINTS)
    assert chosen["people"] == {"p1": 31}
    assert chosen["topics"][0]["stamp_age_s"] == [0.0, 0.0, 0.0]
    assert chosen["topics"][2]["stamp_age_s"][0] == pytest.approx(0.03)


def test_inspect_says_the_same_of_a_bag_as_of_ours(shell: Shell, ours: Path, tmp_path: Path) -> None:
    path = write_ros1(tmp_path / "a.bag", items_of(ours))
    found = [json.loads(shell("inspect", each, "--json", "-")[1]) for each in (ours, path)]
    same = (
        "duration_s",
        "joints",
        "people",
        "points",
        "frames",
        "position_error_m",
        "robot_candidates",
        "publishers",
    )
    assert {key: found[0][key] for key in same} == {key: found[1][key] for key in same}


def test_import_reads_bags(shell: Shell, ours: Path, tmp_path: Path) -> None:
    path = write_ros1(tmp_path / "a.bag", items_of(ours, "left_"))
    mine = ("import", tmp_path / "1.mcap", "--robot", "ur5", "--joints", ours, "--people", ours)
    bags = ("import", tmp_path / "2.mcap", "--robot", "ur5", "--joints", path, "--people", path)
    assert shell(*mine)[0] == 0
    status, out, err = shell(*bags)
    assert status == 0, err
    assert "recording.joint_prefix = left_" in out
    messages = [
        [(m.channel.topic, m.log_time, m.data) for m in Recording(tmp_path / name).file.messages()]
        for name in ("1.mcap", "2.mcap")
    ]
    assert messages[0] == messages[1]


def test_damage_is_refused_by_every_command(shell: Shell, ours: Path, tmp_path: Path) -> None:
    path = write_ros1(tmp_path / "a.bag", items_of(ours))
    path.write_bytes(path.read_bytes()[:-2000])
    for command in (("verify", path, "--robot", "ur5"), ("inspect", path), ("stops", path), ("init", path)):
        line = refused(shell(*command))
        assert "can be read; `rosbag reindex a.bag` repairs it" in line


def flag(value: bool) -> Callable[[Any], Any]:
    return lambda store: store.types["std_msgs/msg/Bool"](data=bool(value))


def test_stops_reads_flags_of_ros1_and_ros2(shell: Shell, tmp_path: Path) -> None:
    """A joint that brakes after a protective stop."""
    t = np.arange(0.0, 4.0, 0.01)
    speed = np.clip(1.0 - np.clip(t - 2.0, 0.0, None) / 0.5, 0.0, 1.0)
    q = np.cumsum(speed) * 0.01
    states = [JointState(10**9 + round(s * 1e9), ("j",), np.array([x])) for s, x in zip(t, q, strict=True)]
    items = list(map(joint_item, states))
    for s in np.arange(0.0, 4.0, 0.05):
        items.append(("/arm/protective_stop", "std_msgs/msg/Bool", 10**9 + round(s * 1e9), flag(s >= 2.0)))
    found = []
    for path in (write_ros1(tmp_path / "a.bag", in_time(items)), write_ros2(tmp_path / "a", in_time(items))):
        status, out, err = shell("stops", path, "--json", "-")
        assert status == 0, err
        found.append(json.loads(out)["recordings"][0])
    assert len(found[0]["stops"]) == 1
    assert found[0]["stops"] == found[1]["stops"]


def sara_reports(container_path: Path) -> list[PeopleReport]:
    """People of the real bag in our words; the points are named in the README of the experiments."""
    from verifier.recordings.containers import open_container

    left, right = (tuple(f"{side}_{name}" for name in ("shoulder", "elbow", "wrist")) for side in "lr")
    names = (*left, *right, "head", None, "neck_base", "pelvis")
    found = []
    for message in open_container(container_path).messages(["/SaRA_demo_human_capsules"]):
        xyz = np.full((20, 3), np.nan)
        measured = 0
        for name, point in zip(names, message.value.positions, strict=True):
            place = np.array([point.x, point.y, point.z], np.float32).astype(float)
            if name is not None and place.any() and np.isfinite(place).all():
                xyz[COLUMN[name]] = place
                measured |= 1 << COLUMN[name]
        person = ReportedPerson("p1", xyz, np.full(20, 0.01), measured)
        found.append(PeopleReport(message.log_time_ns, message.log_time_ns, "world", False, (person,)))
    return found


def test_the_real_bag_gives_the_verdicts_of_its_npz(shell: Shell, real_data: Path, tmp_path: Path) -> None:
    """The NPZ has times in double seconds: they differ by less than a microsecond, the points do not."""
    original = real_data / "human_robot" / "original" / "exp_headbutt.bag"
    items = [text_item("/people", r.arrived_ns, encode(r).decode()) for r in sara_reports(original)[:120]]
    bag = write_ros1(tmp_path / "people.bag", items)
    t = np.arange(0.0, 1.0, 0.008)
    q = np.stack([0.4 * np.sin(t + n) - (n == 1) for n in range(6)], axis=1)
    np.savez(tmp_path / "joints.npz", t=t, q=q, joints=np.array(UR5_JOINTS))
    found = []
    for number, people in enumerate((real_data / "human_robot" / "sara_exp_headbutt.npz", bag)):
        out = tmp_path / f"{number}.mcap"
        command = ("import", out, "--robot", "ur5", "--joints", tmp_path / "joints.npz", "--people", people)
        assert shell(*command)[0] == 0
        found.append(verdicts(shell, out)["per_cycle"])
    assert found[0]["status"] == found[1]["status"]
    gaps = [np.array(each["gap_m"], float) for each in found]
    assert np.nanmax(np.abs(gaps[0] - gaps[1])) < 1e-4
