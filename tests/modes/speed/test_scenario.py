"""The scenario: what it prints, its JSON and pictures, and the scenes under the verifier."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest

from modes.speed.experiments import experiment
from modes.speed.report import SpeedReport
from modes.speed.scenario import DOWN, hand_at, motion_of, required_distance, run_scenario
from modes.speed.simulations import Choice, run, simulation
from robots.errors import SetupError
from tests.robots.pin_oracle import PinArm, urdf_of
from tests.verifier.shell import Shell, shell
from verifier.scenario import load_scenario, scenario_names

__all__ = ["shell"]

ROOT = Path(__file__).parents[3]
SCHEMA: dict[str, Any] = json.loads((ROOT / "docs/scenario-speed-alteration.schema.json").read_text("utf-8"))


@pytest.fixture(scope="module")
def report() -> SpeedReport:
    shares: list[float] = []
    found = run_scenario((simulation(1),), shares.append)
    assert shares == sorted(shares) and shares[-1] == 1.0
    return found


def test_the_json_is_what_the_schema_says(report: SpeedReport) -> None:
    document = json.loads(json.dumps(report.to_dict(), allow_nan=False))
    jsonschema.validate(document, SCHEMA)
    for number, sign in ((1, 1.0), (2, -1.0)):
        for method, found in document[f"simulation_{number}"].items():
            if found["goal_sample"] is not None:
                assert len(found["danger_index"]) == found["goal_sample"] + 1
                assert len(found["speed_mm_s"]) == found["goal_sample"]
            assert found["speed_mm_s"][0] == 50.0 * sign, method
    proposed = document["simulation_2"]["proposed"]
    assert -11.5 < proposed["speed_mm_s"][10] < -9.5 and 0.70 < proposed["danger_index"][20] < 0.80


def test_what_is_printed_names_the_papers_numbers(report: SpeedReport) -> None:
    text = "\n".join(report.lines_of_text())
    for theirs in (
        "29",
        "0.7596",
        "0.9940",
        "-49.88",
        "-10.79",
        "216.218",
        "1462.905",
        "436.477",
        "3273.268",
    ):
        assert theirs in text, theirs
    assert text.count("833.333 / 2041.241") == 2 and "Simulated. Not a manufacturer's declaration" in text
    assert max(map(len, text.splitlines()[:-1])) <= 110


@pytest.mark.rarely("the command draws them in every run")
def test_pictures_are_drawn(report: SpeedReport) -> None:
    drawn = report.pictures()
    figures = {f"figure_{n}.png" for n in (3, 4, 5, 6, 7, 8, 9, 11)}
    assert set(drawn) == figures | {"under_the_verifier.png", "under_the_verifier_contact.png"}
    assert all(picture.startswith(b"\x89PNG") and len(picture) > 10_000 for picture in drawn.values())


def test_under_the_verifier_the_arm_does_not_move_beside_a_hand(report: SpeedReport) -> None:
    """The hand is nearer than S_p from begin to end; with nobody around the motion is finished."""
    separated = [each for each in report.watched if not each.contact]
    for each in separated:
        assert math.isfinite(each.alone_s) and math.isnan(each.goal_s)
        assert not each.speed_m_s.any() and each.contacts_while_moving == 0
        assert 0.0 < each.separation_m.max() < report.required_m
    assert [each.mode for each in separated] == [False, True]


def test_where_the_hand_may_be_touched_the_arm_moves_and_the_head_is_still_kept_from(
    report: SpeedReport,
) -> None:
    """It creeps, and does not come to its goal: the head is within the distance that separation asks for."""
    for each in (each for each in report.watched if each.contact):
        assert each.speed_m_s.any() and math.isnan(each.goal_s)
        assert each.nearest_moving_m < report.required_m


@pytest.mark.rarely("the simulations under the verifier, in every run")
def test_in_the_experiments_nobody_is_met_while_the_arm_moves() -> None:
    """But for hands and arms where they may be touched; then the mode keeps away from them."""
    found = run_scenario((experiment(1), experiment(2)), lambda share: None)
    for each in found.watched:
        assert math.isfinite(each.goal_s) and each.goal_s > each.alone_s
        if each.contact:
            assert not each.mode or (each.nearest_moving_m > 0.08 and each.highest_index_moving < 0.5)
            continue
        assert each.contacts_while_moving == 0 and each.stood_s > 1.0
        moving = each.speed_m_s > 1e-3
        assert (each.separation_m[moving] > each.required_m[moving]).all()
    touched = [each for each in found.watched if each.contacts_while_moving]
    assert [(each.scene, each.mode, each.contact) for each in touched] == [
        ("experiment 1", False, True), ("experiment 2", False, True),
    ]  # fmt: skip
    longer = [
        after.goal_s / before.goal_s
        for before, after in zip(found.watched[2::4], found.watched[3::4], strict=True)
    ]
    assert longer == [pytest.approx(1.14, abs=0.01), pytest.approx(1.15, abs=0.01)], "docs/speed.md"


@pytest.mark.parametrize("number", [1, 2])
def test_the_experiments_collide_without_the_method_and_not_with_it(number: int) -> None:
    without, proposed = (run(experiment(number), Choice(m)) for m in ("none", "proposed"))
    assert without.danger_index.max() > 1.0 > proposed.danger_index.max()
    sample = {1: 151, 2: 105}[number]
    assert without.danger_index[sample - 1] > 1.0
    assert proposed.speed[sample - 1] != without.speed[sample - 1] and proposed.goal_sample is not None
    unseen = {1: 41, 2: 86}[number]
    assert not without.danger_index[:unseen].any() and without.danger_index[unseen] > 0.0
    assert (np.abs(proposed.speed) <= 0.25).all()


def test_the_second_experiment_waits_while_it_grabs() -> None:
    found = run(experiment(2), Choice("none"))
    still = np.flatnonzero(found.speed == 0.0) + 1
    assert len(still) == 5 and (np.diff(still) == 1).all() and 30 <= still[0] <= 32
    np.testing.assert_allclose(found.place[still[0]], [0.5945, -0.266, 0.105 + 0.04443], atol=1e-9)


def test_the_arm_follows_the_routes_of_the_scenes(arm: Any) -> None:
    robot = arm("ra605")
    pin = PinArm(urdf_of("ra605"))
    for scene in (simulation(2), experiment(2)):
        q, path = motion_of(scene, robot)
        for corner, (at, start) in enumerate(
            ((scene.corners[0], q), (scene.corners[-1], path.sample(path.s_end)[0]))
        ):
            pin.place(dict(zip(robot.joints, start.tolist(), strict=True)))
            place = pin.pose(robot.joints[-1]).translation - (0.0, 0.0, 0.0865)
            np.testing.assert_allclose(place, at, atol=1e-8, err_msg=f"{scene.name}, corner {corner}")
    np.testing.assert_allclose(motion_of(simulation(1), robot)[0], DOWN, atol=1e-9)


def test_a_hand_is_where_the_scene_has_it_and_far_away_before() -> None:
    scene = simulation(1)
    np.testing.assert_allclose(hand_at(scene, 0.35), 0.5 * (scene.hands[3, 0] + scene.hands[4, 0]))
    np.testing.assert_allclose(hand_at(scene, 1000.0), scene.hands[-1, 0])
    late = experiment(1)
    np.testing.assert_allclose(hand_at(late, 4.1), late.hands[41, 0], atol=1e-12)
    assert np.linalg.norm(hand_at(late, 0.0) - late.hands[41, 0]) == pytest.approx(4.1)
    assert np.linalg.norm(hand_at(late, 100.0)) > 6.0


def test_the_required_distance_is_its_formula() -> None:
    """S_h + S_r + S_s + C + Z_d + Z_r with 1.6 m/s, T_r 0.07 s, errors of 10 and 1 mm."""
    assert required_distance(0.05, 0.04) == pytest.approx(1.6 * 0.11 + 0.05 * 0.11 + 0.011)


def test_scenarios_are_found_by_name(shell: Shell, tmp_path: Path) -> None:
    assert "speed-alteration" in scenario_names() and callable(load_scenario("speed-alteration"))
    assert shell("scenario")[:2] == (0, "contact\nproactive\nspeed-alteration\n")
    status, out, _err = shell("scenario", "--json", "-")
    assert (status, json.loads(out)) == (0, ["contact", "proactive", "speed-alteration"])
    with pytest.raises(SetupError, match="scenario 'collision': none is installed under this name"):
        load_scenario("collision")
    status, _out, err = shell("scenario", "nothing", "--json", tmp_path / "x.json")
    assert status == 2 and "known: contact, proactive, speed-alteration" in err
    assert not (tmp_path / "x.json").exists()
    assert shell("scenario", "--out", tmp_path)[0] == 2
    (tmp_path / "file").write_text("")
    status, _out, err = shell("scenario", "speed-alteration", "--out", tmp_path / "file")
    assert status == 2 and "is not a folder" in err
    status, _out, err = shell("scenario", "speed-alteration", "--out", "-")
    assert status == 2 and "cannot go to standard output; name a folder" in err
    status, _out, err = shell("scenario", "speed-alteration", "--out", tmp_path / "file" / "below")
    assert status == 2 and "cannot be made" in err and "name another one" in err


@pytest.mark.parametrize("name", ["../x.png", "a/b.png", "x.html", ""])
def test_pictures_of_a_plug_in_stay_in_the_folder(
    name: str, shell: Shell, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Report:
        def lines_of_text(self) -> list[str]:
            return []

        def to_dict(self) -> dict[str, object]:
            return {}

        def pictures(self) -> dict[str, bytes]:
            return {name: b"x"}

    monkeypatch.setattr("verifier.scenario_command.load_scenario", lambda name: lambda told: Report())
    status, _out, err = shell("scenario", "odd", "--out", tmp_path / "in")
    assert status == 70 and f"scenario 'odd': picture {name!r}: its name should be that of a .png file" in err
    assert not list(tmp_path.rglob("x.*")) and not list(tmp_path.rglob("b.png"))


def test_a_folder_in_which_nothing_can_be_written_is_found_before_any_work(
    shell: Shell, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(**_options: object) -> None:
        raise OSError(28, "No space left on device")

    def never(name: str) -> None:
        raise AssertionError("the scenario was run")

    monkeypatch.setattr("verifier.scenario_command.TemporaryFile", full)
    monkeypatch.setattr("verifier.scenario_command.load_scenario", lambda name: never)
    status, _out, err = shell("scenario", "speed-alteration", "--out", tmp_path / "new")
    assert status == 2 and "nothing can be written there (No space left on device)" in err


@pytest.mark.parametrize(
    ("loaded", "text"),
    [
        (ImportError("no module"), "cannot be loaded: ImportError: no module"),
        (ValueError("odd"), "cannot be loaded: ValueError: odd"),
        (3, "its entry point names no function"),
    ],
)
def test_a_scenario_that_cannot_be_loaded_is_named(
    loaded: object, text: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Entry:
        value = "odd:run"

        def load(self) -> object:
            if isinstance(loaded, Exception):
                raise loaded
            return loaded

    monkeypatch.setattr("verifier.plug_ins.entry_points", lambda **_: [Entry()])
    with pytest.raises(SetupError, match=text) as refused:
        load_scenario("odd")
    assert str(refused.value).startswith("scenario 'odd'")


class Odd:
    """A report of which one thing may be changed."""

    def __init__(self, **changed: object) -> None:
        self.changed = changed

    def lines_of_text(self) -> object:
        return self.changed.get("lines", ["a line"])

    def to_dict(self) -> object:
        return self.changed.get("document", {"x": 1})

    def pictures(self) -> object:
        return self.changed["pictures"]


def failing(told: object) -> None:
    raise RuntimeError("my experiment failed")


@pytest.mark.parametrize(
    ("made", "text"),
    [
        (failing, "RuntimeError: my experiment failed"),
        (lambda: None, "TypeError: "),
        (lambda told: None, "returned NoneType, which has no method lines_of_text"),
        (lambda told: Odd(lines=3), "TypeError: 'int' object is not iterable"),
        (lambda told: Odd(document={"x": math.nan}), "ValueError: Out of range float values"),
        (lambda told: Odd(document={"x": np.zeros(2)}), "TypeError: Object of type ndarray"),
        (lambda told: Odd(), "KeyError: 'pictures'"),
    ],
)
def test_what_a_scenario_does_wrong_is_said_with_its_name(
    made: object, text: str, shell: Shell, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("verifier.scenario_command.load_scenario", lambda name: made)
    out, target = tmp_path / "out", tmp_path / "x.json"
    status, _printed, err = shell("scenario", "odd", "--json", target, "--out", out)
    assert status == 70 and "internal error: ScenarioError: scenario 'odd'" in err and text in err, err
    assert not out.exists() and err.count("\n") == 1
    if text.startswith("RuntimeError"):
        assert "test_scenario.py, line " in err


def test_a_file_and_a_folder_of_one_name_are_refused_before_any_work(
    shell: Shell, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("verifier.scenario_command.load_scenario", lambda name: failing)
    for folder in ("q", "q/below"):
        status, _out, err = shell("scenario", "odd", "--json", tmp_path / "q", "--out", tmp_path / folder)
        assert status == 2 and "is to be a folder there; name another file" in err
        assert not (tmp_path / "q").exists()


def test_the_command_prints_writes_and_draws(
    shell: Shell, tmp_path: Path, report: SpeedReport, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("verifier.scenario_command.load_scenario", lambda name: lambda told: report)
    target, out = tmp_path / "a.json", tmp_path / "pictures"
    status, text, err = shell("scenario", "speed-alteration", "--json", target, "--out", out)
    assert (status, err) == (0, "") and f"wrote {target}" in text and f"wrote {out / 'figure_8.png'}" in text
    jsonschema.validate(json.loads(target.read_text("utf-8")), SCHEMA)
    assert len(list(out.iterdir())) == 10
    status, _text, err = shell(
        "scenario", "speed-alteration", "--json", out / "new.png", "--out", out, "--force"
    )
    assert status == 2 and "a picture in --out" in err
    status, _text, err = shell("scenario", "speed-alteration", "--out", out)
    assert status == 2 and "has files already; name a new folder, or overwrite with --force" in err
    drawn_again = Odd(pictures={"figure_8.png": b"new"})
    monkeypatch.setattr("verifier.scenario_command.load_scenario", lambda name: lambda told: drawn_again)
    assert shell("scenario", "speed-alteration", "--out", out, "--force")[0] == 0
    assert (out / "figure_8.png").read_bytes() == b"new"
    monkeypatch.setattr("verifier.scenario_command.load_scenario", lambda name: lambda told: report)
    assert shell("scenario", "speed-alteration", "--json", target)[0] == 2, "the file is there already"
    status, text, _err = shell("scenario", "speed-alteration", "--json", "-")
    assert status == 0 and json.loads(text)["required_distance_m"] == report.required_m
