"""docs/stops.md against what the command does: its options, its numbers, and what it prints."""

from __future__ import annotations

import re
import shlex
import tomllib
from pathlib import Path

import pytest
from click.testing import CliRunner

from robots.errors import SetupError
from tests.docs.test_schemas import ROOT
from verifier.cell_tables import StopTable
from verifier.commands import cli
from verifier.recordings.motion import FARTHEST, UR_SAFETY_MODES
from verifier.recordings.motion_mcap import (
    BOOL,
    COMMAND_TOPIC,
    FLAG_TOPICS,
    FLOAT,
    SAFETY_MODE,
    SCALING_TOPIC,
)
from verifier.recordings.robot_logs import FLAGS, KINDS, STATES
from verifier.stop_commands import stops
from verifier.stops import finding, fit, speeds
from verifier.stops.finding import Unmeasured

DOC = (ROOT / "docs/stops.md").read_text(encoding="utf-8")
FLAT = " ".join(DOC.split())


def blocks(kind: str) -> list[str]:
    found: list[str] = re.findall(rf"```{kind}\n(.*?)```", DOC, re.DOTALL)
    return found


def words(command: str, data: str = "$DATA") -> list[str]:
    return [word.replace("$DATA", data) for word in shlex.split(command)]


def run(arguments: list[str]) -> list[str]:
    result = CliRunner().invoke(cli, arguments, standalone_mode=False)
    if result.exception is not None:
        raise result.exception
    return str(result.stdout).splitlines()


def test_the_synopsis_has_every_option_and_no_other() -> None:
    (synopsis,) = [each for each in blocks("") if each.startswith("stopproof stops RECORDING")]
    named = set(re.findall(r"--[a-z-]+", synopsis))
    assert named == {option for each in stops.params for option in each.opts if option.startswith("--")}


def test_every_command_is_one_that_there_is() -> None:
    commands = [line for block in blocks("console") for line in block.splitlines()]
    assert len(commands) == 4
    for command in commands:
        first, *others = words(command)
        if first == "python":
            assert others[:2] == ["-m", "bench.maker_stops"]  # tests/verifier/stops/test_maker_tables.py
            continue
        assert (first, others[0]) == ("stopproof", "stops")
        known = {option for each in stops.params for option in each.opts}
        assert {word for word in others if word.startswith("--")} <= known


def test_the_example_prints_what_is_shown(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    (shown,) = [block.splitlines() for block in blocks("text") if block.startswith("stop: ")]
    command = next(line for line in blocks("console")[0].splitlines())
    printed = run(words(command)[1:])
    places = [printed.index(line) for line in shown]
    assert places == sorted(places) and len(shown) == 7


def test_numbers_in_the_text_are_those_of_the_code() -> None:
    for said in (
        f"`--standstill` ({speeds.STANDSTILL_RAD_S:g} rad/s or m/s) for {speeds.REST_S:g} s",
        f"over {1e3 * speeds.SPAN_S:g} ms, or one step if that is more",
        f"has {finding.SLOWER:g} of its largest speed",
        f"speed of the last {finding._BEFORE_EDGE_S:g} s within the last {2.0 * speeds.SPAN_S:g} s",
        f"tells it again within {finding.AGAIN_S:g} s",
        f"Of all delays ({fit._DELAYS + 1} of them are tried)",
        f"`--margin` ({fit.MARGIN:g})",
        f"speeds beyond {FARTHEST:g} are refused",
    ):
        assert said in FLAT, said
    assert finding._STEEP == 0.5 and "it was at half of its largest speed" in FLAT
    assert fit._SLOW == 0.5 and "no more than half of their largest speed" in FLAT
    assert fit.SLOWEST == 5.0 and "joints below five times that tell nothing" in FLAT
    assert {"normal", "reduced", "recovery"}.isdisjoint(UR_SAFETY_MODES.values())


def test_what_is_read_is_what_the_code_reads() -> None:
    table = "\n".join(
        line for line in DOC.splitlines() if line.startswith("| MCAP") or line.startswith("| CSV")
    )
    for name in (COMMAND_TOPIC, SAFETY_MODE, BOOL, FLOAT, *FLAG_TOPICS, SCALING_TOPIC, *STATES):
        assert f"`{name}`" in table, name
    for each in KINDS:
        for column in (each.time, each.q, each.dq, each.command_q, each.command_dq):
            assert not column or f"`{column.format(0)}`" in table
    assert "Robot_ProtectiveStop" in FLAGS


def test_every_reason_why_a_stop_is_not_measured_is_there() -> None:
    (sentence,) = re.findall(r"Not measured, but counted: (.*?)\.", FLAT)
    said = [re.sub(r"^or |^the arm |^it ", "", part) for part in re.split(r",(?: or)? ", sentence)]
    for reason in Unmeasured:
        start = (
            " ".join(reason.split()[2:4]) if reason.startswith("the arm") else " ".join(reason.split()[1:3])
        )
        assert any(start in part for part in said), reason
    assert len(said) == len(Unmeasured)


def test_the_cell_in_the_text_names_keys_that_there_are() -> None:
    (table,) = blocks("toml")
    assert set(tomllib.loads(table)["stop"]) <= set(StopTable.model_fields)


@pytest.mark.real_data
def test_what_a_log_at_one_hertz_can_show(real_data: Path) -> None:
    command = next(line for block in blocks("console") for line in block.splitlines() if "1hz" in line)
    printed = " ".join(run(words(command, str(real_data))[1:]))
    counted = sum(
        1 if number == "once" else int(number.split()[0])
        for number in re.findall(r"not measured: (once|\d+ times)", printed)
    )
    (n,) = re.findall(r"(\d+) stops in 1 recording", printed)
    least, most, unseen = re.findall(r"times to within ([\d.]+) s to ([\d.]+) s; in (\d+) of", printed)[0]
    (delay,) = re.findall(r"goes on for at most ([\d.]+) s", printed)
    assert f"of {int(n) + counted} protective stops {n} are measured" in FLAT
    assert f"to within {least} s to {most} s. In {unseen} of them no sample shows motion" in FLAT
    assert f"full speed for {delay} s" in FLAT and "no sample shows how it brakes" in printed


@pytest.mark.real_data
def test_a_log_in_which_nothing_told_it_to_stop_is_refused(real_data: Path) -> None:
    command = next(line for block in blocks("console") for line in block.splitlines() if "rtde" in line)
    with pytest.raises(SetupError, match=r"has no stop that can be measured .*safety_mode, speed_scaling"):
        run(words(command, str(real_data))[1:])
