"""The command line: exit status, one-line refusals, piped output, files written whole or not at all."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from tests.verifier.scenes import Scene, person_at
from verifier.__main__ import main
from verifier.recordings import Recording

ROOT = Path(__file__).parents[2]


class Shell:
    """Runs the command line in this process."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
        self._monkeypatch = monkeypatch
        self._capsys = capsys

    def __call__(self, *arguments: object) -> tuple[int, str, str]:
        self._monkeypatch.setattr(sys, "argv", ["stopproof", *map(str, arguments)])
        with pytest.raises(SystemExit) as stop:
            main()
        out, err = self._capsys.readouterr()
        return int(stop.value.code or 0), out, err


@pytest.fixture
def shell(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Shell:
    return Shell(monkeypatch, capsys)


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    return Scene(duration=1.0).write(tmp_path / "r.mcap")


@pytest.fixture
def cell(tmp_path: Path) -> Path:
    path = tmp_path / "cell.toml"
    path.write_text('[robot]\nbare_flange = true\naccept_assumed = ["limits"]\n')
    return path


def refused(result: tuple[int, str, str]) -> str:
    status, out, err = result
    assert status == 2, err
    assert out == ""
    assert err.startswith("stopproof: ") and err.count("\n") == 1
    assert "Traceback" not in err
    return err


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
    picture = tmp_path / "p.png"
    assert shell("verify", recording, "--cell", cell, "--out", out, "--picture", picture)[0] == 0
    topics = {topic.name: topic.messages for topic in Recording(out).topics}
    assert topics["/verdict"] == 100
    assert topics["/joint_states"] == 126
    assert picture.read_bytes().startswith(b"\x89PNG")
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
        (["verify", "{recording}", "--tool", "none.toml"], "none.toml"),
        (["verify", "{recording}", "--cell", "none.toml"], "none.toml"),
        (["verify"], "Missing argument"),
        (["verify", "{recording}", "--frobnicate"], "No such option"),
        (["inspect", "{cell}"], "not an MCAP file"),
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
    filled = [str(a).format(recording=recording, cell=cell) for a in arguments]
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
        ("[robot.tracking]\ndelay_min_s = 0.2", "at least"),
        ("[robot]\nname = 'ur5'\nurdf = 'x.urdf'", "not both"),
        ("[robot]\nname = '____'", "line 2"),
        ("[robot.limits.knee]\nvelocity_rad_s = 1.0", "knee"),
        ("[robot.limits.elbow_joint]\nvelocity_rad_s = -1.0", "greater than 0"),
        ("[robot.limits.elbow]", "bad.toml: robot.limits.elbow: no such commanded joint"),
        ("[robot.limits.elbow_joint]\njerk_rad_s3 = 1e308", "jerk_rad_s3 = 1e+308 is beyond 1e+06"),
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
            "bad.toml: robot.enclosure.forearm_link.radius_m = 1e+300 must be",
        ),
        ("[robot.mount]\nxyz_m = [1e300, 0, 0]", "robot.mount.xyz_m.0 = 1e+300: Input should be less"),
        ('[robot]\ntool = "a\\u0000b"', "cannot be read"),
        ('[robot]\nurdf = "a\\u0000b"', "neither a file"),
        (f"[people]\nlatency_s = 1{'0' * 400}", "people.latency_s"),
        (f"[people]\nlatency_s = 1{'0' * 5000}", "bad.toml: not a TOML file"),
        (f"[people]\nignored_parts = {'[' * 5000}{']' * 5000}", "bad.toml: not a TOML file"),
        ("[robot", "TOML"),
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


def test_robots_lists_and_prints_cards(shell: Shell) -> None:
    status, out, _err = shell("robots")
    assert status == 0
    assert {"ur3", "ur5", "ur10", "panda", "lwa4p"} <= set(out.split())
    for name in out.split():
        status, card, _err = shell("robots", name)
        assert status == 0
        assert ("acceleration" in card and "assumed" in card) or name == "panda"


def test_internal_error_is_70(shell: Shell, recording: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_arguments: object, **_options: object) -> None:
        raise RuntimeError("a bug")

    monkeypatch.setattr("verifier.__main__.verify_recording", broken)
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
    table.write_text("t,j1\n0.0,0.0\n0.01,0.001\n0.02,0.002\n")
    status, _out, err = shell("import", tmp_path / "o.mcap", "--robot", urdf, "--joints", table)
    assert (status, err) == (0, "")
