"""Running the command line in this process."""

from __future__ import annotations

import signal
import sys
from collections.abc import Iterator

import pytest

from verifier.__main__ import main


class Shell:
    """Runs the command line and returns status, standard output and standard error."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
        self._monkeypatch = monkeypatch
        self._capsys = capsys

    def __call__(self, *arguments: object) -> tuple[int, str, str]:
        self._monkeypatch.setattr(sys, "argv", ["stopproof", *map(str, arguments)])
        with pytest.raises(SystemExit) as stop:
            main()
        out, err = self._capsys.readouterr()
        assert isinstance(stop.value.code, int)
        return stop.value.code, out, err


@pytest.fixture
def shell(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Iterator[Shell]:
    handlers = {number: signal.getsignal(number) for number in (signal.SIGTERM, signal.SIGHUP)}
    hook = sys.unraisablehook
    yield Shell(monkeypatch, capsys)
    sys.unraisablehook = hook
    for number, handler in handlers.items():
        signal.signal(number, handler)


def refused(result: tuple[int, str, str]) -> str:
    """The one line of a refusal."""
    status, out, err = result
    assert status == 2, err
    assert out == ""
    assert err.startswith("stopproof: ") and err.count("\n") == 1
    assert "Traceback" not in err
    return err
