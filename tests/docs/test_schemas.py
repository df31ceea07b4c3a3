"""The JSON of the command line against the published schemas."""

import copy
import json
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest
from click.testing import CliRunner

from tests.verifier.scenes import Scene, at_rest, far, person_at
from tests.verifier.test_contact_criterion import LINKS, NARROW, reaching, slow
from verifier.commands import cli
from verifier.verdict import STATUS_OF_REASON, CriterionKind, Reason, Status

ROOT = Path(__file__).resolve().parents[2]
NAMES = (
    "verify",
    "inspect",
    "robots",
    "simulate",
    "limits",
    "scenario-contact",
    "scenario-proactive",
    "scenario-speed-alteration",
    "diff",
    "diff-stop-report",
    "stops",
    "stop-report",
)
CELL = '[robot]\nbare_flange = true\naccept_assumed = ["limits"]\n'
COUNTS = ("not_checked", "not_verified", "verified", "contradicted")

Json = dict[str, Any]


@cache
def schema(name: str) -> Json:
    text = (ROOT / f"docs/{name}.schema.json").read_text(encoding="utf-8")
    loaded: Json = json.loads(text)
    return loaded


def faults(name: str, value: Any) -> list[str]:
    validator = jsonschema.Draft202012Validator(schema(name))
    return [
        f"{'.'.join(map(str, error.path))}: {error.message[:200]}" for error in validator.iter_errors(value)
    ]


def run(*arguments: object) -> tuple[int, Json]:
    """Run the command line in this process; return exit status and what it printed."""
    result = CliRunner().invoke(cli, [*map(str, arguments), "--json", "-"], standalone_mode=False)
    if result.exception is not None:
        raise result.exception
    printed: Json = json.loads(result.stdout)
    return int(result.return_value), printed


def frozen(t: float) -> np.ndarray:
    """Readable once a second, otherwise without any coordinates."""
    return person_at(5.0 + 1e-6 * t, 0.0) if t % 1.0 < 0.05 else np.full((20, 3), np.nan)


def nowhere(_t: float) -> np.ndarray:
    return np.full((20, 3), np.inf)


def near(t: float) -> np.ndarray:
    return person_at(0.6, 0.0) if t > 0.5 else person_at(4.0, 0.0)


WALL = """[workspace.fixtures.wall]
kind = "box"
xyz_m = [0.6, 0.0, 0.3]
size_m = [0.1, 2.0, 2.0]
position_error_m = 0.01
"""
SELF = "[criteria]\nself_collision = true\n"
CONTACT = f"""{CELL}
[robot.tracking]
velocity_error_rad_s = 0.001
[people]
latency_s = 0.03
repeated_points = "measured"
[workspace]
floor_z_m = -0.8
[criteria]
gaps_by_design = {NARROW}
[[criteria.contact]]
links = {LINKS}
parts = ["r_hand", "r_forearm", "r_upper_arm", "l_hand"]
person_speed = "neglected"
"""
CASES: dict[str, tuple[Scene, str, tuple[str, ...], int]] = {
    "all verified": (Scene(duration=1.0), CELL, (), 0),
    "at rest": (Scene(duration=1.0, motion=at_rest), CELL, (), 0),
    "nothing checked": (Scene(duration=1.0), f"{CELL}[people]\nlatency_s = 5\n", (), 1),
    "nobody assumed": (Scene(duration=1.0), CELL, ("--assume-nobody",), 3),
    "nobody reported": (Scene(duration=1.0, people={}, complete=True), CELL, (), 0),
    "jumps": (Scene(people={"p1": near, "p2": far}), CELL, (), 1),
    "points missing": (Scene(people={"p1": frozen}), CELL, (), 0),
    "nothing readable of one": (Scene(duration=1.0, people={"p1": nowhere, "p2": far}), CELL, (), 1),
    "reports pause": (Scene(people_rate=2.0), f"{CELL}[people]\nmax_report_gap_s = 0.3\n", (), 1),
    "beside a wall": (Scene(duration=0.5), f"{CELL}{WALL}", (), 1),
    "wall far away": (Scene(duration=0.5), f"{CELL}{WALL.replace('0.6', '3.0')}{SELF}", (), 0),
    "slow contact": (Scene(duration=0.5, motion=slow, people={"p1": reaching}), CONTACT, (), 3),
    "off the path": (Scene(duration=1.0), f"{CELL}[robot.tracking]\nposition_error_rad = 0.0\n", (), 1),
}


@pytest.fixture(scope="module", params=["demo", *CASES])
def verified(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[str, Json]:
    """Name of a case and what ``verify --json -`` prints for it."""
    name = str(request.param)
    if name == "demo":
        return name, run("verify", ROOT / "data/demo.mcap", "--cell", ROOT / "data/demo.toml")[1]
    scene, cell, options, expected = CASES[name]
    folder = tmp_path_factory.mktemp("case")
    (folder / "cell.toml").write_text(cell, encoding="utf-8")
    recording = scene.write(folder / "recording.mcap")
    status, printed = run("verify", recording, "--cell", folder / "cell.toml", *options)
    assert status == expected, printed["reasons"]
    return name, printed


def test_verify_prints_what_the_schema_says(verified):
    assert not faults("verify", verified[1])


def test_numbers_of_cycles_add_up(verified):
    _, printed = verified
    rows = printed["per_cycle"]
    assert {len(row) for row in rows.values()} == {printed["cycles"]}
    assert sum(printed[name] for name in COUNTS) == printed["cycles"] > 0
    assert [rows["status"].count(number) for number in range(4)] == [printed[name] for name in COUNTS]
    assert {name: sum(of.values()) for name, of in printed["reasons"].items()} == {
        name: printed[name] for name in COUNTS
    }


def test_times_are_those_of_cycles(verified):
    _, printed = verified
    t = np.array(printed["per_cycle"]["t"])
    cycle = next(a["value"] for a in printed["assumptions"] if a["name"] == "cell.cycle_s")
    np.testing.assert_allclose(t, cycle * np.arange(printed["cycles"]), atol=1e-9)


def test_the_budget_is_that_of_a_witness_and_sums_up(verified):
    _, printed = verified
    witness = printed["first_witness"] or printed["tightest"]
    assert printed["budget_m"] == (witness and witness["budget_m"])
    if witness and witness["gap_m"] is not None:
        terms = witness["budget_m"]
        rest = terms["distance"] - sum(
            terms[key] for key in ("link", "body", "latency", "stop", "error", "sides")
        )
        assert rest == pytest.approx(witness["gap_m"], abs=1e-9)


def test_the_cases_show_every_kind_of_result(tmp_path):
    """Otherwise the schema would be tested with nothing but nulls and empty lists."""
    seen = {}
    for name in ("jumps", "points missing", "nothing checked"):
        scene, cell, options, _ = CASES[name]
        (tmp_path / "cell.toml").write_text(cell, encoding="utf-8")
        recording = scene.write(tmp_path / f"{name}.mcap")
        seen[name] = run("verify", recording, "--cell", tmp_path / "cell.toml", *options)[1]
    assert seen["jumps"]["contradictions"]
    assert seen["jumps"]["contradicted"] > 0
    assert seen["points missing"]["refused_measurements"]
    assert seen["nothing checked"]["not_checked"] == seen["nothing checked"]["cycles"]


def test_where_no_metres_can_be_counted_nothing_is_to_be_shrunk(tmp_path):
    scene, cell, options, _ = CASES["nothing readable of one"]
    (tmp_path / "cell.toml").write_text(cell, encoding="utf-8")
    recording = scene.write(tmp_path / "r.mcap")
    printed = run("verify", recording, "--cell", tmp_path / "cell.toml", *options)[1]
    terms = dict(printed["budget_m"])
    assert terms.pop("margin") > 0.0 and terms.pop("sides") == 0.0
    assert set(terms.values()) == {None} and "shrink_first" in terms


@pytest.mark.parametrize("robot", ["ur5", "panda", "lwa4p", "ur3e"])
def test_robots_prints_what_the_schema_says(robot):
    status, card = run("robots", robot)
    assert status == 0
    assert not faults("robots", card)


def test_inspect_prints_what_the_schema_says(tmp_path):
    pause = Scene(people={"p1": frozen}, people_from=0.5).write(tmp_path / "pause.mcap")
    nameless = Scene(duration=0.1, people={}, robot=None).write(tmp_path / "nameless.mcap")
    for recording in (ROOT / "data/demo.mcap", pause, nameless):
        status, found = run("inspect", recording)
        assert status == 0
        assert not faults("inspect", found)


def objects(value: Any, path: str = "") -> Iterator[tuple[str, Json]]:
    """Every schema of an object within a schema."""
    if isinstance(value, dict):
        if value.get("type") == "object":
            yield path, value
        for key, entry in value.items():
            yield from objects(entry, f"{path}/{key}")


UNITS = {
    "_mm_s": "mm/s",
    "_rad_s": "rad/s",
    "_rad": "rad",
    "_m_s": "m/s",
    "_m": "m",
    "_s": "s",
    "_hz": "Hz",
    "litres": "l",
}


@pytest.mark.parametrize("name", NAMES)
def test_every_object_is_closed_and_every_key_described(name):
    jsonschema.Draft202012Validator.check_schema(schema(name))
    found = list(objects(schema(name)))
    assert len(found) > 3
    for path, each in found:
        if "properties" not in each:
            assert isinstance(each["additionalProperties"], dict), f"{path}: a mapping says what it maps to"
            continue
        assert each["additionalProperties"] is False, path
        if "/reasons/properties/" not in path:
            assert each.get("required") == list(each["properties"]), path
        for key, entry in each["properties"].items():
            assert entry.get("description"), f"{path}/{key} has no description"
            unit = next((u for ending, u in UNITS.items() if key.endswith(ending)), None)
            if unit is not None:
                assert entry["description"].split(";")[0].split(",")[0].split(" ")[0] == unit, f"{path}/{key}"


def test_the_schema_names_every_reason_and_criterion():
    listed = schema("verify")["properties"]["reasons"]["properties"]
    for status in Status:
        reasons = {each.name.lower() for each, of in STATUS_OF_REASON.items() if of is status}
        assert set(listed[status.name.lower()]["properties"]) == reasons
    numbers = schema("verify")["properties"]["per_cycle"]["properties"]["reason"]["items"]
    assert (numbers["minimum"], numbers["maximum"]) == (min(Reason), max(Reason))
    criteria = schema("verify")["properties"]["criteria_not_checked"]["items"]["enum"]
    assert set(criteria) == {kind.name.lower() for kind in CriterionKind}


def shortened(value: Any) -> Any:
    """Of each list a few: what an entry more or less of it does is no matter to the keys."""
    if isinstance(value, list):
        return [shortened(entry) for entry in value[:3]]
    return {key: shortened(entry) for key, entry in value.items()} if isinstance(value, dict) else value


def test_a_key_more_or_less_is_a_fault(verified, some):
    name, printed = verified
    printed = shortened(printed)
    assert not faults("verify", printed)
    for key in printed if name == "demo" else some(list(printed), least=8):
        less = {name: value for name, value in printed.items() if name != key}
        assert faults("verify", less), key
    assert faults("verify", {**printed, "grade": 1})
    for place in ("first_witness", "tightest", "per_cycle"):
        if printed[place] is not None:
            more = copy.deepcopy(printed)
            more[place]["grade"] = 1
            assert faults("verify", more), place
