"""The command line: exit status, one-line refusals, piped output, files written whole or not at all."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from occupancy.body import PART_NAMES
from tests.conftest import Some
from tests.verifier.scenes import Scene, person_at
from tests.verifier.shell import Shell, refused
from verifier.cell import Cell
from verifier.commands import COMMANDS, cli
from verifier.recordings import Recording, new_recording

ROOT = Path(__file__).parents[2]


def test_everything_verified_is_0(shell: Shell, recording: Path, cell: Path) -> None:
    status, out, err = shell("verify", recording, "--cell", cell)
    assert (status, err) == (0, "")
    first, second, *_rest = out.splitlines()
    assert first == "stop: path-consistent (this software's) · profile: iso (2 m/s) · waived: nothing"
    assert second.startswith("verified in the model: ") and second.endswith("under A1–A7")


def test_not_verified_is_1_and_names_the_pair(shell: Shell, tmp_path: Path, cell: Path) -> None:
    near = Scene(duration=1.0, people={"anna": lambda _t: person_at(0.8, 0.0)}).write(tmp_path / "near.mcap")
    status, out, _err = shell("verify", near, "--cell", cell)
    assert status == 1
    assert "first witness: " in out and "anna" in out
    assert "where the metres go" in out and "shrink first: " in out


def test_waivers_are_3_and_listed(shell: Shell, recording: Path) -> None:
    status, out, _err = shell("verify", recording)
    assert status == 3
    assert "no tool declared" in out.splitlines()[0]
    assert shell("verify", recording, "--bare-flange")[0] == 3  # limits are still assumed


def test_json_on_standard_output_is_all_there(shell: Shell, recording: Path, cell: Path) -> None:
    status, out, _err = shell("verify", recording, "--cell", cell, "--json", "-")
    assert status == 0
    result = json.loads(out)
    assert result["cycles"] == len(result["per_cycle"]["status"])
    assert result["recording"] == "r.mcap"


def test_files_are_not_overwritten_unless_told(
    shell: Shell, recording: Path, cell: Path, tmp_path: Path
) -> None:
    target = tmp_path / "result.json"
    target.write_text("mine")
    text = refused(shell("verify", recording, "--cell", cell, "--json", target))
    assert "--force" in text
    assert target.read_text() == "mine"
    assert shell("verify", recording, "--cell", cell, "--json", target, "--force")[0] == 0
    assert json.loads(target.read_text())["robot"] == "ur5"


def test_out_is_a_copy_with_verdicts(shell: Shell, recording: Path, cell: Path, tmp_path: Path) -> None:
    out = tmp_path / "judged.mcap"
    picture = tmp_path / "p.pdf"
    assert shell("verify", recording, "--cell", cell, "--out", out, "--picture", picture)[0] == 0
    topics = {topic.name: topic.messages for topic in Recording(out).topics}
    assert topics["/verdict"] == 100
    assert topics["/joint_states"] == 126
    assert picture.read_bytes().startswith(b"%PDF-")
    assert shell("verify", out, "--cell", cell)[0] == 0


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["verify", "nothing.mcap"], "does not exist"),
        (["verify", "{recording}", "--robot", "ur6"], "must agree"),
        (["verify", "{recording}", "--robot", "panda"], "must agree"),
        (["verify", "{recording}", "--human", "crystal_ball"], "models"),
        (["verify", "{recording}", "--profile", "hero"], "profile"),
        (["verify", "{recording}", "--stop-model", "hope"], "path_consistent"),
        (["verify", "{recording}", "--tool", "none.toml"], "none.toml: does not exist"),
        (["verify", "{recording}", "--cell", "none.toml"], "none.toml: does not exist"),
        (["init", "--robot", "ur5", "--joint-limits", "none.yaml"], "none.yaml: does not exist"),
        (["verify"], "Missing argument"),
        (["verify", "{recording}", "--frobnicate"], "No such option"),
        (["inspect", "{cell}"], "not an MCAP file; it ends in .toml as files of cells and tools do"),
        (["verify", "{result}"], "not an MCAP file; it ends in .json as results do, which `stopproof diff`"),
        (["robots", "hal9000"], "hal9000"),
        (["init"], "RECORDING or --robot"),
        (["init", "--robot", "hal9000"], "hal9000"),
        (["import", "{recording}", "--robot", "ur5", "--joints", "none.npz"], ""),
        (["import", "o.mcap", "--robot", "ur5", "--joints", "{cell}", "--place", 0, 0, 0, 0], "pair"),
        (["dance"], "No such command"),
    ],
)
def test_bad_input_is_2_with_one_line(
    shell: Shell, recording: Path, cell: Path, arguments: list[object], told: str
) -> None:
    result = recording.with_name("result.json")
    result.write_text("{}")
    filled = [str(a).format(recording=recording, cell=cell, result=result) for a in arguments]
    assert told in refused(shell(*filled))


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("cycle_s = -0.01", "cycle_s"),
        ("cycle = 0.01", "unknown key"),
        ("[people]\nlatency_ms = 50", "unknown key"),
        ("[people]\nlatency_s = '50 ms'", "number"),
        ("[people]\nlatency_s = nan", "finite"),
        ("[people]\napproach_speed_m_s = 1.0", "1.6 and 2.0"),
        ("[people]\nignored_parts = ['tail']", "tail"),
        (f"[people]\nignored_parts = {list(PART_NAMES)}", "ignored_parts: these are all there are"),
        ("[robot.tracking]\ndelay_min_s = 0.2", "at least"),
        ("[robot]\nname = 'ur5'\nurdf = 'x.urdf'", "not both"),
        ("[robot]\nname = '____'", "line 2"),
        ("[robot.limits.knee]\nvelocity_rad_s = 1.0", "knee"),
        ("[robot.limits.elbow_joint]\nvelocity_rad_s = -1.0", "must be above 0"),
        ("[robot.limits.elbow]", "bad.toml: robot.limits.elbow: no such commanded joint"),
        (
            "[robot.limits.elbow_joint]\njerk_rad_s3 = 1e308",
            "jerk_rad_s3 = 1e+308: must be at most 1000000",
        ),
        (
            "[robot.limits.elbow_joint]\nposition_lower_rad = 4",
            "bad.toml: robot.limits.elbow_joint: lower position limit 4 (declared in the setup) must be",
        ),
        ("[robot]\njoints = ['knee']", "bad.toml: robot.joints: no moving joint is called 'knee'"),
        (
            "[robot.enclosure.nose]\na_m = [0, 0, 0]\nb_m = [0, 0, 1]\nradius_m = 1",
            "bad.toml: robot.enclosure.nose: no link is called 'nose'",
        ),
        (
            "[robot.enclosure.forearm_link]\na_m = [0, 0, 0]\nb_m = [0, 0, 1]\nradius_m = 1e300",
            "bad.toml: robot.enclosure.forearm_link.radius_m = 1e+300: must be at most",
        ),
        ("[robot.mount]\nxyz_m = [1e300, 0, 0]", "robot.mount.xyz_m.0 = 1e+300: must be at most"),
        ('[robot]\nurdf = "a\\u0000b"', "null character"),
        (f"[people]\nlatency_s = 1{'0' * 400}", "people.latency_s"),
        (f"[people]\nlatency_s = 1{'0' * 5000}", "bad.toml: not a TOML file"),
        (f"[people]\nignored_parts = {'[' * 5000}{']' * 5000}", "bad.toml: not a TOML file"),
        ("[robot", "TOML"),
        ("cycle_s = 1" + "0" * 400, "cycle_s = inf: must be a finite number"),
        ("cycle_s = " + "1" * 5000, "thousands of digits"),
        ("cycle_s = " + "[" * 5000 + "]" * 5000, "nested too deeply"),
        (".".join("a" * 3000) + " = 1", "nested too deeply"),
        (
            "[robot.tracking]\nposition_error_rad = 'x'",
            "= 'x': must be a number or \"measured\"",
        ),
        ("[robot.tracking]\nposition_error_rad = -1", "position_error_rad = -1.0: must be at least"),
        ("[robot.tracking]\nposition_error_rad = 11", "must be at most 10"),
        ("[robot.tracking]\nvelocity_error_rad_s = 101", "must be at most 100"),
        ("[robot.tracking]\ndelay_max_s = 11", "must be at most 10"),
        ("[robot.limits.elbow_joint]\nvelocity_rad_s = 1e7", "must be at most 1000000"),
        ("[robot.limits.elbow_joint]\nposition_lower_rad = -1e7", "must be at least -1000000"),
        ("[robot.mount]\nxyz_m = [1e300, 0, 0]", "xyz_m.0 = 1e+300"),
        ('[robot]\ntool = "a\\u0000b"', "null character"),
        ("[people.frames.world]\nxyz_m = [0, 0, 1]", "world is the frame"),
        ("[people.frames.camera]\ntranslation_error_m = 11", "must be at most 10"),
        ("[people]\nlatency_s = 60", "latency_s = 60.0: must be at most 10"),
        ("[people]\nclock_error_s = 11", "must be at most 10"),
        ("[people]\nstamp_error_s = 11", "must be at most 10"),
        ("[people]\nposition_error_m = 11", "must be at most 10"),
        ("[people]\nheld_object_m = 11", "must be at most 10"),
        ("[people]\nmax_report_gap_s = 1e9", "must be at most 3600"),
    ],
)
def test_bad_cell_is_2_with_place_and_rule(
    shell: Shell, recording: Path, tmp_path: Path, text: str, told: str
) -> None:
    path = tmp_path / "bad.toml"
    path.write_text(text)
    message = refused(shell("verify", recording, "--cell", path))
    assert told in message


def test_init_prints_a_cell_that_asks_to_be_filled(shell: Shell, recording: Path, tmp_path: Path) -> None:
    status, out, _err = shell("init", recording)
    assert status == 0
    assert 'name = "ur5"' in out and "____" in out
    path = tmp_path / "cell.toml"
    path.write_text(out)
    assert "fill in every ____: line 9: tool" in refused(shell("verify", recording, "--cell", path))
    filled = out.replace('tool = "____"', "bare_flange = true").replace(
        "latency_s = ____", "latency_s = 0.03"
    )
    path.write_text(filled.replace("accept_assumed = []", 'accept_assumed = ["limits"]'))
    assert shell("verify", recording, "--cell", path)[0] == 0


@pytest.mark.parametrize(("offset", "error"), [("0±0.01", "0.01"), ("0.1+-0.00005", "5e-05"), ("0.1", None)])
def test_init_writes_the_clock_error_that_verify_demands_of_an_import(
    shell: Shell, tmp_path: Path, offset: str, error: str | None
) -> None:
    source, path, cell = Scene().write(tmp_path / "r.mcap"), tmp_path / "o.mcap", tmp_path / "cell.toml"
    files = ("--joints", source, "--people", source)
    _status, out, err = shell("import", path, "--robot", "ur5", *files, "--time-offset", offset)
    asked = f"note: verify asks for people.clock_error_s of at least {error} in the cell"
    assert err == "" and (asked in out) == (error is not None)
    text = shell("init", path)[1]
    assert ("  # error of the time offset that the recording was made with\n" in text) == (error is not None)
    assert ("\n# clock_error_s = 0.0  " in text) == (error is None)
    text = text.replace('tool = "____"', "bare_flange = true").replace("____", "0.03")
    cell.write_text(text.replace("accept_assumed = []", 'accept_assumed = ["limits"]'))
    assert Cell.from_toml(cell).people.clock_error_s == float(error or 0)
    assert "verified in the model: " in shell("verify", path, "--cell", cell)[1]


def test_init_refuses_a_recording_of_nothing(shell: Shell, tmp_path: Path) -> None:
    with new_recording(tmp_path / "empty.mcap"):
        pass
    assert "empty.mcap: an empty recording" in refused(shell("init", tmp_path / "empty.mcap"))


def test_frames_that_only_the_cell_can_place_are_pointed_out(shell: Shell, tmp_path: Path) -> None:
    camera = Scene(duration=0.5, frame="hall camera").write(tmp_path / "camera.mcap")
    assert "look at: reports in frame 'hall camera'" in shell("inspect", camera)[1]
    _status, out, _err = shell("init", camera)
    assert '[people.frames."hall camera"]' in out
    filled = out.replace('tool = "____"', "bare_flange = true").replace(
        "latency_s = ____", "latency_s = 0.03"
    )
    path = tmp_path / "cell.toml"
    path.write_text(filled.replace("accept_assumed = []", 'accept_assumed = ["limits"]'))
    assert "xyz_m = [____, ____, ____]" in refused(shell("verify", camera, "--cell", path))
    path.write_text(path.read_text().replace("____", "0.0"))
    assert shell("verify", camera, "--cell", path)[0] == 0


def test_verify_names_the_files_it_wrote(shell: Shell, recording: Path, tmp_path: Path) -> None:
    out = tmp_path / "r.json"
    assert shell("verify", recording, "--bare-flange", "--json", out)[1].endswith(f"wrote {out}\n")


def test_robots_lists_and_prints_cards(shell: Shell, some: Some) -> None:
    status, out, _err = shell("robots")
    assert status == 0
    e_series = {"ur3e", "ur5e", "ur10e", "ur16e"}
    assert set(out.split()) == {"ur3", "ur5", "ur10", "panda", "lwa4p", "kr5_sixx", "ra605", "fr3"} | e_series
    for name in some(out.split(), 5):
        status, card, _err = shell("robots", name)
        assert status == 0
        assert ("acceleration" in card and "assumed" in card) or name == "panda"
        assert ("endlessly" in card) == (name in ("ur3", "ur3e"))


def test_without_a_command_the_help_is_printed_and_nothing_counts_as_verified(shell: Shell) -> None:
    status, out, err = shell()
    assert (status, out) == (2, "")
    assert err.startswith("Usage: stopproof ") and "\n  verify " in err


@pytest.mark.parametrize("name", COMMANDS)
def test_the_help_of_the_program_says_what_the_command_says_of_itself(name: str) -> None:
    command = cli.commands[name]
    assert command.name == name
    assert command.get_short_help_str(limit=200) == COMMANDS[name].summary


def test_every_command_is_in_the_help_of_the_program() -> None:
    assert list(COMMANDS) == sorted(COMMANDS)
    modules = {path.stem for path in (ROOT / "verifier").glob("*_command*.py")} - {"command_options"}
    assert {place.module for place in COMMANDS.values()} == modules


def test_help_imports_no_command() -> None:
    code = "import sys\nfrom verifier.commands import run\nrun(['-h'])\nprint(*sys.modules, file=sys.stderr)"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert all(name in done.stdout for name in COMMANDS)
    imported = set(done.stderr.split())
    assert "verifier.commands" in imported and imported.isdisjoint(("numpy", "verifier.command_options"))


def test_the_list_of_robots_as_json(shell: Shell) -> None:
    status, out, _err = shell("robots", "--json", "-")
    assert status == 0
    assert json.loads(out) == shell("robots")[1].split()


@pytest.mark.parametrize(
    ("stated", "option", "given"),
    [
        ("[people]\nmodels = ['iso13855']", "--human", "arm_reach"),
        ("[people]\nprofile = 'iso'", "--profile", "hero"),
        ("[stop]\nmodel = 'path_consistent'", "--stop-model", "category_0"),
        ("[robot]\nname = 'ur5'", "--robot", "ur10"),
        ("[robot]\ntool = 'a.toml'", "--tool", "b.toml"),
    ],
)
def test_an_option_does_not_override_the_cell(
    shell: Shell, recording: Path, tmp_path: Path, stated: str, option: str, given: str
) -> None:
    path = tmp_path / "stated.toml"
    path.write_text(stated)
    text = refused(shell("verify", recording, "--cell", path, option, given))
    assert f"{option} {given}: the cell says " in text
    assert text.endswith("; they must agree\n")


def test_bare_flange_does_not_override_the_cell(shell: Shell, recording: Path, tmp_path: Path) -> None:
    path = tmp_path / "stated.toml"
    path.write_text("[robot]\nbare_flange = false")
    assert "they must agree" in refused(shell("verify", recording, "--cell", path, "--bare-flange"))


def test_options_that_say_what_the_cell_says_are_taken(shell: Shell, recording: Path, cell: Path) -> None:
    cell.write_text(
        cell.read_text() + "name = 'ur5'\n[people]\nmodels = ['iso13855']\nprofile = 'iso'\n"
        "[stop]\nmodel = 'path_consistent'\n"
    )
    same = ["--robot", "ur5", "--human", "iso13855", "--profile", "iso", "--stop-model", "path_consistent"]
    assert shell("verify", recording, "--cell", cell, *same, "--bare-flange")[0] == 0


def test_internal_error_is_70(shell: Shell, recording: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_arguments: object, **_options: object) -> None:
        raise RuntimeError("a bug")

    monkeypatch.setattr("verifier.judging_commands.verify_recording", broken)
    status, out, err = shell("verify", recording)
    assert (status, out) == (70, "")
    assert err == "stopproof: internal error: RuntimeError: a bug\n"


def test_a_reader_who_stops_does_not_change_the_status(recording: Path, cell: Path) -> None:
    command = [sys.executable, "-m", "verifier", "verify", str(recording), "--cell", str(cell)]
    run = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    assert run.stdout is not None and run.stderr is not None
    run.stdout.close()
    assert run.wait(timeout=300) == 0
    assert run.stderr.read() == b""
    run.stderr.close()


def test_a_recording_is_not_overwritten_by_its_own_verdicts(
    shell: Shell, recording: Path, cell: Path
) -> None:
    text = refused(shell("verify", recording, "--cell", cell, "--out", recording, "--force"))
    assert "is the recording itself" in text


def test_import_needs_no_limits(shell: Shell, tmp_path: Path) -> None:
    urdf = tmp_path / "arm.urdf"
    urdf.write_text(
        '<robot name="rail"><link name="base"/><link name="l1"/><joint name="j1" type="revolute">'
        '<parent link="base"/><child link="l1"/><axis xyz="0 0 1"/></joint></robot>'
    )
    table = tmp_path / "joints.csv"
    table.write_text("t,j1\n" + "".join(f"{n / 100},{n / 1000}\n" for n in range(6)))
    status, _out, err = shell("import", tmp_path / "o.mcap", "--robot", urdf, "--joints", table)
    assert (status, err) == (0, "")


def test_points_of_other_names_are_taken_by_import_and_missed_by_verify(shell: Shell, tmp_path: Path) -> None:
    source = Scene(duration=0.5).write(tmp_path / "r.mcap")
    out, cell = tmp_path / "o.mcap", tmp_path / "c.toml"
    rows = "".join(f"{k / 10},{k / 100},2.0,1.6,{k / 100},2.1,1.2\n" for k in range(30))
    (tmp_path / "p.csv").write_text("t,head_x,head_y,head_z,Left=W_x,Left=W_y,Left=W_z\n" + rows)
    make = ("import", out, "--robot", "ur5", "--joints", source, "--people", tmp_path / "p.csv", "--force")
    assert "were ignored: Left=W; --point-name Left=W=OURS takes one as ours" in shell(*make)[1]
    arm = '[robot]\nbare_flange = true\n[people.point_names]\n"Left=W" = "l_wrist"\n'
    cell.write_text(arm)
    missed = "note: people.point_names.Left=W: no report has a point of that name"
    assert missed in shell("verify", out, "--cell", cell)[1]
    _status, text, _err = shell(*make, "--point-name", "Left=W=l_wrist")
    assert "were ignored" not in text and "no file has" not in text
    assert "l_wrist" in shell("inspect", out)[1]
    cell.write_text(arm.replace("Left=W", "l_wrist"))
    assert "no report has" not in shell("verify", out, "--cell", cell)[1]
    for pair, told in (
        ("l_wrist", "it must be THEIRS=OURS, where ours are head, "),
        ("=l_wrist", "it must be THEIRS=OURS"),
        ("Left=W=wrist", "it must be THEIRS=OURS"),
    ):
        assert told in refused(shell(*make, "--point-name", pair))
    twice = ("--point-name", "a=head", "--point-name", "a=pelvis")
    assert "--point-name a: is both head and pelvis" in refused(shell(*make, *twice))


@pytest.mark.parametrize(
    ("option", "wrong"),
    [
        (("--place", "nan", "0", "0", "0"), "place nan 0.0 0.0 0.0: it must be three numbers within"),
        (("--position-error", "-1"), "position error -1.0 m: it must be at least 0 m"),
        (("--time-offset", "inf"), "time offset inf s: it must be within"),
    ],
)
def test_numbers_of_import_that_are_none_are_refused(
    shell: Shell, tmp_path: Path, option: tuple[str, ...], wrong: str
) -> None:
    source = Scene().write(tmp_path / "r.mcap")
    files = ("--joints", source, "--people", source)
    status, _out, err = shell("import", tmp_path / "o.mcap", "--robot", "ur5", *files, *option)
    assert status == 2 and wrong in err and err.count("\n") == 1
