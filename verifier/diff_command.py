"""The command that compares results of `verify`, or stop reports."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import partial

import click

from robots.errors import SetupError
from verifier.changes import TOLERANCE
from verifier.command_options import force_option, json_option
from verifier.output import print_lines, write_bytes, write_json
from verifier.reports.difference import MOST_RESULTS, VerifyComparison, compare_results
from verifier.reports.html.side_by_side import side_by_side_page
from verifier.reports.html.stop_side_by_side import stop_side_by_side_page
from verifier.reports.stop_difference import StopReportComparison, compare_stop_reports
from verifier.result import WRITTEN_BY as VERIFY
from verifier.result import verify_result
from verifier.result_file import ResultFile
from verifier.stop_report.read_back import WRITTEN_BY as STOP_REPORT
from verifier.stop_report.read_back import is_stop_report, stop_report_result
from verifier.targets import check_targets, require_page


@click.command()
@click.argument("results", nargs=-1, required=True, metavar="A.json B.json [C.json…]")
@click.option(
    "--tolerance",
    type=float,
    default=TOLERANCE,
    show_default=True,
    help="Metres and seconds that count as no change.",
)
@click.option("--report", "page", metavar="F.html", help="Write a page with the results side by side.")
@json_option
@force_option
def diff(
    results: Sequence[str], tolerance: float, page: str | None, json_path: str | None, force: bool
) -> int:
    """Say what changed between results of `verify --json`, or stop reports; each is held against A.

    Exit status: 0 nothing changed; 1 something did. Computing time, versions and the names of files are not
    compared.
    """
    if not 2 <= len(results) <= MOST_RESULTS:
        raise SetupError(f"diff: compares 2 to {MOST_RESULTS} results, not {len(results)}")
    if not 0.0 <= tolerance < math.inf:
        raise SetupError(f"--tolerance {tolerance:g}: must be finite and not negative")
    inputs = [("result", path) for path in results]
    targets = check_targets([("--json", json_path), ("--report", page)], inputs, force=force)
    require_page(("--report", page))
    comparison, as_page = _compare(results, tolerance)
    if json_path is not None:
        write_json(comparison.to_dict(), json_path, force=force)
    if page is not None:
        write_bytes(as_page(), page, force=force)
    if json_path != "-":
        print_lines([*comparison.lines(), *targets.written])
    return comparison.exit_status


def _compare(
    paths: Sequence[str], tolerance: float
) -> tuple[VerifyComparison | StopReportComparison, Callable[[], bytes]]:
    """Return what changed, and what makes the page of it."""
    files = [ResultFile(path, f"{VERIFY} or {STOP_REPORT}") for path in paths]
    stops = [is_stop_report(file) for file in files]
    if any(stops):
        if not all(stops):
            one, other = files[stops.index(True)], files[stops.index(False)]
            raise SetupError(f"{one} is a stop report and {other} is none: compare results of one command")
        found = compare_stop_reports(paths, [stop_report_result(file) for file in files], tolerance)
        return found, partial(stop_side_by_side_page, found)
    compared = compare_results(paths, [verify_result(file) for file in files], tolerance)
    return compared, partial(side_by_side_page, compared)
