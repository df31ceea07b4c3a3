"""The command that runs a paper's experiments: scenario."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryFile

import click

from robots.errors import SetupError
from verifier.command_options import force_option, json_option
from verifier.output import print_lines, progress, write_bytes, write_json
from verifier.reports.picture import require_drawing
from verifier.scenario import load_scenario, scenario_names
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

    Exit status: 0, whatever the numbers are.
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
    out = None if folder is None else _folder(folder, force=force)
    if out is not None and json_path is not None and _is_picture_of(out, json_path):
        raise SetupError(
            f"--json {json_path}: a picture in --out {folder} may be called so; name another file"
        )
    with progress("running (the first run on a machine compiles once)") as told:
        report = run(told)
    written = list(targets.written)
    if json_path is not None:
        write_json(dict(report.to_dict()), json_path, force=force)
    if out is not None:
        for file, picture in report.pictures().items():
            _check_picture(name, file)
            write_bytes(picture, out / file, force=True)
            written.append(f"wrote {out / file}")
    if json_path != "-":
        print_lines([*report.lines_of_text(), *written])
    return 0


def _folder(folder: str, *, force: bool) -> Path:
    """Return the folder, made where it is missing, before long work."""
    require_drawing()
    out = Path(folder)
    if folder == "-":
        raise SetupError("--out -: pictures cannot go to standard output; name a folder (or ./-)")
    if not folder or (out.exists() and not out.is_dir()):
        raise SetupError(f"--out {folder!r}: is not a folder; name one, it is made where it is missing")
    if not force and out.exists() and any(out.iterdir()):
        raise SetupError(f"--out {folder}: has files already; name a new folder, or overwrite with --force")
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise SetupError(f"--out {folder}: cannot be made ({error.strerror}); name another one") from error
    try:
        with TemporaryFile(dir=out):
            pass
    except OSError as error:
        raise SetupError(
            f"--out {folder}: nothing can be written there ({error.strerror}); name another folder"
        ) from error
    return out


def _check_picture(name: str, file: str) -> None:
    """Refuse names of pictures that lead out of the folder, or say that they are something else."""
    if Path(file).name != file or not file.endswith(".png"):
        raise SetupError(f"scenario {name!r}: its picture {file!r} should have the name of a .png file alone")


def _is_picture_of(out: Path, json_path: str) -> bool:
    """Whether a picture in a folder may have the name of a file."""
    path = Path(json_path)
    return path.suffix.lower() == ".png" and path.resolve().parent == out.resolve()
