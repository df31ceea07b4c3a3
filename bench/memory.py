"""Peak memory and time of verifying a long recording.

    python -m bench.memory [--minutes M] [--json -]

Makes a synthetic recording (joints at 1 kHz, a person at 60 Hz) of M minutes and one of a sixth of that in a
temporary folder, and verifies each in a process of its own. Memory that grows with the length of a recording
shows in the difference. Times are processor time.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from unittest.mock import patch

MEGABYTE = 1e6
WARM_UP_MIN = 0.1
"""A recording that is verified first, so that what is not compiled yet is compiled there."""


def main() -> None:
    """Measure, and print the table or JSON; as a child process, do one part of it."""
    options = _options()
    if options.make is not None:
        _make(Path(options.make), 60.0 * options.minutes)
    elif options.verify is not None:
        json.dump(_verify(Path(options.verify)), sys.stdout)
    else:
        found = _measure(options.minutes)
        print(json.dumps(found, indent=1) if options.json == "-" else "\n".join(_lines(found)))


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="python -m bench.memory", description=(__doc__ or "").split("\n")[0]
    )
    parser.add_argument("--minutes", type=float, default=60.0, help="length of the recording [min]")
    parser.add_argument("--json", choices=["-"], help="write JSON to standard output")
    parser.add_argument("--make", help=argparse.SUPPRESS)
    parser.add_argument("--verify", help=argparse.SUPPRESS)
    return parser.parse_args()


def _measure(minutes: float) -> dict[str, Any]:
    """Run the parts in processes of their own: a child's peak begins with what its parent held."""
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for length in (WARM_UP_MIN, minutes / 6.0, minutes):
            path = str(Path(folder) / "long.mcap")
            _child("--make", path, "--minutes", str(length))
            size = Path(path).stat().st_size
            rows.append(
                {"minutes": length, "file_mb": size / MEGABYTE, **json.loads(_child("--verify", path))}
            )
            Path(path).unlink()
    return {"machine": json.loads(_child_code(_MACHINE)), "recordings": rows[1:]}


_MACHINE = "import json; from bench.machine import describe_machine; print(json.dumps(describe_machine()))"


def _child(*arguments: str) -> str:
    return subprocess.run(
        [sys.executable, "-m", "bench.memory", *arguments], check=True, stdout=subprocess.PIPE, text=True
    ).stdout


def _child_code(code: str) -> str:
    return subprocess.run([sys.executable, "-c", code], check=True, stdout=subprocess.PIPE, text=True).stdout


def _make(path: Path, seconds: float) -> None:
    from bench.recordings import write_long

    write_long(path, seconds)


def _verify(path: Path) -> dict[str, float]:
    """Run the command line's ``verify``, JSON included; return peaks [MB] and times [s]."""
    from bench.machine import keep_to_one_core
    from bench.recordings import DEMO_CELL
    from bench.stopwatch import processor_time
    from verifier.cell import Cell
    from verifier.commands import cli
    from verifier.verdict import Status

    keep_to_one_core()
    cell = Cell.from_toml(DEMO_CELL)
    peaks = {"peak_imported_mb": _peak_mb()}
    out = path.with_suffix(".json")
    command = ["verify", str(path), "--cell", str(DEMO_CELL), "--json", str(out)]
    with _observed() as seen, processor_time(), contextlib.redirect_stdout(io.StringIO()):
        cli.main(command, prog_name="stopproof", standalone_mode=False)
    peaks |= {"peak_verified_mb": seen["peak_mb"], "peak_mb": _peak_mb()}
    report = seen["report"]
    out.unlink()
    return {
        "cycles": report.cycles,
        "verified": report.count(Status.VERIFIED),
        **peaks,
        "computing_s": report.cycles * cell.cycle_s / report.real_time_factor,
        "decoding_s": seen["reading"].decode_seconds,
        "total_s": time.process_time(),
        "real_time_factor": report.real_time_factor,
    }


@contextlib.contextmanager
def _observed() -> Iterator[dict[str, Any]]:
    """Yield what reads the recording, the report, and the peak [MB] when there is one."""
    from verifier.recordings import Reading
    from verifier.run_log import RunLog

    seen: dict[str, Any] = {}
    windows, report = Reading.windows, RunLog.report

    def windows_observed(self: Reading, *arguments: Any) -> Any:
        seen["reading"] = self
        return windows(self, *arguments)

    def report_observed(*arguments: Any) -> Any:
        seen["report"], seen["peak_mb"] = report(*arguments), _peak_mb()
        return seen["report"]

    with patch.object(Reading, "windows", windows_observed), patch.object(RunLog, "report", report_observed):
        yield seen


def _peak_mb() -> float:
    """Largest resident set of this process so far [MB]; the system counts in kB (macOS: bytes)."""
    unit = 1 if sys.platform == "darwin" else 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit / MEGABYTE


def _lines(found: dict[str, Any]) -> Iterator[str]:
    machine = found["machine"]
    yield f"{machine['processor']}; one of them used. {machine['software']}"
    yield f"{machine['date']}, commit {machine['commit']}"
    yield ""
    columns = [f"{row['minutes']:.3g} min" for row in found["recordings"]]
    yield f"| {'recording of':<36} | " + " | ".join(f"{name:>10}" for name in columns) + " |"
    yield f"|{'-' * 38}|" + "|".join("-" * 11 + ":" for _ in columns) + "|"
    for label, key, form in (
        ("file, MB", "file_mb", "{:.0f}"),
        ("cycles", "cycles", "{}"),
        ("of them verified in the model", "verified", "{}"),
        ("peak memory after imports, MB", "peak_imported_mb", "{:.0f}"),
        ("peak memory after the last cycle, MB", "peak_verified_mb", "{:.0f}"),
        ("**peak memory, JSON written, MB**", "peak_mb", "{:.0f}"),
        ("computing, s", "computing_s", "{:.1f}"),
        ("reading and decoding, apart, s", "decoding_s", "{:.1f}"),
        ("everything, s", "total_s", "{:.1f}"),
        ("real-time factor", "real_time_factor", "{:.1f}"),
    ):
        values = " | ".join(f"{form.format(row[key]):>10}" for row in found["recordings"])
        yield f"| {label:<36} | {values} |"


if __name__ == "__main__":
    main()
