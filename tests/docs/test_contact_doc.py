"""docs/contact.md against the filters, the settings and the machine."""

from __future__ import annotations

import re
from dataclasses import fields

import numpy as np
import pytest

from modes.contact.admittance import Admittance
from modes.contact.detection import ForceThresholds, Residual
from modes.contact.experiments import EXPERIMENTS
from modes.contact.filters import current_high_pass, current_low_pass, force_high_pass, force_low_pass
from modes.contact.guided import Guest
from modes.contact.machine import ContactSettings, State
from modes.contact.scenario import CELL, HELD_LINKS
from modes.contact.wrench import SensorLimits
from tests.docs.test_schemas import ROOT

DOC = (ROOT / "docs/contact.md").read_text(encoding="utf-8")


def rows(heading: str) -> list[list[str]]:
    """The cells of the first table below a heading that begins with these words."""
    below = DOC[DOC.index(heading) :]
    found = re.search(r"\|---.*\n((?:\|.*\n)+)", below)
    assert found is not None
    return [[cell.strip() for cell in line.strip("|").split(" | ")] for line in found[1].splitlines()]


def numbers(text: str) -> list[float]:
    return [float(each) for each in re.findall(r"\d+\.\d+", text)]


def test_filters_are_what_the_table_says() -> None:
    currents, mean, high, low = rows("## The filters")
    printed = current_high_pass("as_printed")
    at_ten, highest, top, level, relative = numbers(currents[2])
    assert printed.gain(10.0)[0] == pytest.approx(at_ten, abs=5e-4)
    assert printed.highest_gain()[0] == pytest.approx(highest, abs=5e-4)
    assert printed.gain(0.5 * printed.rate_hz)[0] == pytest.approx(top, abs=5e-4)
    assert printed.cut_off_hz() == pytest.approx(level, abs=5e-3)
    assert printed.cut_off_hz(of_highest=True) == pytest.approx(relative, abs=5e-3)
    assert current_high_pass().cut_off_hz() == pytest.approx(numbers(currents[3])[1], abs=5e-3)
    assert current_low_pass().cut_off_hz() == pytest.approx(numbers(mean[2])[0], abs=5e-3)
    for design, text in (
        (force_high_pass("as_printed"), [*numbers(high[1]), *numbers(high[2])]),
        (force_high_pass("corrected"), numbers(high[3])),
    ):
        coefficient, top, relative = text
        assert design.b[0] == pytest.approx(coefficient, abs=5e-5)
        assert design.gain(0.5 * design.rate_hz)[0] == pytest.approx(top, abs=5e-4)
        assert design.cut_off_hz(of_highest=True) == pytest.approx(relative, abs=6e-3)
    for design, text in (
        (force_low_pass("as_printed"), [*numbers(low[1]), *numbers(low[2])]),
        (force_low_pass("corrected"), numbers(low[3])),
    ):
        assert design.b[0] == pytest.approx(text[0], abs=5e-5)
        assert design.cut_off_hz() == pytest.approx(text[1], abs=5e-3)
    wanted = [10.0 / force_high_pass(name).b[0] for name in ("corrected", "as_printed", "exact")]
    steps = re.search(r"([\d.]+) N \(printed: ([\d.]+) N, exact: ([\d.]+) N\)", DOC)
    assert steps is not None
    assert [float(each) for each in steps.groups()] == [pytest.approx(each, abs=0.05) for each in wanted]


def test_every_setting_is_described_with_its_default() -> None:
    table = rows("| setting of `ContactSettings`")
    named = [name for row in table for name in re.findall(r"`(\w+)`", row[0])]
    assert sorted(named) == sorted(field.name for field in fields(ContactSettings))
    made = ContactSettings(Residual((1.0,)))
    assert (made.clear_s, made.resume_s, made.check_s, made.cap_m_s) == (1.0, 4.0, 0.3, 0.25)
    assert (made.task_gain, made.posture_gain, made.space, made.filters) == (
        2.0,
        2.0,
        "cartesian",
        "corrected",
    )
    assert made.forces == ForceThresholds(10.0, 7.0) and made.residual.threshold_Nm == 22.0
    assert made.sensor == SensorLimits(145.0, 5.0, 0.05, 0.03, 1.5)
    assert made.admittance == Admittance(0.008, 300.0, 0.012) and made.joint_admittance.compliance == 0.05
    assert made.joint_admittance.stiffness == 40.0 and made.acceleration_share == 0.15


def test_every_state_is_described() -> None:
    assert [row[0] for row in rows("## States")] == [f"`{state.name}`" for state in State]


def test_files_in_it_exist() -> None:
    for path in re.findall(r"`((?:tests|modes)/[\w/]+\.py)`", DOC):
        assert (ROOT / path).is_file(), path


def test_the_experiments_are_those_that_are_run() -> None:
    table = rows("| experiment | figure |")
    assert [(row[0], row[1], row[2].strip("`")) for row in table] == [
        (each.name, each.figures, each.expected) for each in EXPERIMENTS
    ]
    instants = sorted({each.hit_s for each in EXPERIMENTS if each.figures})
    text = ", ".join(f"{each:g}" for each in instants[:-1]) + f" and {instants[-1]:g} s"
    assert f"keeps the paper's instants ({text})" in DOC


def test_what_guiding_takes_is_what_the_cell_has() -> None:
    assert HELD_LINKS == ("link_4", "link_5", "link_6", "tool:handle") and "links 4 to 6" in DOC
    assert CELL["people"]["latency_s"] == 0.03 and "With 30 ms" in DOC
    wanted = 1e3 * float(np.linalg.norm(Guest(None).hand.away_m))  # type: ignore[arg-type]  # no twin is asked
    assert f"wants to lead it {wanted:.0f} mm" in DOC
    assert '"modes.contact" = ["*.toml"]' in (ROOT / "pyproject.toml").read_text(encoding="utf-8")
