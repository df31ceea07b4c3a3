"""Run the tests with all randomised counts and write the result to docs/results/.

python -m tests.full [--seed N] [--scale S] [--out FILE]
"""

from __future__ import annotations

import argparse
import os
import re
import subprocess
import sys
import time
from datetime import UTC, datetime
from pathlib import Path

ROOT = Path(__file__).parent.parent


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--scale", type=float, default=1.0)
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--out", type=Path, default=ROOT / "docs" / "results" / "full-counts.md")
    options = parser.parse_args()
    command = [sys.executable, "-m", "pytest", "-n", str(options.jobs), "--dist", "worksteal"]
    command += ["--seed", str(options.seed), "--scale", str(options.scale), "--durations", "25"]
    began = time.monotonic()
    lines = []
    with subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True) as run:
        assert run.stdout is not None
        for line in run.stdout:
            sys.stdout.write(line)
            sys.stdout.flush()
            lines.append(line)
    seconds = time.monotonic() - began
    options.out.parent.mkdir(parents=True, exist_ok=True)
    options.out.write_text(_page(options.seed, options.scale, seconds, "".join(lines)), encoding="utf-8")
    return run.returncode


def _page(seed: int, scale: float, seconds: float, output: str) -> str:
    commit = subprocess.run(
        ["git", "describe", "--always", "--dirty"], cwd=ROOT, capture_output=True, text=True, check=False
    ).stdout.strip()
    closing = [line for line in output.splitlines() if re.search(r"\d+ (passed|failed)", line)]
    slow = [line for line in output.splitlines() if re.match(r"\d+\.\d+s call", line)]
    real = "available" if os.environ.get("STOPPROOF_REAL_DATA") else "not available"
    return "\n".join(
        [
            "# All randomised counts",
            "",
            f"`python -m tests.full --seed {seed} --scale {scale:g}`",
            "",
            f"- commit: {commit}",
            f"- date: {datetime.now(UTC):%Y-%m-%d %H:%M} UTC",
            f"- duration: {seconds / 60.0:.1f} min on {os.cpu_count()} cores",
            f"- real recordings: {real}",
            f"- result: {closing[-1].strip('= ') if closing else 'pytest did not finish'}",
            "",
            "The longest tests:",
            "",
            "```",
            *slow,
            "```",
            "",
        ]
    )


if __name__ == "__main__":
    sys.exit(main())
