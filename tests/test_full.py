"""The page of all randomised counts: a row for each group, and for files that were run by themselves."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests import adversary, full
from tests.soundness import test_adversary
from tests.soundness.adversary import Total
from tests.soundness.adversary_arm import ROBOTS


def rows(page: Path) -> list[str]:
    found = [
        line.split("|")[1].strip()
        for line in page.read_text(encoding="utf-8").splitlines()
        if "| 0 |" in line
    ]
    return found


def test_rows_of_files_follow_their_group_and_go_when_it_is_run_again(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    for name in (
        "everything else",
        "occupancy",
        "occupancy/test_b.py",
        "soundness",
        "occupancy/test_a.py",
        "test_c.py",
    ):
        full._write(name, f"| {name} | 3 passed | 0 |", ["1.00s call x"], page)
    files = ["occupancy/test_a.py", "occupancy/test_b.py"]
    assert rows(page) == ["soundness", "occupancy", *files, "everything else", "test_c.py"]
    assert page.read_text(encoding="utf-8").count("The longest tests of") == 3
    full._write("occupancy", "| occupancy | 4 passed | 0 |", ["2.00s call y"], page)
    assert rows(page) == ["soundness", "occupancy", "everything else", "test_c.py"]
    full._write("everything else", "| everything else | 4 passed | 0 |", [], page)
    assert rows(page) == ["soundness", "occupancy", "everything else"]
    text = page.read_text(encoding="utf-8")
    assert "2.00s call y" in text and text.count("1.00s call x") == 1


@pytest.mark.parametrize(
    "given", [["--file", "occupancy/test_none.py"], ["--only", "nothing"], ["--seed", "-1"]]
)
def test_what_is_not_there_is_refused(given: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as stop:
        full.main(given)
    assert stop.value.code == 2 and "error: " in capsys.readouterr().err


def test_what_is_left_to_the_adversary_is_there_and_has_as_many_cycles() -> None:
    file, name = full.ELSEWHERE.split("::")
    assert (full.ROOT / file).is_file() and hasattr(test_adversary, name)
    assert adversary.CYCLES_IN_ALL == test_adversary.CYCLES_IN_ALL >= 10_000_000


ALL = str(adversary.CYCLES_IN_ALL)


@pytest.mark.parametrize(
    ("given", "written"),
    [
        (["--cycles", ALL], "page"),
        (["--cycles", "20000"], ""),
        (["--cycles", ALL, "--robot", ROBOTS[0]], ""),
        (["--cycles", "20000", "--out", "other"], "other"),
    ],
)
def test_only_a_whole_run_of_the_adversary_takes_the_place_of_its_page(
    given: list[str], written: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    total = Total(runs=1, cycles=1, nearest=[0.01])
    monkeypatch.setattr(adversary, "_all_runs", lambda robots, *_: dict.fromkeys(robots, total))
    monkeypatch.setattr(adversary, "ROOT", tmp_path)
    monkeypatch.setattr(adversary, "PAGE", tmp_path / "page")
    monkeypatch.chdir(tmp_path)
    adversary.main(given)
    assert [path.name for path in tmp_path.iterdir()] == ([written] if written else [])
