"""docs/recordings.md: its writer is run, and what it says is compared with the code."""

import json
import re
from pathlib import Path

import jsonschema
import numpy as np
import pytest
from click.testing import CliRunner

from failsafe.trajectory import LATEST_S
from occupancy.body import POINT_NAMES
from verifier import Cell, Status, verify
from verifier.commands import cli
from verifier.recordings import (
    Reading,
    Recording,
    importing,
    inspect_recording,
    mcap_chunk,
    people_source,
    table,
)
from verifier.recordings.npz import KEYS
from verifier.recordings.people_report import decode
from verifier.recordings.people_schema import SCHEMA
from verifier.replay import MAX_CYCLES
from verifier.section import FEWEST_SAMPLES

ROOT = Path(__file__).resolve().parents[2]
DOC = (ROOT / "docs/recordings.md").read_text(encoding="utf-8")


def section(title: str) -> str:
    """The text below a heading, up to the next one of its rank."""
    mark = re.search(rf"^(#+) {re.escape(title)}$", DOC, re.MULTILINE)
    assert mark, f"docs/recordings.md has no section {title!r}"
    rest = DOC[mark.end() :]
    end = re.search(rf"^#{{1,{len(mark[1])}}} ", rest, re.MULTILINE)
    return rest[: end.start()] if end else rest


@pytest.fixture
def written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """What the document's writer writes."""
    (code,) = re.findall(r"```python\n(.*?)```", DOC, re.DOTALL)
    assert "verifier" not in code, "the writer needs nothing of this project"
    monkeypatch.chdir(tmp_path)
    exec(compile(code, "docs/recordings.md", "exec"), {})
    return tmp_path / "mine.mcap"


def test_the_writer_writes_a_recording(written):
    found = inspect_recording(written)
    assert not found.remarks
    assert found.people == {"p1": 250}
    assert found.robot_candidates == ("ur10", "ur10e", "ur16e", "ur3", "ur3e", "ur5", "ur5e")
    reading = Reading(Recording(written), found.joints)
    (window,) = reading.windows(10.0, 0.0, 0.0)
    np.testing.assert_allclose(np.diff(window.t), 8e-3, atol=1e-9)
    np.testing.assert_allclose(window.q[:, 0], 0.3 * np.sin(window.t), atol=1e-12)
    np.testing.assert_array_equal(window.q[-1, 1:], [-1.2, 1.5, -0.3, 1.5, 0.0])
    assert all(report.arrived == pytest.approx(report.stamp + 0.03) for report in window.people)


def test_verify_judges_what_the_writer_wrote(written):
    report = verify(written, Cell().with_options(robot="ur5", bare_flange=True))
    assert report.count(Status.VERIFIED) > 0.9 * report.cycles
    assert report.count(Status.NOT_VERIFIED) == report.count(Status.CONTRADICTED) == 0
    assert not report.refused


def test_the_command_of_the_document_is_one(written):
    (line,) = re.findall(r"`stopproof (verify mine\.mcap [^`]+)`", DOC)
    result = CliRunner().invoke(cli, line.split(), standalone_mode=False)
    assert result.return_value == 3, "limits of the UR5 are assumed, and the command does not accept them"


def test_the_example_report_is_one():
    (text,) = re.findall(r"```json\n(.*?)```", DOC, re.DOTALL)
    jsonschema.validate(json.loads(text), json.loads(SCHEMA))
    report = decode(text.encode(), 12_370_000_000)
    assert not report.flaws
    assert report.complete
    assert report.people[0].measured == 1 << POINT_NAMES.index("r_wrist")
    assert report.people[0].error_m[POINT_NAMES.index("r_elbow")] == 0.05


def test_the_keys_of_a_report_are_those_of_the_schema():
    listed = set(re.findall(r"^\| `([\w.*\[\]]+)` \|", section("`/people`"), re.MULTILINE))
    report = json.loads(SCHEMA)["properties"]
    person = report["people"]["items"]["properties"]
    point = person["points"]["additionalProperties"]["properties"]
    keys = {*report, *(f"people[].{key}" for key in person), *(f"points.*.{key}" for key in point)}
    assert listed == keys


def test_all_point_names_are_listed():
    plain, sided = section("Point names").split("with `l_` or `r_` before them")
    names = set(re.findall(r"`(\w+)`", plain))
    names |= {f"{side}_{name}" for side in "lr" for name in re.findall(r"`(\w+)`", sided.split(".")[0])}
    assert names == set(POINT_NAMES)


def test_all_arrays_of_an_npz_are_named():
    text = section("Import")
    for key in KEYS:
        assert f"`{key}`" in text


def test_all_options_of_import_are_listed():
    options = {name for each in cli.commands["import"].params for name in each.opts if name.startswith("--")}
    text = section("Import")
    assert set(re.findall(r"^\| `(--[\w-]+)` \|", text, re.MULTILINE)) == options
    usage = text.split("```")[1]
    assert set(re.findall(r"--[\w-]+", usage)) == options


def test_numbers_in_the_text_are_those_of_the_code():
    text = " ".join(DOC.split())
    for phrase in (
        f"unpack to at most {mcap_chunk.MAX_CHUNK_BYTES >> 20} MiB",
        f"a place within {people_source.FARTHEST_M / 1e4:g}e4 m and {people_source.MAX_TURN_DEG:g} degrees",
        f"a position error of at most {importing.MAX_POSITION_ERROR_M / 1e3:g}e3 m",
        f"an offset within {importing.MAX_OFFSET_S / 1e9:g}e9 s",
        f"At least {importing.FEWEST_SAMPLES} joint samples",
        f"go on for more than {table.MAX_SPAN_S / 1e6:g}e6 s",
        f"mostly more than {table.MAX_JOINT_STEP_S:g} s apart",
        f"points mostly more than {table.MAX_PEOPLE_STEP_S:g} s apart",
        f"may hold {table.MAX_TABLE_BYTES >> 30} GiB",
        f"or fewer than {FEWEST_SAMPLES} and no pause",
        f"more than {LATEST_S / 1e6:g}e6 s or {MAX_CYCLES / 1e8:g}e8 cycles",
    ):
        assert phrase in text, phrase
    assert table.WHOLE_NUMBERS == 10


def test_every_message_that_the_document_quotes_stands_in_the_code():
    code = "\n".join(
        path.read_text(encoding="utf-8")
        for package in ("verifier", "occupancy")
        for path in (ROOT / package).rglob("*.py")
    )
    joined = re.sub(r'"\s*\n\s*f?"', "", code)  # texts that go on in the next line
    quoted = re.findall(r"^\| [^|]+ \| (.*) \|$", section("What is refused"), re.MULTILINE)
    messages = [text for cell in quoted for text in re.findall(r"`([^`]+)`", cell)]
    assert len(messages) > 35
    for message in messages:
        plain = message.removeprefix("mcap recover").removeprefix("mcap compress")
        assert plain in joined or plain.replace('"', '\\"') in joined, message
