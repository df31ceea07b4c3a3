"""The program as a process: streams that are closed, full or narrow, signals, what fails to load."""

from __future__ import annotations

import os
import shlex
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import pytest

from tests.verifier.shell import Shell, refused
from verifier import compiled_cache

ROOT = Path(__file__).parents[2]
STOPPROOF = f"{shlex.quote(sys.executable)} -m verifier"


def sh(script: str, folder: Path | str = ROOT, **environment: str) -> subprocess.CompletedProcess[bytes]:
    """Run a script in which ``stopproof`` is the program."""
    setting = {**os.environ, "PYTHONPATH": str(ROOT), **environment}
    script = script.replace("stopproof", STOPPROOF)
    return subprocess.run(
        ["sh", "-c", script], cwd=folder, env=setting, capture_output=True, timeout=300, check=False
    )


@pytest.mark.parametrize(
    ("script", "status"),
    [
        ("stopproof robots >&-", 0),
        pytest.param("stopproof robots --json - >&-", 0, marks=pytest.mark.rarely("lines and no JSON")),
        ("stopproof robots >&- 2>&- <&-", 0),
        pytest.param("stopproof robots hal9000 2>&-", 2, marks=pytest.mark.rarely("no command at all")),
        ("stopproof 2>&-", 2),
        ("stopproof robots > /dev/full", 2),
    ],
)
def test_streams_that_are_closed_or_full(script: str, status: int) -> None:
    done = sh(script)
    assert done.returncode == status
    assert b"Traceback" not in done.stderr and done.stderr.count(b"\n") <= 1


def test_a_closed_stream_is_not_taken_for_a_file(tmp_path: Path) -> None:
    done = sh("stopproof robots --json out.json >&- 2>&- <&-", tmp_path)
    assert done.returncode == 0
    assert (tmp_path / "out.json").read_text().endswith("]\n")


@pytest.mark.parametrize(
    "what",
    [
        pytest.param("--help", marks=pytest.mark.rarely("verify -h")),
        "verify -h",
        pytest.param("--version", marks=pytest.mark.rarely("verify -h")),
    ],
)
def test_whoever_stops_reading_the_help_does_not_change_its_status(what: str) -> None:
    reading, writing = os.pipe()
    os.close(reading)
    command = [sys.executable, "-m", "verifier", *what.split()]
    done = subprocess.run(command, cwd=ROOT, stdout=writing, stderr=subprocess.PIPE, timeout=300, check=False)
    os.close(writing)
    assert (done.returncode, done.stderr) == (0, b"")


@pytest.mark.parametrize(
    "setting",
    [
        pytest.param({"PYTHONIOENCODING": "ascii"}, marks=pytest.mark.rarely("a locale of ASCII")),
        {"LC_ALL": "C", "PYTHONUTF8": "0"},
    ],
)
def test_what_a_stream_cannot_spell_is_escaped(setting: dict[str, str]) -> None:
    done = sh("stopproof inspect 'Zoë '$(printf '\\377')'.mcap'", PYTHONCOERCECLOCALE="0", **setting)
    assert done.returncode == 2
    assert done.stderr.isascii() and done.stderr.endswith(b".mcap: does not exist; name an MCAP file\n")
    assert sh("stopproof robots ur5", PYTHONCOERCECLOCALE="0", **setting).returncode == 0


def test_a_folder_that_is_gone_is_named(tmp_path: Path) -> None:
    gone = tmp_path / "gone"
    gone.mkdir()
    done = sh('rmdir "$PWD"; stopproof robots --json x', gone)
    assert done.returncode == 2
    assert done.stderr.startswith(b"stopproof: the current folder: ") and done.stderr.count(b"\n") == 1
    gone.mkdir()
    assert sh('rmdir "$PWD"; stopproof robots', gone).returncode == 0


@pytest.mark.parametrize(("number", "said"), [(signal.SIGINT, b"the user"), (signal.SIGTERM, b"SIGTERM")])
def test_signals_while_the_program_loads(number: int, said: bytes) -> None:
    """From the moment that the first module is loaded, which is slowed down here."""
    slow = "import os, sys, time; sys.path.insert(0, os.getcwd()); sys.argv = ['', 'robots']; "
    slow += "import verifier.__main__ as m; "
    slow += "import builtins; real = builtins.__import__\n"
    slow += "def wait(name, *rest):\n    if name == 'numba': print(flush=True); time.sleep(60)\n"
    slow += "    return real(name, *rest)\nbuiltins.__import__ = wait\nm.main()"
    # a shell that runs this in the background has Ctrl-C ignored, and the program would inherit that
    run = subprocess.Popen(
        [sys.executable, "-c", slow],
        cwd=ROOT,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        preexec_fn=lambda: signal.signal(number, signal.SIG_DFL),  # noqa: PLW1509 - touches nothing but the signal
    )
    assert run.stdout is not None
    run.stdout.readline()
    time.sleep(0.1)
    run.send_signal(number)
    _out, err = run.communicate(timeout=60)
    assert run.returncode == 128 + number
    assert err == b"stopproof: stopped by " + said + b"\n"


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM], ids=["SIGINT", "SIGTERM"])
@pytest.mark.parametrize("then", ["raise RuntimeError('nothing was compiled')", "time.sleep(60)"])
def test_a_signal_while_a_library_calls_back_is_not_lost(number: int, then: str) -> None:
    """LLVM calls back while functions are compiled; what the handler raises there goes no farther."""
    script = f"""
import ctypes, signal, sys, time, types
import verifier.__main__ as program
called = ctypes.CFUNCTYPE(None)(lambda: signal.raise_signal({int(number)}))
def run(arguments):
    called()
    {then}
sys.modules["verifier.commands"] = types.SimpleNamespace(run=run)
program.main()
"""
    done = subprocess.run(
        [sys.executable, "-c", script],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=50,
        check=False,
        preexec_fn=lambda: signal.signal(number, signal.SIG_DFL),
    )
    by = "the user" if number == signal.SIGINT else "SIGTERM"
    assert (done.returncode, done.stdout, done.stderr) == (128 + number, "", f"stopproof: stopped by {by}\n")


def test_nothing_heavy_is_loaded_before_errors_are_caught() -> None:
    script = "import sys, verifier.__main__; print(*sys.modules)"
    done = subprocess.run(
        [sys.executable, "-c", script], cwd=ROOT, capture_output=True, text=True, check=True
    )
    loaded = set(done.stdout.split())
    assert not loaded & {"numba", "numpy", "click", "pydantic", "coal"}


def test_what_cannot_be_loaded_is_one_line(shell: Shell, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "verifier.commands", None)
    status, out, err = shell("robots")
    assert (status, out) == (70, "")
    assert err.startswith("stopproof: internal error: ModuleNotFoundError: ") and err.count("\n") == 1


@pytest.mark.parametrize(
    ("error", "status", "said"),
    [
        (PermissionError(13, "Permission denied", "people.csv"), 2, "people.csv: Permission denied"),
        (PermissionError(13, "Permission denied", b"p\xff"), 2, "p\\udcff: Permission denied"),
        (OSError(28, "No space left on device"), 2, "No space left on device"),
        (OSError("some\nreason"), 2, "some reason"),
        (SystemExit(1), 70, "internal error: SystemExit: 1"),
        (SystemExit(0), 70, "internal error: SystemExit: 0"),
        (KeyboardInterrupt(), 130, "stopped by the user"),
        (BrokenPipeError(32, "Broken pipe"), 2, "Broken pipe"),
        (MemoryError(), 70, "internal error: MemoryError: "),
        (RecursionError("x" * 100_000), 70, "internal error: RecursionError: x"),
    ],
)
def test_whatever_happens_ends_in_one_line(
    shell: Shell,
    recording: Path,
    monkeypatch: pytest.MonkeyPatch,
    error: BaseException,
    status: int,
    said: str,
) -> None:
    def broken(*_arguments: object, **_options: object) -> None:
        raise error

    monkeypatch.setattr("verifier.judging_commands.verify_recording", broken)
    result = shell("verify", recording)
    assert result[:2] == (status, "")
    assert result[2].startswith(f"stopproof: {said.rstrip()}")
    assert result[2].count("\n") == 1 and len(result[2]) < 1100


def test_a_command_without_a_status_does_not_count_as_verified(
    shell: Shell, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("verifier.commands.cli.invoke", lambda _context: None)
    assert shell("robots")[0] == 70


def test_a_name_that_is_too_long_is_refused(shell: Shell) -> None:
    assert "File name too long" in refused(shell("verify", "x" * 300))
    text = refused(shell("verify", "/".join(["x" * 200] * 30)))
    assert text.endswith(": File name too long\n") and len(text) < 1100


@pytest.fixture
def unset(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """A user's cache folder; none is chosen for numba."""
    monkeypatch.setenv("NUMBA_CACHE_DIR", "")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return tmp_path / "cache"


def test_compiled_code_stays_beside_its_source(unset: Path) -> None:
    compiled_cache.choose_folder()
    assert os.environ["NUMBA_CACHE_DIR"] == ""
    assert not unset.exists()


def test_compiled_code_goes_to_the_users_cache(unset: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    can_write = compiled_cache._can_write
    monkeypatch.setattr(
        compiled_cache, "_can_write", lambda path: ROOT not in path.parents and can_write(path)
    )
    compiled_cache.choose_folder()
    assert os.environ["NUMBA_CACHE_DIR"] == str(unset / "stopproof" / "numba")


def test_compiled_code_goes_to_a_folder_of_this_run(
    unset: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(compiled_cache, "_can_write", lambda _path: False)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    registered: list[tuple[object, ...]] = []
    monkeypatch.setattr(compiled_cache.atexit, "register", lambda *each, **_options: registered.append(each))
    compiled_cache.choose_folder()
    folder = Path(os.environ["NUMBA_CACHE_DIR"])
    assert folder.parent == tmp_path and folder.is_dir()
    assert registered[0][1] == str(folder)


def test_a_folder_that_the_user_chose_is_left_to_numba(
    unset: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "mine"))
    compiled_cache.choose_folder()
    assert os.environ["NUMBA_CACHE_DIR"] == str(tmp_path / "mine")
