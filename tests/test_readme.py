"""What the README shows is run as it stands there."""

from __future__ import annotations

import ast
import re
import shlex
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from tests.verifier.shell import Shell, shell

__all__ = ["shell"]

ROOT = Path(__file__).parent.parent
README = (ROOT / "README.md").read_text(encoding="utf-8")


def blocks(language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", README, flags=re.DOTALL)


def commands() -> list[str]:
    lines = [line for block in blocks("console") for line in block.splitlines()]
    return [line for line in lines if line.startswith("stopproof ")]


def run(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(arguments, cwd=ROOT, capture_output=True, text=True, timeout=300, check=False)


def elsewhere(arguments: list[str], folder: Path) -> list[str]:
    """A page goes to a folder of the test, and its searches may take little time; all else stands."""
    if arguments[0] != "stop-report":
        return arguments
    place = arguments.index("--out") + 1
    page = str(folder / arguments[place])
    return [*arguments[:place], page, *arguments[place + 1 :], "--deadline", "0.05"]


@pytest.mark.parametrize("command", commands())
def test_command_runs(command: str, tmp_path: Path, shell: Shell, monkeypatch: pytest.MonkeyPatch) -> None:
    """In this process, which has loaded everything; as a process of its own one of them is run below."""
    monkeypatch.chdir(ROOT)
    _program, *arguments = shlex.split(command)
    arguments = elsewhere(arguments, tmp_path)
    status, out, err = shell(*arguments)
    assert status in ((0, 1) if arguments[0] in ("verify", "replay") else (0,)), err
    assert out
    assert not err
    written = [tmp_path / Path(each).name for each in arguments if each.endswith(".html")]
    assert all(each.stat().st_size > 50_000 for each in written)


def test_a_command_runs_as_a_process() -> None:
    result = run(sys.executable, "-m", "verifier", *shlex.split(commands()[0])[1:])
    assert (result.returncode, result.stderr) == (0, "") and result.stdout


def test_python_example_runs() -> None:
    (example,) = blocks("python")
    result = run(sys.executable, "-c", example)
    assert result.returncode == 0, result.stderr
    first, *rest = result.stdout.splitlines()
    assert re.fullmatch(r"verified in the model: \d+ of \d+ cycles", first)
    assert any(line.startswith("contradicted: A1 people") for line in rest)
    assert any("shrink" in line for line in rest)


def test_make_targets_exist() -> None:
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    for target in re.findall(r"`make ([a-z-]+)`", README):
        assert re.search(rf"^{target}:", makefile, flags=re.MULTILINE), target


def test_linked_files_exist() -> None:
    for link in re.findall(r"\]\(([^)#]+)\)", README):
        assert (ROOT / link).exists(), link


def test_every_dependency_is_in_the_table() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    table = README[README.index("## Dependencies") :]
    for requirement in project["dependencies"]:
        name = re.split(r"[<>=!~ ]", requirement)[0]
        assert name in table, name


def test_imports_of_the_example_are_public() -> None:
    import verifier

    (example,) = blocks("python")
    for node in ast.walk(ast.parse(example)):
        if isinstance(node, ast.ImportFrom) and node.module == "verifier":
            assert {alias.name for alias in node.names} <= set(verifier.__all__)
