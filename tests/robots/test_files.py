"""Files that set-up reads: whole, or refused in one line; a device without an end too."""

from __future__ import annotations

from pathlib import Path

import pytest

from robots.errors import SetupError
from robots.files import LARGEST_TEXT, read_bytes, read_toml
from verifier.cell import Cell

ENDLESS = Path("/dev/zero")


@pytest.mark.parametrize("size", [0, 1, 9, 10])
def test_a_file_that_is_small_enough_is_read_whole(tmp_path: Path, size: int) -> None:
    (tmp_path / "a").write_bytes(b"x" * size)
    assert read_bytes(tmp_path / "a", 10) == b"x" * size


@pytest.mark.parametrize("size", [11, 3_000_000])
def test_a_larger_one_is_refused(tmp_path: Path, size: int) -> None:
    (tmp_path / "a").write_bytes(b"x" * size)
    with pytest.raises(SetupError, match=r"/a: larger than .* MiB, or without an end"):
        read_bytes(tmp_path / "a", 10)


@pytest.mark.parametrize("read", [read_toml, Cell.from_toml])
def test_one_without_an_end_is_refused(read: object) -> None:
    assert LARGEST_TEXT == 16 * 2**20
    with pytest.raises(SetupError, match=r"/dev/zero: larger than 16 MiB, or without an end"):
        read(ENDLESS)


@pytest.mark.parametrize("name", ["", "none", "\0"])
def test_what_is_no_file_is_told_in_one_line(tmp_path: Path, name: str) -> None:
    for read in (read_bytes, read_toml, Cell.from_toml):
        with pytest.raises(SetupError, match=r"cannot be read \(|: does not exist$") as refusal:
            read(tmp_path / name)
        assert "\n" not in str(refusal.value) and "\0" not in str(refusal.value)
