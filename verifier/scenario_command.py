"""The command that runs a paper's experiments: scenario."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryFile

import click

from robots.errors import SetupError
from verifier.command_options import force_option, json_option
from verifier.output import print_lines, progress, write_bytes, write_json
from verifier.reports.picture import require_drawing
from verifier.scenario import (
    ScenarioError,
    ScenarioReport,
    blaming,
    document_of,
    load_scenario,
    run_scenario,
    scenario_names,
)
from verifier.targets import check_targets


@click.command()
@click.argument("name", required=False)
@json_option
@click.option(
    "--out", "folder", metavar="DIR", help="Draw the figures into this folder (needs the extra plot)."
)
@force_option
def scenario(name: str | None, json_path: str | None, folder: str | None, force: bool) -> int:
    """Run the experiments of a paper, its numbers beside ours; without NAME: list what there is.

    A scenario takes seconds to minutes. Exit status: 0, whatever the numbers are.
    """
    if name is None:
        if folder is not None:
            raise SetupError("--out: name the scenario whose figures are to be drawn")
        names = list(scenario_names())
        check_targets([("--json", json_path)], [], force=force)
        if json_path is not None:
            write_json(names, json_path, force=force)
        if json_path != "-":
            print_lines(names)
        return 0
    targets = check_targets([("--json", json_path)], [], force=force)
    run = load_scenario(name)
    with _folder(folder, json_path, force=force) as out:
        with progress("running (the first run on a machine compiles once)") as told:
            report = run_scenario(name, run, told)
        document = None if json_path is None else document_of(name, report)
        if json_path != "-":
            with blaming(name):
                lines = list(report.lines_of_text())
            print_lines(lines)
        if json_path is not None:
            write_json(document, json_path, force=force)
        written = [*targets.written, *(_draw(name, report, out) if out is not None else ())]
    if json_path != "-":
        print_lines(written)
    return 0


@contextmanager
def _folder(folder: str | None, json_path: str | None, *, force: bool) -> Iterator[Path | None]:
    """Make the folder where it is missing, before long work; it goes again if nothing came into it."""
    if folder is None:
        yield None
        return
    require_drawing()
    out = Path(folder)
    made = not out.exists()
    _check_folder(folder, json_path, force=force)
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise SetupError(f"--out {folder}: cannot be made ({error.strerror}); name another one") from error
    try:
        with TemporaryFile(dir=out):
            pass
    except OSError as error:
        why = f"nothing can be written there ({error.strerror})"
        raise SetupError(f"--out {folder}: {why}; name another folder") from error
    try:
        yield out
    finally:
        if made and not any(out.iterdir()):
            out.rmdir()


def _check_folder(folder: str, json_path: str | None, *, force: bool) -> None:
    """Refuse what is no folder, has files, or is also the name of a file."""
    out = Path(folder)
    if folder == "-":
        raise SetupError("--out -: pictures cannot go to standard output; name a folder (or ./-)")
    if not folder or (out.exists() and not out.is_dir()):
        raise SetupError(f"--out {folder!r}: is not a folder; name one, it is made where it is missing")
    if not force and out.exists() and any(out.iterdir()):
        raise SetupError(f"--out {folder}: has files already; name a new folder, or overwrite with --force")
    if json_path is None or json_path == "-":
        return
    path, place = Path(json_path).resolve(), out.resolve()
    if path == place or path in place.parents:
        raise SetupError(f"--json {json_path}: --out {folder} is to be a folder there; name another file")
    if path.suffix.lower() == ".png" and path.parent == place:
        raise SetupError(
            f"--json {json_path}: a picture in --out {folder} may be called so; name another file"
        )


def _draw(name: str, report: ScenarioReport, out: Path) -> list[str]:
    """Draw into a folder; return what is said of it."""
    with blaming(name):
        pictures = dict(report.pictures())
        for file in pictures:
            if Path(file).name != file or not file.endswith(".png"):
                raise ScenarioError(
                    f"scenario {name!r}: picture {file!r}: its name should be that of a .png file alone"
                )
    for file, picture in pictures.items():
        write_bytes(picture, out / file, force=True)
    return [f"wrote {out / file}" for file in pictures]
