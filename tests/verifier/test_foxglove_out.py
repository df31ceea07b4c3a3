"""``verify --out``: the recording as it was, with verdicts and scenes that viewers can read."""

from __future__ import annotations

import importlib.util
import json
import re
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from robots.errors import SetupError
from tests.verifier.recordings.bags import write_ros1, write_ros2
from tests.verifier.recordings.test_foreign_commands import items_of
from tests.verifier.scenes import Scene, person_at
from tests.verifier.shell import Shell, refused
from verifier.cell import Cell
from verifier.onlooker import SeenCycle
from verifier.outcome_colours import BODY_COLOURS, OUTCOME_COLOURS
from verifier.recordings.containers import open_container
from verifier.recordings.foxglove_scene import NOT_INSTALLED, Entity, SceneEncoder
from verifier.recordings.spool import AddedTopic, new_spool
from verifier.recordings.topic import ADDED_TOPICS
from verifier.replay import verify
from verifier.scene_recorder import HEADLINES, SceneRecorder
from verifier.scene_sets import pieces
from verifier.verdict import Reason, Status

ROOT = Path(__file__).resolve().parents[2]


def raw(path: Path) -> list[tuple[Any, ...]]:
    """Every message as another library reads it: topic, schema, times, bytes."""
    with path.open("rb") as stream:
        return [
            (
                c.topic,
                s and (s.name, s.encoding, s.data),
                c.message_encoding,
                m.log_time,
                m.publish_time,
                m.data,
            )
            for s, c, m in make_reader(stream).iter_messages()
        ]


def times(message: Any) -> tuple[int, int]:
    return message.log_time, message.publish_time


def decoded(path: Path, topic: str) -> Iterator[tuple[int, Any]]:
    with path.open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        for _schema, _channel, message, value in reader.iter_decoded_messages(topics=[topic]):
            yield message.log_time, value


def near(t: float) -> Any:
    """Somebody who comes close while the arm swings, so that there is more than one outcome."""
    return person_at(2.2 - 1.0 * t, 0.2)


@pytest.fixture(scope="module")
def judged(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path, dict[str, Any]]:
    """A recording, its copy with scenes, and the JSON of the same run."""
    folder = tmp_path_factory.mktemp("judged")
    recording = Scene(duration=1.2, people={"p1": near}).write(folder / "r.mcap")
    cell = folder / "cell.toml"
    cell.write_text(
        "[robot]\nbare_flange = true\n"
        '[workspace.fixtures.table]\nkind = "box"\nsize_m = [0.5, 0.5, 0.1]\nxyz_m = [0.0, 2.0, -1.0]\n'
        "position_error_m = 0.01\n"
    )
    out, table = folder / "out.mcap", folder / "r.json"
    arguments = ["verify", str(recording), "--cell", str(cell), "--out", str(out), "--json", str(table)]
    from verifier.__main__ import main

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", ["stopproof", *arguments])
        with pytest.raises(SystemExit):
            main()
    return recording, out, json.loads(table.read_text())


def test_every_original_message_is_there_byte_for_byte(judged) -> None:
    recording, out, _found = judged
    added = {*ADDED_TOPICS, "/verdict"}
    assert [each for each in raw(out) if each[0] not in added] == raw(recording)
    assert {each[0] for each in raw(out)} >= added


def test_every_cycle_has_the_verdict_of_the_json(judged) -> None:
    _recording, out, found = judged
    rows, start = found["per_cycle"], found["start_ns"]
    shown = [(each[1], each[3], json.loads(each[5])) for each in raw(out) if each[0] == "/stopproof/verdict"]
    schema = json.loads(shown[0][0][2])
    jsonschema.Draft202012Validator.check_schema(schema)
    validator = jsonschema.Draft202012Validator(schema)
    assert len(shown) == found["cycles"] == len(rows["t"])
    assert len(set(rows["status"])) > 1, "the scene has several outcomes"
    for k, (_schema, time_ns, value) in enumerate(shown):
        validator.validate(value)
        assert time_ns == start + round(rows["t"][k] * 1e9)
        assert (value["t"], value["status"]) == (rows["t"][k], rows["status"][k])
        assert value["reason"] == found["reason_names"][str(rows["reason"][k])]
        assert value["outcome"] == Status(value["status"]).name.lower()
        assert value["colour"] == OUTCOME_COLOURS[Status(value["status"])]
        for key in ("gap_m", "stop_time_s"):
            assert value.get(key) == rows[key][k]


def test_each_scene_says_the_outcome_in_words_and_in_colour(judged) -> None:
    _recording, out, found = judged
    rows, start = found["per_cycle"], found["start_ns"]
    at = {start + round(t * 1e9): k for k, t in enumerate(rows["t"])}
    drawn = []
    for time_ns, scene in decoded(out, "/stopproof/scene"):
        k = at[time_ns]
        drawn.append(k)
        assert [deletion.type for deletion in scene.deletions] == [1], "a scene replaces the one before"
        names = [entity.id for entity in scene.entities]
        assert len(set(names)) == len(names)
        assert {entity.frame_id for entity in scene.entities} == {"world"}
        assert {entity.timestamp.ToNanoseconds() for entity in scene.entities} == {time_ns}
        text = next(entity for entity in scene.entities if entity.id == "verdict").texts[0].text
        status, reason = Status(rows["status"][k]), Reason(rows["reason"][k])
        assert text.startswith(f"{HEADLINES[status]}: {reason.text}")
        links = [
            entity for entity in scene.entities if entity.id.startswith("link ") and "set" not in entity.id
        ]
        for colour in (sphere.color for entity in links for sphere in entity.spheres):
            read = [round(255 * part) for part in (colour.r, colour.g, colour.b)]
            assert read == [int(OUTCOME_COLOURS[status][i : i + 2], 16) for i in (1, 3, 5)]
    changes = [k for k in range(1, found["cycles"]) if rows["reason"][k] != rows["reason"][k - 1]]
    assert set(drawn) >= {0, *changes}
    assert np.diff(np.array(rows["t"])[drawn]).max() <= 0.1 + 1e-9


def test_frames_and_fixtures_are_readable(judged) -> None:
    _recording, out, _found = judged
    (_time, fixtures), *rest = decoded(out, "/stopproof/fixtures")
    assert not rest
    assert any("table" in entity.id for entity in fixtures.entities)
    for _time, frames in decoded(out, "/stopproof/frames"):
        assert len(frames.transforms) == 6
        for each in frames.transforms:
            r = each.rotation
            assert abs(r.x**2 + r.y**2 + r.z**2 + r.w**2 - 1.0) < 1e-9


class Compared:
    """Looks at each cycle as the recorder does, and keeps what was judged."""

    def __init__(self, recorder: SceneRecorder) -> None:
        self.recorder, self.compared, self.people = recorder, 0, 0

    def begin(self, start_ns: int) -> None:
        self.recorder.begin(start_ns)

    def look(self, seen: SeenCycle) -> None:
        kept: list[list[Entity]] = []
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(SceneEncoder, "update", lambda _self, _time, entities: kept.append(entities) or b"")
            self.recorder.look(seen)
        for entities in kept[-1:]:
            self.check(seen, entities)

    def check(self, seen: SeenCycle, entities: list[Entity]) -> None:
        sets = [e for e in entities if e.name.startswith("link set")]
        if not seen.swept:
            assert not sets, "nothing was swept: nothing is drawn as if it was"
            return
        rows, check = seen.check.links[0], seen.check
        i = int(seen.judged.slices["n"][0]) - 1
        if check.nearest is not None and check.blocked is None:
            i = check.nearest.slice
        first, end = int(rows["first"][i]), int(rows["first"][i + 1])
        assert len(sets) == end - first
        for entity, row in zip(sets, range(first, end), strict=True):
            corners = rows["points"][row, : int(rows["n_points"][row])]
            assert entity.sets[0].radius == rows["radius"][row]
            assert {tuple(c) for c in entity.sets[0].spheres} == {tuple(c) for c in corners}
        self.compared += 1
        nearest = check.nearest
        if nearest is None or check.blocked is not None:
            return
        model = nearest.model if nearest.people_row >= 0 else 0
        people = check.occupancies[model].sets[0]
        drawn = [
            (e.sets[0].radius, {*map(tuple, e.sets[0].spheres)}) for e in entities if "person set" in e.name
        ]
        assert drawn == [
            (people["radius"][row], {*map(tuple, people["points"][row, : int(people["n_points"][row])])})
            for row in range(int(people["first"][i]), int(people["first"][i + 1]))
        ]
        self.people += len(drawn)


def test_what_is_drawn_is_what_was_judged(judged, tmp_path) -> None:
    recording, _out, _found = judged
    cell = Cell.from_toml(recording.parent / "cell.toml")
    with new_spool(tmp_path / "x") as spool:
        compared = Compared(SceneRecorder(cell, spool))
        watched = verify(recording, cell, onlooker=compared)
    assert compared.compared > 5
    assert compared.people > 5
    alone = verify(recording, cell)
    same = replace(watched, real_time_factor=0.0, stills={}).to_dict()
    assert same == replace(alone, real_time_factor=0.0, stills={}).to_dict(), "looking changes nothing"


def test_primitives_have_the_radius_and_place_of_the_set() -> None:
    from foxglove import messages
    from google.protobuf import descriptor_pb2, descriptor_pool, message_factory

    schema = messages.SceneUpdate.get_schema()
    pool = descriptor_pool.DescriptorPool()
    for file in descriptor_pb2.FileDescriptorSet.FromString(schema.data).file:
        pool.Add(file)
    kind = message_factory.GetMessageClass(pool.FindMessageTypeByName(schema.name))
    for ends in ([[0, 0, 0], [0, 0, 2]], [[0, 0, 1], [0, 0, -1]], [[0.1, 0.2, 0.3], [1.0, -2.0, 0.5]]):
        axis = np.array(ends, dtype=float)
        entity = Entity("a", (1.0, 0.0, 0.0, 0.5), sets=[pieces(axis, 0.3)])
        scene = kind.FromString(SceneEncoder().update(1_500_000_000, [entity]))
        (drawn,) = scene.entities
        assert len(drawn.spheres) == 2
        for sphere in drawn.spheres:
            assert (sphere.size.x, sphere.size.y, sphere.size.z) == (0.6, 0.6, 0.6)
        (cylinder,) = drawn.cylinders
        assert (cylinder.size.x, cylinder.size.y) == (0.6, 0.6)
        assert (cylinder.bottom_scale, cylinder.top_scale) == (1.0, 1.0), "neither a cone nor nothing"
        q, at = cylinder.pose.orientation, cylinder.pose.position
        z = np.array([2 * (q.x * q.z + q.w * q.y), 2 * (q.y * q.z - q.w * q.x), 1 - 2 * (q.x**2 + q.y**2)])
        found = np.array([at.x, at.y, at.z]) + 0.5 * cylinder.size.z * np.array([[-1.0], [1.0]]) * z
        assert np.allclose(found, axis, atol=1e-12)


def test_colours_are_those_of_the_page() -> None:
    page = (ROOT / "verifier/reports/html/page.css").read_text()
    light = dict(re.findall(r"--([a-z-]+): (#[0-9a-f]{6})", page.split("@media", maxsplit=1)[0]))
    for status, colour in OUTCOME_COLOURS.items():
        assert light[status.name.lower().replace("_", "-")] == colour
    assert {name: light[name] for name in BODY_COLOURS} == dict(BODY_COLOURS)


@pytest.mark.parametrize("kind", ["ros1", "ros2"])
def test_bags_are_copied_as_they_are(shell: Shell, tmp_path: Path, kind: str) -> None:
    ours = Scene(duration=0.5).write(tmp_path / "ours.mcap")
    items = items_of(ours, "left_")
    path = write_ros1(tmp_path / "a.bag", items) if kind == "ros1" else write_ros2(tmp_path / "a", items)
    out = tmp_path / "out.mcap"
    assert shell("verify", path, "--robot", "ur5", "--bare-flange", "--out", out)[0] in (0, 1, 3)
    expected = [
        (r.channel.topic, r.channel.schema, r.log_time_ns, r.data) for r in open_container(path).records()
    ]
    found = [(topic, schema[0], time, data) for topic, schema, _e, time, _p, data in raw(out)
             if topic not in ADDED_TOPICS and topic != "/verdict"]  # fmt: skip
    assert found == expected
    again = tmp_path / "again.mcap"
    assert shell("verify", out, "--robot", "ur5", "--bare-flange", "--out", again)[0] in (0, 1, 3)
    assert [e[:2] + e[3:] for e in raw(again)] == [e[:2] + e[3:] for e in raw(out)]


def test_without_the_extra_one_line_says_so(shell: Shell, recording, cell, tmp_path, monkeypatch) -> None:
    real = importlib.util.find_spec
    monkeypatch.setattr(
        "verifier.recordings.foxglove_scene.find_spec",
        lambda name: None if name == "foxglove" else real(name),
    )
    out = tmp_path / "out.mcap"
    assert NOT_INSTALLED in refused(shell("verify", recording, "--cell", cell, "--out", out))
    assert not out.exists()
    assert shell("verify", recording, "--cell", cell)[0] in (0, 1, 3)
    monkeypatch.setitem(sys.modules, "foxglove", None)
    with pytest.raises(SetupError, match=re.escape("stopproof[foxglove]")):
        SceneEncoder()


@pytest.mark.parametrize("where", ["while judging", "while writing"])
def test_ctrl_c_leaves_nothing(shell: Shell, recording, cell, tmp_path, monkeypatch, where: str) -> None:
    def interrupted(*_args: object, **_options: object) -> None:
        raise KeyboardInterrupt

    if where == "while judging":
        monkeypatch.setattr(SceneRecorder, "look", interrupted)
    else:
        monkeypatch.setattr("verifier.recordings.copying._Original.write", interrupted)
    before = sorted(tmp_path.iterdir())
    status, _out, _err = shell("verify", recording, "--cell", cell, "--out", tmp_path / "out.mcap")
    assert status not in (0, 1, 3)
    assert sorted(tmp_path.iterdir()) == before


def test_nothing_is_overwritten_without_force(shell: Shell, recording, cell, tmp_path) -> None:
    out = tmp_path / "out.mcap"
    out.write_text("mine")
    assert "--force" in refused(shell("verify", recording, "--cell", cell, "--out", out))
    assert out.read_text() == "mine"


def test_times_after_2106_are_refused_in_one_line(shell: Shell, tmp_path: Path) -> None:
    with new_spool(tmp_path / "out.mcap") as spool:
        recorder = SceneRecorder(Cell(), spool)
        recorder.begin(0)
        with pytest.raises(SetupError, match="2106"):
            recorder.begin(2**32 * 1_000_000_000)


def test_a_spool_gives_back_what_it_took_and_leaves_no_file(tmp_path: Path, rng: np.random.Generator) -> None:
    topics = [AddedTopic(f"/{n}", "s", "protobuf", b"x", "protobuf") for n in range(3)]
    taken = [(n, topics[n % 3], rng.bytes(n)) for n in range(200)]
    with new_spool(tmp_path / "out.mcap") as spool:
        for time_ns, topic, data in taken:
            spool.add(time_ns, topic, data)
        assert [(time, *added) for time, added in spool.messages()] == taken
        assert list(tmp_path.iterdir()) == []
    with pytest.raises(SetupError, match="cannot be written"), new_spool(tmp_path / "no" / "out.mcap"):
        pass
