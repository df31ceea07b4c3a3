"""Files that commands write: never an input or one another, refused before any work, whole or not there."""

from __future__ import annotations

import errno
import json
import os
import signal
from pathlib import Path
from typing import Any

import pytest

from robots.catalog import describe_card
from tests.verifier.shell import Shell, refused

URDF = (
    '<robot name="rail"><link name="base"/><link name="l1"/><joint name="j1" type="revolute">'
    '<parent link="base"/><child link="l1"/><axis xyz="0 0 1"/></joint></robot>'
)


@pytest.fixture(autouse=True)
def nothing_is_verified(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever is refused here must be refused before the work begins."""

    def work(*_arguments: object, **_options: object) -> None:
        pytest.fail("the work has begun")

    for name in (
        "judging_commands.verify_recording",
        "recording_commands.inspect_recording",
        "recording_commands.import_recording",
        "robots_command.describe_card",
    ):
        monkeypatch.setattr(f"verifier.{name}", work)


@pytest.fixture
def folder(tmp_path: Path, recording: Path, cell: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Inputs of every kind, as the current folder."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "tool.toml").write_text("name = 'gripper'")
    (tmp_path / "arm.urdf").write_text(URDF)
    (tmp_path / "joints.csv").write_text("t,j1\n0.0,0.0\n0.01,0.001\n0.02,0.002\n")
    (tmp_path / "people.csv").write_text("t,person,head_x,head_y,head_z\n")
    (tmp_path / "with_files.toml").write_text("[robot]\nurdf = 'arm.urdf'\ntool = 'tool.toml'\n")
    (tmp_path / "link").symlink_to("r.mcap")
    os.link(recording, tmp_path / "hard")
    os.mkfifo(tmp_path / "fifo")
    (tmp_path / "loop").symlink_to("loop")
    (tmp_path / "empty").mkdir()
    (tmp_path / "bag").mkdir()
    for name in ("metadata.yaml", "bag_0.db3"):
        (tmp_path / "bag" / name).write_text("x")
    return tmp_path


IMPORT = "import {} --robot arm.urdf --joints joints.csv --people people.csv"


@pytest.mark.parametrize("force", [[], ["--force"]], ids=["", "forced"])
@pytest.mark.parametrize(
    ("command", "told"),
    [
        ("verify r.mcap --json r.mcap", "is the recording itself"),
        ("verify r.mcap --json ./empty/../r.mcap", "is the recording itself"),
        ("verify r.mcap --json link", "is the recording itself"),
        ("verify r.mcap --json hard", "is the recording itself"),
        ("verify link --picture r.mcap", "is the recording itself"),
        ("verify r.mcap --out r.mcap", "is the recording itself"),
        ("verify r.mcap --cell cell.toml --picture cell.toml", "is the cell itself"),
        ("verify r.mcap --tool tool.toml --json tool.toml", "is the tool file itself"),
        ("verify r.mcap --robot ./arm.urdf --json arm.urdf", "is the URDF itself"),
        ("verify r.mcap --cell with_files.toml --json tool.toml", "is the tool file itself"),
        ("verify r.mcap --cell with_files.toml --json arm.urdf", "is the URDF itself"),
        ("verify bag --json bag/metadata.yaml", "is a part of the recording"),
        ("verify ./bag/ --json bag/bag_0.db3", "is a part of the recording"),
        ("verify bag --out bag/../bag/x.mcap", "is a part of the recording"),
        ("verify bag/bag_0.db3 --json bag/metadata.yaml", "is a part of the recording"),
        ("import bag/x.mcap --robot arm.urdf --joints bag", "is a part of the --joints file"),
        ("verify r.mcap --json same --picture ./same", "--json names the same file"),
        ("verify r.mcap --picture same --out same", "--picture names the same file"),
        ("inspect r.mcap --json r.mcap", "is the recording itself"),
        ("init r.mcap --out r.mcap", "is the recording itself"),
        ("robots ./arm.urdf --json arm.urdf", "is the URDF itself"),
        (IMPORT.format("joints.csv"), "is the --joints file itself"),
        (IMPORT.format("./people.csv"), "is the --people file itself"),
        (IMPORT.format("arm.urdf"), "is the URDF itself"),
        ("verify r.mcap --json fifo", "no regular file"),
        ("verify r.mcap --picture fifo", "no regular file"),
        (IMPORT.format("fifo"), "no regular file"),
        ("init --robot ur5 --out fifo", "no regular file"),
        ("verify r.mcap --json /dev/null", "no regular file"),
        ("verify r.mcap --json /dev/stdout", "no regular file"),
        ("verify r.mcap --json empty", "is a folder"),
        ("verify r.mcap --json .", "is a folder"),
        ("verify r.mcap --json loop", "cannot be written"),
        ("verify r.mcap --json nowhere/x.json", "its folder does not exist; make it first"),
        ("verify r.mcap --json cell.toml/x.json", "cannot be written: Not a directory"),
        ("inspect r.mcap --json nowhere/x.json", "its folder does not exist"),
        (IMPORT.format("nowhere/x.mcap"), "its folder does not exist"),
        (f"verify r.mcap --out {'x' * 300}", "File name too long"),
        ("verify r.mcap --picture -", "--picture -: cannot go to standard output; name a file"),
        ("verify r.mcap --out -", "--out -: cannot go to standard output; name a file"),
        ("init --robot ur5 --out -", "--out -: cannot go to standard output; name a file"),
        (IMPORT.format("-"), "OUT -: cannot go to standard output; name a file"),
        ("verify r.mcap --json=", "--json '': the name is empty; name a file, or - for standard output"),
        ("verify r.mcap --picture=", "--picture '': the name is empty; name a file"),
        ("demo --out cell.toml", "is not a folder"),
        ("demo --out=", "is not a folder"),
    ],
)
def test_what_must_not_be_written_is_refused(
    shell: Shell, folder: Path, command: str, told: str, force: list[str]
) -> None:
    before = {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    assert told in refused(shell(*command.split(), *force))
    assert {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()} == before


@pytest.mark.parametrize(
    "command",
    [
        "verify r.mcap --json cell.toml",
        "inspect r.mcap --json cell.toml",
        "init r.mcap --out cell.toml",
        IMPORT.format("cell.toml"),
        "robots ur5 --json cell.toml",
        "demo --out .",
    ],
)
def test_what_is_there_is_refused_before_the_work(shell: Shell, folder: Path, command: str) -> None:
    (folder / "demo.png").write_text("mine")
    assert "exists already" in refused(shell(*command.split()))


def test_a_folder_that_cannot_be_written_to_is_found_before_the_work(
    shell: Shell, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def read_only(path: Path, *_arguments: object, **_options: object) -> None:
        raise OSError(errno.EROFS, os.strerror(errno.EROFS), str(path))

    monkeypatch.setattr(Path, "open", read_only)
    assert "x.json: cannot be written: Read-only file system" in refused(
        shell("verify", "r.mcap", "--json", "x.json")
    )


def test_a_picture_that_cannot_be_drawn_is_refused_before_the_work(
    shell: Shell, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("verifier.reports.picture.find_spec", lambda _name: None)
    text = "pictures need matplotlib"
    assert text in refused(shell("verify", "r.mcap", "--picture", "x.png"))
    assert text in refused(shell("demo", "--out", "new"))


def test_a_name_of_the_catalogue_is_no_file(shell: Shell, folder: Path, monkeypatch: Any) -> None:
    monkeypatch.setattr("verifier.robots_command.describe_card", describe_card)
    assert shell("robots", "ur5", "--json", "ur5")[0] == 0
    assert json.loads((folder / "ur5").read_text())["name"] == "ur5"


def test_a_stop_by_a_signal_leaves_no_half_file(shell: Shell, folder: Path, monkeypatch: Any) -> None:
    def stopped(_value: object, stream: Any, **_options: object) -> None:
        stream.write("[")
        assert list(folder.glob(".*.partial"))
        os.kill(os.getpid(), signal.SIGTERM)

    monkeypatch.setattr("verifier.output.json.dump", stopped)
    assert shell("robots", "--json", "r.json") == (143, "", "stopproof: stopped by SIGTERM\n")
    assert not list(folder.glob("*r.json*")) and not list(folder.glob(".*"))


def test_a_full_disk_is_named_with_the_file(shell: Shell, folder: Path, monkeypatch: Any) -> None:
    def full(_value: object, _stream: object, **_options: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr("verifier.output.json.dump", full)
    text = refused(shell("robots", "--json", "r.json"))
    assert text == "stopproof: r.json: cannot be written: No space left on device\n"
    assert not list(folder.glob("*r.json*")) and not list(folder.glob(".*"))


def test_a_link_stays_one_and_its_file_is_written(shell: Shell, folder: Path) -> None:
    (folder / "target.json").write_text("old")
    (folder / "pointer.json").symlink_to("target.json")
    assert shell("robots", "--json", "pointer.json", "--force")[0] == 0
    assert (folder / "pointer.json").is_symlink()
    assert "ur5" in json.loads((folder / "target.json").read_text())
