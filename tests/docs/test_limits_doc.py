"""docs/limits.md and its schema against what the command and the functions do."""

import re
import shlex
from collections.abc import Callable
from pathlib import Path

import pytest

from robots.assumption import Certainty
from tests.docs.test_schemas import ROOT, faults, run
from tests.verifier.scenes import Scene, person_at
from tests.verifier.test_required_distance import allowances, curtain, floor, metres, seconds, speed
from verifier import Cell
from verifier.barriers import CORNERS
from verifier.commands import cli
from verifier.limits import ANSWERS, DEFAULT_DETECTION_S, LimitsSettings, find_limits
from verifier.program_segments import REST_S, STILL
from verifier.required_distance import (
    Times,
    constant_lengths,
    declared,
    protective_separation,
    separation_2024,
    unmonitored_person,
)

DOC = (ROOT / "docs/limits.md").read_text(encoding="utf-8")
CELL = '[robot]\nbare_flange = true\naccept_assumed = ["limits"]\n'
SHORT = ("--fastest", 0.5, "--latency-bound", 0.01, "--farthest", 1.5, "--to", 0.3)


def near(_t: float):
    return person_at(0.5, 0.0)


@pytest.mark.parametrize(
    ("people", "options", "expected"),
    [
        ({"p": lambda _t: person_at(3.0, 0.0)}, SHORT, 0),
        ({"p": near}, (*SHORT, "--line", 30, "--barrier", "fence"), 1),
        ({"p": near}, ("--only", "separation"), 0),
        ({"p": near}, ("--only", "latency", "--from", 0.3, "--latency-bound", 0.01), 1),
    ],
)
def test_the_command_prints_what_the_schema_says(
    tmp_path: Path, people: dict, options: tuple[object, ...], expected: int
) -> None:
    (tmp_path / "cell.toml").write_text(CELL, encoding="utf-8")
    path = Scene(duration=0.4, people=people).write(tmp_path / "r.mcap")
    status, printed = run("limits", path, "--cell", tmp_path / "cell.toml", *options)
    assert not faults("limits", printed)
    assert status == expected
    for key in printed:
        assert faults("limits", {name: value for name, value in printed.items() if name != key}), key
    assert faults("limits", {**printed, "grade": 1})


def test_the_text_shows_what_the_command_prints(count: Callable[[int], int]) -> None:
    """At small counts the last segment, and latency and line around the cycle that fails beyond."""
    shown = [line.strip() for line in re.findall(r"```\n(path speed.*?)```", DOC, re.DOTALL)[0].splitlines()]
    assert len(shown) == 6
    cases = [
        (LimitsSettings(("speed",), (6.95, 8.0)), shown[:1] + shown[3:4]),
        (LimitsSettings(("latency",), (7.98, 8.0)), shown[4:5]),
        (LimitsSettings(("line",), (1.32, 1.34)), shown[5:6]),
    ]
    if count(100) > 10:
        cases = [(LimitsSettings(("speed", "latency", "line"), (0.0, 8.0)), shown)]
    for settings, lines in cases:
        report = find_limits(ROOT / "data/demo.mcap", Cell.from_toml(ROOT / "data/demo.toml"), settings)
        printed = [line.strip() for line in report.lines_of_text()]
        if len(lines) == 1:  # a part of the stretch has fewer cycles
            lines, printed = ([re.sub(r"\(\d+ cycles\)", "", line) for line in of] for of in (lines, printed))
        assert [line for line in lines if line not in printed] == []


def test_commands_and_options_are_there() -> None:
    (command,) = re.findall(r"```console\n(.+)\n```", DOC)
    first, name, *words = shlex.split(command)
    known = {option for each in cli.commands[name].params for option in each.opts}
    assert (first, name) == ("stopproof", "limits")
    named = {word for word in words if word.startswith("--")} | set(re.findall(r"`(--[a-z-]+)", DOC))
    assert named <= known
    own = {option for option in known if option not in {"--json", "--force", "--cell"}}
    others = {each.opts[0] for each in cli.commands["replay"].params}
    assert own - others <= named, "an option that the page does not name"


def test_the_example_runs(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    (example,) = re.findall(r"```python\n(.*?)```", DOC, re.DOTALL)
    exec(compile(example, "docs/limits.md", "exec"), {})
    first, second = capsys.readouterr().out.splitlines()
    assert re.fullmatch(r"latency: verified at 0\.\d+ s, not verified at 0\.\d+ s", first)
    assert second == "S = 0.608 m (ISO 13855:2010, unverified)"  # 600 + 128 > 500: 480 + 128 mm


def test_numbers_in_the_text_are_those_of_the_code() -> None:
    settings = LimitsSettings()
    for answer in ANSWERS:
        assert f"| `{answer}` |" in DOC or answer == "separation"
    assert f"0 to `--fastest` ({settings.fastest:g}) in steps of 1/64" in DOC
    assert f"0 to `--latency-bound` ({settings.latency_bound_s:g} s) in steps of 1 ms" in DOC
    assert f"`--farthest` ({settings.farthest_m:g} m) down to 0.1 m in steps of 10 mm" in DOC
    assert f"than {100 * STILL:g} % of its largest velocity for {REST_S:g} s" in DOC
    assert f"polygon of {CORNERS} corners" in DOC
    assert f"`--detection-time`\n({DEFAULT_DETECTION_S:g} s," in DOC


def test_the_table_of_formulas_is_that_of_the_code() -> None:
    zero = metres("Z", 0.0)
    times = Times(declared("T_r", 0.1, "s"), declared("T_s", 0.1, "s"))
    lengths = constant_lengths(times, unmonitored_person(), speed("v_r", 1.0), zero)
    found = {
        "normal_approach": curtain(100, 14),
        "parallel_approach": floor(100, 300),
        "separation_2024": separation_2024(seconds(0.1), speed("K", 1.6), zero, zero),
        "protective_separation": protective_separation(lengths, allowances(0.0, 0.0, 0.0)),
    }
    rows = re.findall(r"^\| `(\w+)` \| (S[^|]+) \| (ISO[^|]+) \| (\w+)", DOC, re.MULTILINE)
    assert len(rows) == len(found)
    for name, formula, edition, certainty in rows:
        assert str(found[name].formula.value).startswith(formula)
        assert found[name].edition == edition
        assert found[name].formula.certainty is Certainty(certainty)
