"""docs/method.md: what the code cites is there, its tables are those of the code, and its words are right."""

import re
from pathlib import Path

import pytest

from occupancy.body import Part, load_profile
from occupancy.humans import iso13855
from tests.test_wording import FORBIDDEN
from verifier.verdict import STATUS_OF_REASON, Status

ROOT = Path(__file__).resolve().parents[2]
DOCS = sorted((ROOT / "docs").glob("*.md"))
METHOD = (ROOT / "docs/method.md").read_text(encoding="utf-8")
TITLE = "Guaranteed Safety of Humans"
"""Words of a cited title are not ours."""


def anchors(text: str) -> set[str]:
    """The anchors that a reader's browser makes of the headings."""
    headings = re.findall(r"^#+ (.+)$", re.sub(r"```.*?```", "", text, flags=re.DOTALL), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


def test_every_section_that_the_code_cites_is_there():
    sections = set(re.findall(r"^##+ (\d+(?:\.\d+)?)", METHOD, re.MULTILINE))
    cited = set()
    for folder in ("robots", "occupancy", "failsafe", "verifier"):
        for path in (ROOT / folder).rglob("*.py"):
            text = " ".join(path.read_text(encoding="utf-8").split())
            for found in re.findall(r"docs/method\.md, sections? ((?:[\d.]+\d|\d)(?: and \d+)?)", text):
                cited |= set(found.split(" and "))
    assert {"1", "2", "3", "4", "4.1", "5", "6"} <= cited
    assert cited <= sections
    assert {str(number) for number in range(1, 9)} <= sections


@pytest.mark.parametrize("path", DOCS, ids=lambda path: path.name)
def test_every_link_leads_somewhere(path):
    text = path.read_text(encoding="utf-8")
    for target in re.findall(r"\]\(([^)\s]+)\)", text):
        if target.startswith("https://"):
            continue
        name, _, anchor = target.partition("#")
        other = path.parent / name if name else path
        assert other.exists(), target
        if anchor:
            assert anchor in anchors(other.read_text(encoding="utf-8")), target


@pytest.mark.parametrize("path", DOCS, ids=lambda path: path.name)
def test_documents_use_the_right_words(path):
    text = path.read_text(encoding="utf-8").replace(TITLE, "").replace('"ISO-compliant model"', "")
    assert not [word for word, rule in FORBIDDEN.items() if rule.search(text)]


def test_reasons_and_status_are_those_of_the_code():
    rows = re.findall(r"^\| `(\w+)` \| ([\w ]+) \| ", METHOD, re.MULTILINE)
    assert len(rows) == len(dict(rows))
    assert dict(rows) == {
        reason.name.lower(): status.name.lower().replace("_", " ")
        for reason, status in STATUS_OF_REASON.items()
    }
    numbers = re.findall(r"^\| ([\w ]+) \| (\d) \|", METHOD, re.MULTILINE)
    assert dict(numbers) == {status.name.lower().replace("_", " "): str(int(status)) for status in Status}


def test_numbers_of_the_profile_are_those_of_the_code():
    profile = load_profile("iso")
    text = {
        row[0].strip(): row[1].strip() for row in re.findall(r"^\| ([^|]+)\|([^|]+)\|", METHOD, re.MULTILINE)
    }
    assert float(text["speed of every point"].split()[0]) == profile.speed.max() == profile.speed.min()
    for row, parts in {
        "radius of head, neck, torso, pelvis": (Part.HEAD, Part.NECK, Part.TORSO, Part.PELVIS),
        "radius of upper arm, forearm": (Part.L_UPPER_ARM, Part.R_FOREARM),
        "radius of the hand, around the wrist": (Part.L_HAND, Part.R_HAND),
        "radius of thigh, shank": (Part.L_THIGH, Part.R_SHANK),
        "radius of the foot, around the ankle": (Part.L_FOOT, Part.R_FOOT),
    }.items():
        assert {float(text[row].split()[0])} == {float(profile.radius[part]) for part in parts}
    stature = {a.name.rsplit(".", 1)[1]: a.value for a in profile.assumptions if ".stature." in a.name}
    assert text["longest, shortest stature"] == f"{stature['longest']} m, {stature['shortest']} m"


def test_radii_are_written_as_they_are_computed():
    """One row by hand: a wrist, its hand ball, clock and stamp errors, delay."""
    import numpy as np

    from occupancy.hypotheses import PEOPLE
    from occupancy.sets import new_people_sets
    from robots.motion import new_slices

    speed, e_p, stamp, sigma, epsilon = 2.0, 0.013, 5.0, 0.02, 0.003
    people, slices, out = np.zeros(1, PEOPLE), new_slices(), new_people_sets()
    people["n"], people["present"][0, 0] = 1, 1 << 6
    people["xyz"][0, 0, 6], people["e_p"][0, 0, 6] = (1.0, 2.0, 3.0), e_p
    people["t_obs"][0, 0, 6] = stamp - sigma
    people["stamp_error"], people["clock_error"] = sigma, epsilon
    slices["n"], slices["delay"] = 1, (0.01, 0.05)
    model = iso13855.Iso13855(load_profile("iso"), held_object_m=0.1)
    for begin, end in ((5.3, 5.4), (4.5, 4.52)):
        slices["t"][0, :2] = begin, end
        model.occupy(people, slices, out)
        rows = range(int(out["n"][0]))
        (row,) = (k for k in rows if out["covers"][0, k] >> Part.L_HAND & 1)
        t_m = stamp - sigma
        delta = max(end + 0.05 + epsilon - t_m, t_m - (begin + 0.01 - 2 * sigma - epsilon))
        assert out["radius"][0, row] == pytest.approx(0.205 + 0.1 + e_p + speed * delta, abs=1e-12)


def test_numbers_in_the_text_are_those_of_the_code():
    from failsafe import limit_kernels, scaling
    from failsafe.trajectory import FitSettings
    from occupancy import kernels as occupancy_kernels
    from occupancy.humans.options import _AGEING_M_S
    from occupancy.report import GateSettings
    from occupancy.sets import MAX_PEOPLE
    from robots.capsule import SLACK
    from robots.motion import MAX_SLICES
    from verifier import section
    from verifier.cell import Cell
    from verifier.recordings.people_stream import MAX_CLOCK_OFFSET_S

    text = " ".join(METHOD.split())
    gate, cell = GateSettings(clock_error_s=0.0, stamp_error_s=0.0, position_error_m=0.0), Cell()
    for phrase in (
        f"in stretches of {section.WINDOW_S:g} s, each fitted with {section.LEAD_S:g} s before and "
        f"{section.TAIL_S:g} s after it",
        f"ends more than {section.TAIL_S:g} s after the end of a stretch",
        f"A residual above {section.MAX_MEASURED_ERROR_RAD:g} rad is refused",
        f"a spline of degree {FitSettings().degree}. The knots are {1e3 * FitSettings().knot_spacing_s:g} ms",
        f"at most {len(scaling.TIGHTER)} times",
        f"an interval of 1/{1.0 / limit_kernels._FINEST:g} of a slice",
        f"at most {MAX_SLICES} time slices",
        f"plus {SLACK:.0e} m".replace("e-0", "e-"),
        f"farther than {gate.range_m:g} m",
        f"There are {MAX_PEOPLE} rows, and one is reserved for each of {gate.max_people} persons",
        f"- {occupancy_kernels.ROUNDING:g} (size_A + size_B)",
        f"`check.standstill_speed_m_s` ({1e3 * cell.check.standstill_speed_m_s:g} mm/s)",
        f"`check.standstill_error_m` ({1e3 * cell.check.standstill_error_m:g} mm)",
        f"of about `stop.slice_s` ({1e3 * cell.stop.slice_s:g} ms)",
        f"are more than {MAX_CLOCK_OFFSET_S:g} s apart",
        f"Fewer than {section.FEWEST_SAMPLES} samples between two pauses",
        f"counts as farther away by its age times {_AGEING_M_S:g} m/s",
    ):
        assert phrase in text, phrase
