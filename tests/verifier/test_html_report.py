"""The page of `verify`: nothing is loaded, everybody can read it, and its numbers are those of the JSON."""

from __future__ import annotations

import json
import re
import tomllib
from dataclasses import replace
from fnmatch import fnmatch
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import minimize

from tests.source_files import PACKAGES
from tests.test_wording import faults as words_never_used
from tests.verifier.html_page import (
    Element,
    fetched,
    numbers,
    parse,
    path_boxes,
    path_points,
    resolve,
    unreadable,
)
from tests.verifier.scenes import CELL, Scene, person_at
from tests.verifier.shell import Shell, refused
from verifier import Cell, verify
from verifier.reports.assumptions import OF_THE_MODEL
from verifier.reports.html import verification
from verifier.reports.html.chart import LEFT, RIGHT, WIDTH, Curve, Scale, Track, css_class, timeline
from verifier.reports.html.elements import decimal, node
from verifier.reports.html.still_picture import convex_hull
from verifier.reports.html.verification import verification_page
from verifier.reports.text import DISCLAIMER
from verifier.reports.verification import PerCycle, Refused, VerifyReport
from verifier.verdict import Reason, Status

ROOT = Path(__file__).resolve().parents[2]
HOSTILE = '"><script>alert(1)</script><img src="http://x.example/y.png" onerror=f()>&amp;\x1b[31m\n\u202e'


def walking_up(t: float) -> np.ndarray:
    """Up to the arm, and a jump at the end that no profile allows."""
    return person_at(2.6 - 1.2 * t - (1.0 if t > 1.8 else 0.0), 0.0)


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> VerifyReport:
    nobody = np.full((20, 3), np.nan)
    scene = Scene(people={"p1": walking_up, "p2": lambda t: person_at(4.0, 0.0) if t % 0.5 < 0.4 else nobody})
    wall = {"kind": "box", "xyz_m": [-1.5, 0.0, 0.0], "size_m": [0.1, 2.0, 2.0], "position_error_m": 0.01}
    table = {**CELL, "workspace": {"fixtures": {"wall": wall}}}
    return verify(scene.write(tmp_path_factory.mktemp("page") / "r.mcap"), Cell.from_table(table))


@pytest.fixture(scope="module")
def page(report: VerifyReport) -> Element:
    return parse(verification_page(report))


def test_the_scene_has_something_to_show(report: VerifyReport) -> None:
    assert all(report.count(status) for status in Status)
    assert report.contradicted and report.refused and report.first_witness and report.tightest


def test_nothing_is_loaded_and_nothing_runs(page: Element) -> None:
    assert fetched(page) == []
    (policy,) = [each for each in page.all("meta") if "http-equiv" in each.attributes]
    assert policy.attributes["content"].startswith("default-src 'none'")


def test_it_prints_and_is_dark_where_that_is_wanted(page: Element) -> None:
    """What browsers do with these rules was looked at; here that they are there."""
    style = page.first("style").text
    printed = style[style.index("@media print") :]
    assert re.search(r"footer \{ display: table-footer-group; break-inside: avoid;", printed)
    assert "#text { display: none; }" in printed and "@page" in printed
    named = set(re.findall(r"(--[a-z0-9-]+):", style[: style.index("@media")]))
    dark = style[style.index("prefers-color-scheme: dark") : style.index("* {")]
    used = set(re.findall(r"var\((--[a-z0-9-]+)", style))
    assert used - {"--tile"} <= named
    assert named == set(re.findall(r"(--[a-z0-9-]+):", dark)) == set(re.findall(r"(--[a-z0-9-]+):", printed))


def test_packages_and_their_data_are_shipped() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["setuptools"]
    folders = [
        path.parent.relative_to(ROOT) for name in PACKAGES for path in (ROOT / name).rglob("__init__.py")
    ]
    assert sorted(project["packages"]) == sorted(".".join(folder.parts) for folder in folders)
    data = project["package-data"]
    for path in (ROOT / "verifier").rglob("*.css"):
        package = ".".join(path.parent.relative_to(ROOT).parts)
        assert any(fnmatch(path.name, pattern) for pattern in data.get(package, ()))


@pytest.mark.parametrize(
    "planted",
    [
        '<img src="x.png" alt="">',
        "<script>f()</script>",
        '<a href="http://x.example">x</a>',
        '<p onclick="f()">x</p>',
        '<p style="background: url(x.png)">x</p>',
        "<style>@import 'x.css';</style>",
        '<svg><use href="x.svg#a"></use></svg>',
    ],
)
def test_what_would_be_loaded_is_seen(page: Element, planted: str) -> None:
    html = f'<!DOCTYPE html><html lang="en"><body>{planted}</body></html>'
    assert fetched(parse(html.encode()))


def test_everybody_can_read_it(page: Element) -> None:
    assert unreadable(page) == []
    assert len(list(page.all("svg"))) >= 6


@pytest.mark.parametrize(
    "planted",
    [
        "<h1>a</h1><h3>b</h3>",
        "<h1>a</h1><svg></svg>",
        '<h1>a</h1><table><tr><th scope="col">a</th></tr></table>',
        "<h1>a</h1><table><caption>x</caption><tr><th>a</th></tr></table>",
        '<h1>a</h1><a href="#b">b</a>',
        '<h1 id="a">a</h1><p id="a">b</p>',
    ],
)
def test_what_cannot_be_read_is_seen(planted: str) -> None:
    assert unreadable(parse(f'<!DOCTYPE html><html lang="en"><body>{planted}</body></html>'.encode()))


def test_numbers_are_those_of_the_json(report: VerifyReport, page: Element) -> None:
    """Value by value, and as rounded as they are shown."""
    printed = json.loads(json.dumps(report.to_dict()))
    found = numbers(page)
    for pointer, value, text in found:
        assert resolve(printed, pointer) == value, pointer
        plain = re.sub(r"\s", "", text)
        shown = re.match(r"[+-]?[\d.]+(?:e[+-]\d+)?", plain)
        if value is None:
            assert text in ("–", "infinite"), pointer
        else:
            assert shown is not None, pointer
            digits = len(shown[0].partition(".")[2]) if "e" not in shown[0] else 0
            error = 0.5 * 10.0**-digits if digits or isinstance(value, int) else abs(value) * 1e-5
            assert abs(float(shown[0]) - value) <= error * (1 + 1e-9), pointer
    pointers = {pointer for pointer, *_ in found}
    for key in ("first_witness", "tightest"):
        terms = {f"/{key}/budget_m/{term}" for term in printed[key]["budget_m"] if term != "shrink_first"}
        assert terms <= pointers
    assert {
        f"/{name}" for name in ("cycles", "verified", "not_verified", "contradicted", "not_checked")
    } <= pointers
    reasons = {f"/reasons/{status}/{name}" for status, of in printed["reasons"].items() for name in of}
    assert reasons <= pointers
    valued = {f"/assumptions/{k}/value" for k, item in enumerate(printed["assumptions"])
              if not isinstance(item["value"], str)}  # fmt: skip
    assert valued <= pointers


@pytest.mark.parametrize("most", [1, 1000])
def test_others_are_spoken_of_where_there_are_some(
    report: VerifyReport, monkeypatch: pytest.MonkeyPatch, most: int
) -> None:
    monkeypatch.setattr(verification, "MOST_STRETCHES", most)
    texts = [each.text for each in parse(verification_page(report)).all("p") if "stretches" in each.text]
    (text,) = [each for each in texts if each.startswith("Listed: ")]
    listed, total = map(int, re.findall(r"\d+", text)[:2])
    assert listed == min(most, total) and total > 1
    assert text.endswith("the others are in the JSON result.") == (listed < total)


def test_the_text_report_stands_in_it(report: VerifyReport, page: Element) -> None:
    """Word for word; so a number of the text is one of the page."""
    assert page.first("pre").text.split("\n") == report.lines()
    outside = page.first("main").text.replace(page.first("pre").text, "")
    for line in report.lines():
        if line.startswith("where the metres go"):
            terms = re.findall(r"(?:distance|- \w+) (\d\.\d{3})", line)
            assert len(terms) == 6 and all(term in outside for term in terms)


def test_everything_that_the_result_rests_on_is_listed(report: VerifyReport, page: Element) -> None:
    text = page.text
    for item in report.assumptions:
        assert item.name in text
    for name, what in OF_THE_MODEL:
        assert name in text and what in text
    for each in report.inputs:
        assert each.sha256 in text
    assert text.count(DISCLAIMER) >= 1 and DISCLAIMER in page.first("footer").text
    assert report.cell_hash in text and report.contradicted[0].text in text
    assert words_never_used("page", text) == []


def test_names_from_files_stay_text(report: VerifyReport) -> None:
    found = report.first_witness
    assert found is not None
    odd = replace(
        report,
        recording=HOSTILE,
        robot=HOSTILE,
        waived=(HOSTILE,),
        notes=(HOSTILE,),
        refused=(Refused(float("nan"), HOSTILE, HOSTILE, HOSTILE),),
        refused_for=((HOSTILE, 1),),
        first_witness=replace(found, link=HOSTILE, person=HOSTILE, no_contact=HOSTILE),
        contradicted=tuple(replace(item, text=HOSTILE) for item in report.contradicted),
    )
    content = verification_page(odd)
    page = parse(content)
    assert fetched(page) == [] and unreadable(page) == []
    assert b"\x1b" not in content and "\u202e".encode() not in content
    assert page.text.count("alert(1)") > 8


def test_the_lanes_are_the_cycles(report: VerifyReport, page: Element) -> None:
    """Of the first chart: where a lane is filled there are cycles of its status, and nowhere else."""
    chart = page.first("svg")
    rows, x = report.per_cycle, Scale(0.0, float(report.per_cycle.t[-1]) + 0.01, LEFT, WIDTH - RIGHT)
    for status in Status:
        (lane,) = [each for each in chart.all("path") if css_class(status) in each.classes]
        boxes = path_boxes(lane.attributes["d"])
        middles = np.array([x(t + 0.005) for t in rows.t])
        filled = np.array([any(a - 0.01 <= m <= b + 0.01 for a, b in boxes) for m in middles])
        assert filled[rows.status == status].all()
        widened = np.array([any(a - 1.5 <= m <= b + 1.5 for a, b in boxes) for m in middles])
        assert (filled <= widened).all() and filled.sum() <= (rows.status == status).sum() + 2 * len(boxes)


def test_one_cycle_of_many_is_seen_and_the_picture_stays_small(rng: np.random.Generator) -> None:
    n = 400_000
    status = np.full(n, int(Status.VERIFIED), np.uint8)
    status[123_456] = int(Status.CONTRADICTED)
    gap = rng.uniform(0.5, 1.0, n)
    gap[n // 2 + 200], gap[n // 3] = -0.25, np.nan  # in the middle of a column of pixels
    track = Track("", 0.01 * np.arange(n), status, 0.01)
    chart = timeline("Chart", "Of many", [track], [Curve("gap [m]", (gap,), zero=True)])
    drawn = {each.get("class"): each.get("d", "") for each in chart.iter("path")}
    (box,) = path_boxes(drawn["contradicted"])
    assert 1.0 <= box[1] - box[0] < 2.0
    assert box[0] == pytest.approx(LEFT + (WIDTH - RIGHT - LEFT) * 123_456 / n, abs=0.1)
    heights = np.array([y for _x, y in path_points(drawn["curve curve-1"])])
    assert len(drawn["curve curve-1"]) < 200_000
    assert np.sum(heights > heights.mean() + 4.0 * heights.std()) == 1, "the one overlap is drawn"


def test_a_curve_with_very_many_gaps_stays_small() -> None:
    n = 100_000
    values = np.where(np.arange(n) % 2 == 0, 1.0 + 1e-3 * np.sin(0.1 * np.arange(n)), np.nan)
    values[n // 2 : n // 2 + n // 100] = np.nan  # wide enough to be seen
    track = Track("", 0.01 * np.arange(n), np.full(n, 2, np.uint8), 0.01)
    chart = timeline("Chart", "Of gaps", [track], [Curve("x", (values,))])
    (line,) = [each.get("d", "") for each in chart.iter("path") if each.get("class") == "curve curve-1"]
    assert len(line) < 100_000 and line.count("M") == 2


def test_a_curve_of_few_cycles_is_drawn_point_by_point() -> None:
    t = 0.1 * np.arange(20)
    values = np.where(np.arange(20) == 7, np.nan, np.sin(t))
    track = Track("", t, np.full(20, 2, np.uint8), 0.1)
    chart = timeline("Chart", "Of few", [track], [Curve("x", (values,))])
    (line,) = [each.get("d", "") for each in chart.iter("path") if each.get("class") == "curve curve-1"]
    points = np.array(path_points(line))
    assert len(points) == 19 and line.count("M") == 2
    x = Scale(0.0, 2.0, LEFT, WIDTH - RIGHT)
    expected = values[np.isfinite(values)]
    np.testing.assert_allclose(points[:, 0], [x(each) for each in t[np.isfinite(values)]], atol=0.006)
    fitted = np.polyfit(points[:, 1], expected, 1)
    np.testing.assert_allclose(np.polyval(fitted, points[:, 1]), expected, atol=2e-4)
    assert fitted[0] < 0.0, "greater is higher"


@pytest.mark.parametrize("ends", [(0.0, 19.6), (-0.03, 3.7), (0.0, 1e-3), (1e4, 1e4 + 5.0)])
def test_ticks_are_round_and_within(ends: tuple[float, float]) -> None:
    scale = Scale(*ends, 0.0, 100.0)
    ticks = scale.ticks()
    steps = np.diff(ticks)
    assert 2 <= len(ticks) <= 10 and np.allclose(steps, steps[0])
    assert all(-1e-6 <= scale(tick) <= 100.0 + 1e-6 for tick in ticks)
    assert f"{steps[0]:.0e}"[0] in "125"


def hull_distance(a: np.ndarray, b: np.ndarray) -> float:
    """Distance of two hulls, by a general minimiser over convex weights."""

    def squared(w: np.ndarray) -> float:
        return float(np.sum((w[: len(a)] @ a - w[len(a) :] @ b) ** 2))

    n = len(a) + len(b)
    sums = [{"type": "eq", "fun": lambda w: w[: len(a)].sum() - 1.0},
            {"type": "eq", "fun": lambda w: w[len(a) :].sum() - 1.0}]  # fmt: skip
    start = np.concatenate([np.full(len(a), 1.0 / len(a)), np.full(len(b), 1.0 / len(b))])
    found = minimize(
        squared, start, bounds=[(0.0, 1.0)] * n, constraints=sums, options={"ftol": 1e-14, "maxiter": 500}
    )
    return float(np.sqrt(found.fun))


@pytest.mark.parametrize("key", ["first_witness", "deepest", "tightest"])
def test_the_picture_shows_the_sets_of_the_gap(report: VerifyReport, key: str) -> None:
    """The gap is the distance of the two sets that are drawn red, their radii taken off."""
    witness, still = getattr(report, key), report.stills[key]
    (link,) = [body for body in still.links if body.decides]
    (person,) = [body for body in still.people if body.decides]
    assert link.name == witness.link and person.person == witness.person and person.name == witness.part
    gap = hull_distance(link.points, person.points) - link.radius - person.radius
    assert gap == pytest.approx(witness.gap_m, abs=1e-4)
    assert {body.name for body in still.fixtures} == {"wall"}
    assert [name for name, _xyz in still.seen] == ["p1", "p2"]


def test_each_witness_has_its_pictures(report: VerifyReport, page: Element) -> None:
    shown = [each for each in page.all("div") if "views" in each.classes]
    expected = 2 if report.deepest.slice == report.first_witness.slice else 3
    assert len(shown) == expected and all(len(list(each.all("svg"))) == 2 for each in shown)
    for each in shown:
        red = [g for g in each.all("g") if "decides" in g.classes]
        assert len(red) == 4, "link and body part, in both views"


def test_a_fixture_in_the_way_is_drawn(tmp_path: Path) -> None:
    wall = {"kind": "box", "xyz_m": [0.6, 0.0, 0.3], "size_m": [0.1, 2.0, 2.0], "position_error_m": 0.01}
    cell = Cell.from_table({**CELL, "workspace": {"fixtures": {"wall": wall}}})
    found = verify(Scene(duration=0.3).write(tmp_path / "r.mcap"), cell)
    still = found.stills["first_witness"]
    assert [body.name for body in still.fixtures if body.decides] == ["wall"] and not still.people
    page = parse(verification_page(found))
    assert unreadable(page) == [] and "fixture or second link" in page.text


def test_a_result_without_people_witnesses_or_stops(report: VerifyReport, tmp_path: Path) -> None:
    alone = verify(Scene(duration=0.3).write(tmp_path / "r.mcap"), Cell.from_table(CELL), assume_nobody=True)
    nothing = np.full(report.cycles, np.nan, np.float32)
    rows = report.per_cycle
    never = PerCycle(
        rows.t,
        np.zeros_like(rows.status),
        np.full_like(rows.reason, int(Reason.BEYOND_END)),
        nothing,
        nothing,
    )
    empty = replace(report, per_cycle=never, first_witness=None, deepest=None, tightest=None, stills={})
    empty = replace(empty, contradicted=(), refused=(), refused_total=0, refused_for=())
    for each in (alone, empty):
        page = parse(verification_page(each))
        assert unreadable(page) == [] and fetched(page) == []
        assert "No pair was compared." in page.text and "nothing to draw" in page.text
    assert "1 waivers" in parse(verification_page(alone)).text


def test_a_body_part_without_bound_has_no_metres(tmp_path: Path) -> None:
    scene = Scene(
        duration=0.3, people={"p1": lambda _t: np.full((20, 3), np.nan), "p2": lambda _t: person_at(4.0, 0.0)}
    )
    page = parse(verification_page(verify(scene.write(tmp_path / "r.mcap"), Cell.from_table(CELL))))
    assert unreadable(page) == [] and "No metres can be counted" in page.text
    assert not re.search(r"\b(nan|inf|None)\b", page.first("main").text)


@pytest.mark.parametrize(
    ("value", "text"), [(1.0, "1"), (-0.001, "0"), (0.125, "0.12"), (100.0, "100"), (-2.5, "-2.5")]
)
def test_coordinates_are_short(value: float, text: str) -> None:
    assert decimal(value) == text


def test_texts_and_attributes_are_never_markup() -> None:
    made = node("p", "a<b", node("b", "c"), "d&e", class_="x\x00y")
    assert made.text == "a<b" and made[0].tail == "d&e" and made.get("class") == "x\\x00y"
    assert node("p", "a\x1b[31m", node("b"), "\u202e").text == "a\\x1b[31m"
    assert node("p", node("b"), "\u202e")[0].tail == "\\u202e"


def test_the_hull_is_that_of_all_points(rng: np.random.Generator) -> None:
    for n in (1, 2, 3, 8, 30):
        points = rng.normal(size=(n, 2))
        corners = np.array(convex_hull(np.vstack([points, points[:1]])))
        if len(corners) < 3:
            assert len(corners) == min(n, 2)
            continue
        steps = np.roll(corners, -1, axis=0) - corners
        for point in points:
            to = point - corners
            assert (steps[:, 0] * to[:, 1] - steps[:, 1] * to[:, 0] >= -1e-9).all()


# ------------------------------------------------------------------------------------------ command line


def test_the_command_writes_text_json_and_page_of_one_run(shell: Shell, recording: Path, cell: Path) -> None:
    html, table = recording.with_name("p.html"), recording.with_name("p.json")
    status, out, err = shell("verify", recording, "--cell", cell, "--report", html, "--json", table)
    assert (status, err) == (0, "") and f"wrote {table} and {html}" in out.replace("\n", " ")
    page, printed = parse(html.read_bytes()), json.loads(table.read_text())
    assert all(resolve(printed, pointer) == value for pointer, value, _text in numbers(page))
    pointers = [pointer for pointer, *_ in numbers(page)]
    assert [item["what"] for item in printed["inputs"]] == ["recording", "cell"]
    assert pointers.count("/inputs/0/bytes") == pointers.count("/inputs/1/bytes") == 1
    assert page.first("pre").text.split("\n") == out.splitlines()[:-1]


def test_a_page_is_not_overwritten(shell: Shell, recording: Path, cell: Path) -> None:
    html = recording.with_name("p.html")
    html.write_text("mine")
    assert "exists already" in refused(shell("verify", recording, "--cell", cell, "--report", html))
    assert html.read_text() == "mine"
    assert shell("verify", recording, "--cell", cell, "--report", html, "--force")[0] == 0
    assert html.read_bytes().startswith(b"<!DOCTYPE html>")
    assert [path.name for path in recording.parent.glob(".*partial")] == []


def test_a_page_that_fails_leaves_nothing(
    shell: Shell, recording: Path, cell: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(_report: VerifyReport) -> bytes:
        raise OSError(28, "No space left on device", "p.html")

    monkeypatch.setattr("verifier.judging_commands.verification_page", fails)
    html = recording.with_name("p.html")
    assert "No space left" in refused(shell("verify", recording, "--cell", cell, "--report", html))
    assert not html.exists() and not list(recording.parent.glob(".*partial"))


@pytest.mark.parametrize(
    ("value", "told"),
    [
        ("-", "cannot go to standard output"),
        ("", "the name is empty"),
        ("missing/p.html", "folder does not exist"),
    ],
)
def test_a_page_that_cannot_be_written_is_refused_before_the_work(
    shell: Shell, recording: Path, cell: Path, value: str, told: str
) -> None:
    path = value if value in ("-", "") else recording.parent / value
    assert told in refused(shell("verify", recording, "--cell", cell, f"--report={path}"))


def test_a_page_is_called_one(shell: Shell, recording: Path, cell: Path) -> None:
    """Before the work: a table that is a page would be found out late."""
    path = recording.with_name("r.json")
    assert "r.json: is a page; its name must end in .html" in refused(
        shell("verify", recording, "--cell", cell, f"--report={path}")
    )
    assert not path.exists()


def test_one_page_is_of_one_belief(shell: Shell, recording: Path, cell: Path) -> None:
    html = recording.with_name("p.html")
    assert "--report is about one run" in refused(
        shell("verify", recording, "--cell", cell, "--compare", "--report", html)
    )
