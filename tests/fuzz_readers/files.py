"""Small valid files of every kind, and what reads them."""

from __future__ import annotations

import io
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from random import Random

import numpy as np
from mcap.writer import CompressionType, Writer

from tests.fuzz_readers import checks
from tests.fuzz_readers.mutate import broken_bytes, broken_text, invented
from tests.verifier.recordings import test_bvh, test_c3d_file
from tests.verifier.recordings.bags import WRITERS, all_items
from tests.verifier.recordings.robot_sources import test_robot_logs as robot_logs
from tests.verifier.recordings.samples import joint_states, reports, write_all
from verifier.cell import Cell
from verifier.cell_template import BLANK, template
from verifier.joint_limits_file import read_joint_limits
from verifier.recordings import Recording, bvh, c3d_file, csv_table, inspect_recording, npz
from verifier.recordings.containers import open_container
from verifier.recordings.mcap_file import McapFile
from verifier.recordings.motion_table import read_joint_csv, read_joint_npz

Files = Mapping[str, bytes]
"""Name in a folder -> content."""
INVENTED = 0.1
"""Share of inputs that are no broken file, but invented."""
INSPECTED = 0.1
"""Share of containers and tables that `inspect` looks at too."""
NANO = 1_000_000_000
JOINT_LIMITS = b"""joint_limits:
  elbow_joint: {has_velocity_limits: true, max_velocity: 3.14, has_jerk_limits: false}
  slide:
    has_position_limits: true
    min_position: -1.0
    max_position: 1
    has_jerk_limits: false
    max_jerk: 1000.0
"""


@dataclass(frozen=True)
class FileReader:
    """Reads files, one of which is broken in each input.

    Attributes
    ----------
    name, seeds:
        What it is called, and valid files.
    opened:
        Name of what is opened, for each of ``seeds``.
    broken:
        How a file is made wrong.
    read:
        Reads, and checks what it has read.
    """

    name: str
    seeds: Sequence[Files]
    opened: Sequence[str]
    broken: Callable[[bytes, Random], bytes]
    read: Callable[[Path], None]
    inspected: bool = False
    weight: int = 1

    def attempt(self, rnd: Random, folder: Path) -> None:
        """Write one broken input and read it."""
        number = rnd.randrange(len(self.seeds))
        files, opened = dict(self.seeds[number]), folder / self.opened[number]
        name = rnd.choice(sorted(files))
        files[name] = (invented if rnd.random() < INVENTED else self.broken)(files[name], rnd)
        for each, content in files.items():
            (folder / each).parent.mkdir(exist_ok=True)
            (folder / each).write_bytes(content)
        (inspect_recording if self.inspected and rnd.random() < INSPECTED else self.read)(opened)

    def valid(self, folder: Path) -> None:
        """Read the files as they are."""
        for files, name in zip(self.seeds, self.opened, strict=True):
            for each, content in files.items():
                (folder / each).parent.mkdir(exist_ok=True)
                (folder / each).write_bytes(content)
            self.read(folder / name)


def file_readers() -> Iterator[FileReader]:
    """Yield the readers of files."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        yield from _recordings(folder)
        yield from _tables(folder)
        cell = template("ur5").replace(f'"{BLANK}"', '"tool.toml"').replace(BLANK, "0.05").encode()
        yield _one("cell", "cell.toml", [_without_comments(cell)], broken_text, _cell)
        yield _one("joint limits", "joint_limits.yaml", [JOINT_LIMITS], broken_text, _joint_limits)


def _recordings(folder: Path) -> Iterator[FileReader]:
    states, people = joint_states(20.0, 0.5), reports(10.0, 0.5)
    ours = write_all(folder / "ours.mcap", [*states, *people])
    plain = [_rewritten(ours, lambda data: data), ours.read_bytes()]
    yield _one("own recording", "a.mcap", plain, broken_bytes, _recording, inspected=True)
    yield FileReader(
        "messages of an own recording", [{"a.mcap": plain[0]}], ["a.mcap"], _broken_messages, _recording
    )
    items = all_items(states, people)
    for kind in ("ros1", "ros2 sqlite", "ros2 mcap", "mcap"):
        name, write = WRITERS[kind]
        (folder / kind).mkdir()
        path = write(folder / kind / name, items)
        files = {f"{name}/{each.name}": each.read_bytes() for each in path.iterdir()} if path.is_dir() else {
            name: path.read_bytes()
        }  # fmt: skip
        yield FileReader(kind, [files], [name], broken_bytes, _container, inspected=True)


def _tables(folder: Path) -> Iterator[FileReader]:
    rng = np.random.default_rng(1)
    names, lines, _t, _tables = robot_logs.rtde(rng, rows=12)
    log = robot_logs.write(folder / "rtde.csv", names, lines).read_bytes()
    libfranka = robot_logs.libfranka(rng, rows=8)[0].encode()
    rows = [f"{0.01 * k:.2f},{np.sin(k)},0.5,{np.sin(k)}" for k in range(12)]
    own = "\n".join(["t,shoulder,elbow,shoulder_command", *rows]).encode()
    logs = [log, log.replace(b" ", b","), libfranka, own]
    yield _one("joint CSV", "a.csv", logs, broken_text, _joint_csv, inspected=True)
    header = "t,person,head_x,head_y,head_z,r_wrist_x,r_wrist_y,r_wrist_z"
    places = [f"{0.1 * k:.1f},p{k % 2},1,{k},1.6,0.5,{k},1" for k in range(10)]
    yield _one("people CSV", "p.csv", ["\n".join([header, *places]).encode()], broken_text, _people_csv)
    yield _one("BVH", "a.bvh", [test_bvh.whole(test_bvh.ZERO, test_bvh.BENT).encode()], broken_text, _bvh)
    xyz = 1e3 * test_c3d_file.walk(rng, frames=6)
    yield _one("C3D", "a.c3d", [test_c3d_file.write(folder, xyz).read_bytes()], broken_bytes, _c3d)
    t = np.arange(0.0, 0.1, 0.01)
    joints = _npz(t=t, q=rng.normal(size=(10, 2)), joints=np.array(["a", "b"]), q_command=np.zeros((10, 2)))
    points = _npz(t=t, joints=np.array(["head", "pelvis"]), xyz=rng.normal(size=(10, 2, 3)))
    yield _one("joint NPZ", "a.npz", [joints], broken_bytes, _joint_npz)
    yield _one("people NPZ", "p.npz", [points], broken_bytes, _people_npz)


def _one(
    name: str,
    file: str,
    contents: Sequence[bytes],
    broken: Callable[[bytes, Random], bytes],
    read: Callable[[Path], None],
    inspected: bool = False,
) -> FileReader:
    return FileReader(
        name, [{file: content} for content in contents], [file] * len(contents), broken, read, inspected
    )


def _npz(**arrays: np.ndarray) -> bytes:
    out = io.BytesIO()
    np.savez(out, **arrays)
    return out.getvalue()


def _without_comments(cell: bytes) -> bytes:
    """A template with every key switched on, so that all of them are broken once."""
    lines = [line.removeprefix("# ") for line in cell.decode().splitlines()]
    kept = [line for line in lines if not line.startswith(("urdf", "measured"))]
    return "\n".join(line.split("  #")[0] for line in kept if "=" in line or line.startswith("[")).encode()


def _rewritten(path: Path, change: Callable[[bytes], bytes]) -> bytes:
    """A recording whose messages go through ``change``, without compression and checksums."""
    file, out = McapFile(path), io.BytesIO()
    writer = Writer(out, compression=CompressionType.NONE, enable_crcs=False, enable_data_crcs=False)
    writer.start()
    channels: dict[int, int] = {}
    for message in file.messages():
        number = message.channel.id
        if number not in channels:
            schema = file.schemas[message.channel.schema_id]
            made = writer.register_schema(schema.name, schema.encoding, schema.data)
            channels[number] = writer.register_channel(
                message.channel.topic, message.channel.message_encoding, made
            )
        writer.add_message(channels[number], message.log_time, change(message.data), message.log_time)
    writer.finish()
    return out.getvalue()


def _broken_messages(data: bytes, rnd: Random) -> bytes:
    """A recording that is whole, with messages that are not."""
    with tempfile.TemporaryDirectory() as name:
        path = Path(name) / "a.mcap"
        path.write_bytes(data)
        share = rnd.choice((0.05, 0.2, 1.0))

        def change(message: bytes) -> bytes:
            if rnd.random() > share:
                return message
            return (broken_text if message[:1] == b"{" else broken_bytes)(message, rnd)

        return _rewritten(path, change)


def _recording(path: Path) -> None:
    checks.recording(Recording(path))


def _container(path: Path) -> None:
    container = open_container(path)
    if container.damage is None:
        for message in container.messages({topic.name for topic in container.topics}):
            checks.need(message.log_time_ns >= 0, "a time before 1970")
    checks.recording(Recording(path))


def _joint_csv(path: Path) -> None:
    checks.joint_table(read_joint_csv(path))


def _people_csv(path: Path) -> None:
    checks.people_table(csv_table.read_people(path))


def _bvh(path: Path) -> None:
    checks.people_table(bvh.read_people(path))


def _c3d(path: Path) -> None:
    checks.people_table(c3d_file.read_people(path))


def _joint_npz(path: Path) -> None:
    checks.joint_table(read_joint_npz(path, None))


def _people_npz(path: Path) -> None:
    checks.people_table(npz.read_people(path))


def _cell(path: Path) -> None:
    checks.finite(Cell.from_toml(path).model_dump())


def _joint_limits(path: Path) -> None:
    rows = read_joint_limits(path)
    checks.finite({name: dict(row) for name, row in rows.items()})
