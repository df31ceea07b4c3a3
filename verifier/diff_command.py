"""The command that compares results of `verify`."""

from __future__ import annotations

import math
from collections.abc import Sequence

import click

from robots.errors import SetupError
from verifier.command_options import force_option, json_option
from verifier.difference import TOLERANCE
from verifier.output import print_lines, write_bytes, write_json
from verifier.reports.difference import MOST_RESULTS, compare_results
from verifier.reports.html.side_by_side import side_by_side_page
from verifier.result import read_result
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
    """Say which cycles and numbers changed between results of `verify --json`; each is held against A.

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
    comparison = compare_results(results, [read_result(path) for path in results], tolerance)
    if json_path is not None:
        write_json(comparison.to_dict(), json_path, force=force)
    if page is not None:
        write_bytes(side_by_side_page(comparison), page, force=force)
    if json_path != "-":
        print_lines([*comparison.lines(), *targets.written])
    return comparison.exit_status
