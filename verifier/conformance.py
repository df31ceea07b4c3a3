"""Recorded people against models and profiles, and profiles from recorded people (docs/conformance.md)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from occupancy.body import Profile, load_profile, profile_names
from occupancy.containment import Containment, contain
from occupancy.humans.catalog import MODEL_NAMES, build_models
from occupancy.identification import identify
from occupancy.recorded import Recorded, read_people
from robots.assumption import Assumption
from robots.errors import SetupError
from verifier.recordings.errors import RecordingError
from verifier.recordings.people_source import Place, open_people

POSITION_ERROR_M: Final = 0.004
"""Of points whose file states none [m]: what the marker systems of the public tools assume."""
BASE: Final = "extreme"
"""Profile that gives an identified one what its recordings do not show."""
ABOUT_NOBODY_SEEN: Final = ("unobserved",)
"""Models that say nothing about people who were seen: a recording of those is no test of them."""


@dataclass(frozen=True, eq=False)
class RecordedFile:
    """A file of people as the gate read it; where its position error comes from, and what was left out."""

    path: Path
    people: Recorded
    position_error_m: float
    stated: str
    notes: tuple[str, ...]

    @property
    def name(self) -> str:
        """The file's name without its endings."""
        return self.path.name.removesuffix(".gz").rsplit(".", 1)[0]

    @property
    def samples(self) -> int:
        """Samples of all persons."""
        return sum(len(track.marked) for track in self.people.tracks.values())

    @property
    def marked(self) -> int:
        """Samples that the gate marks."""
        return sum(int(np.count_nonzero(track.marked)) for track in self.people.tracks.values())

    def seconds(self, person: str, sample: int) -> float:
        """Time of a sample of a person from the first report [s], as ``--at`` takes it."""
        return float(self.people.tracks[person].samples.t[sample]) - self.people.reports[0].stamp


@dataclass(frozen=True, eq=False)
class Result:
    """One model of one profile on one file: an entry per horizon."""

    file: RecordedFile
    model: str
    profile: str
    horizons: tuple[Containment, ...]


def open_profile(name: str) -> Profile:
    """Load a bundled profile by its name, or a file that ends in .toml.

    Raises
    ------
    ProfileError
        If there is none, or it cannot be used.
    """
    return load_profile(Path(name) if name.endswith(".toml") else name)


def open_profiles(names: Sequence[str], identify: str | None = None) -> list[Profile]:
    """Load profiles that are told apart by their names.

    Parameters
    ----------
    names:
        Bundled ones by name, files by their path.
    identify:
        File of a profile that is made beside them, if any: it is called as the file is.

    Raises
    ------
    SetupError
        There is none, it cannot be used, or two of them are called the same.
    """
    found = [open_profile(name) for name in names]
    called = [profile.name for profile in found] + ([] if identify is None else [Path(identify).stem])
    for name in called:
        if called.count(name) > 1:
            raise SetupError(f"two of the profiles are called {name!r}: name each once")
    return found


def bundled_profiles() -> list[Profile]:
    """Load every bundled profile."""
    return [load_profile(name) for name in profile_names()]


def open_recordings(
    paths: Sequence[str], profiles: Sequence[Profile], position_error_m: float | None
) -> list[RecordedFile]:
    """Read files of people; a sample is marked if neither ``profiles`` nor the bundled ones allow it.

    Raises
    ------
    SetupError
        A file is refused, stands there twice, or shows nobody; the position error [m] is not usable.
    """
    if len({Path(path).resolve() for path in paths}) < len(paths):
        raise SetupError("a file of people stands there twice: name each once")
    known = [*bundled_profiles(), *profiles]
    return [_opened(Path(path), known, position_error_m) for path in paths]


def _opened(path: Path, profiles: Sequence[Profile], position_error_m: float | None) -> RecordedFile:
    source = open_people(path, None, {})
    error, stated = source.position_error_m, "stated by the file"
    if error is None and position_error_m is not None:
        error, stated = position_error_m, "stated by the user"
    elif error is None:
        error, stated = POSITION_ERROR_M, "default"
    reports = [report.measurement(0) for report in source.reports(Place(), error)]
    people = read_people(reports, profiles, error)
    if not people.tracks:
        why = "; ".join(f"{n} points: {reason}" for reason, n in sorted(people.refused.items()))
        said = "shows nobody: no point of any person could be read"
        raise RecordingError(path, "", f"{said} ({why})" if why else said)
    notes = [
        f"{a.certainty}: {a.name} = {a.value} {a.unit}".rstrip() + f" ({a.source})"
        for a in source.assumptions
    ]
    if source.counts.unknown_points:
        notes.append(
            f"point names that are not known and were ignored: {', '.join(source.counts.unknown_points)}"
        )
    return RecordedFile(path, people, error, stated, tuple(notes))


def models_of(profile: Profile, wanted: Sequence[str]) -> list[str]:
    """Return the names of the models that are tested with a profile; ``wanted``: those only.

    Raises
    ------
    SetupError
        A wanted model is not known, or no recording can test it.
    """
    for name in wanted:
        if name not in MODEL_NAMES:
            raise SetupError(f"there is no model of people {name!r}; known: {', '.join(MODEL_NAMES)}")
        if name in ABOUT_NOBODY_SEEN:
            raise SetupError(f"model {name} is about people who are not seen: recorded people cannot test it")
    names = [name for name in MODEL_NAMES if name in profile.models and name not in ABOUT_NOBODY_SEEN]
    return [name for name in names if not wanted or name in wanted]


def conform(
    files: Sequence[RecordedFile],
    profiles: Sequence[Profile],
    wanted: Sequence[str],
    *,
    every: int = 1,
    progress: Callable[[float], None] = lambda _share: None,
) -> list[Result]:
    """Hold every file against every model of every profile.

    Raises
    ------
    SetupError
        No wanted model follows from any of the profiles, or ``every`` is below 1.
    """
    pairs = [(profile, names) for profile in profiles if (names := models_of(profile, wanted))]
    if not pairs:
        of = ", ".join(profile.name for profile in profiles)
        raise SetupError(f"none of the models {', '.join(wanted)} follows from the profiles {of}")
    built = [(profile, build_models(profile, names), names) for profile, names in pairs]
    work = [(file, *each) for file in files for each in built]
    total = sum(file.samples for file, *_ in work)
    done = 0
    results: list[Result] = []
    for file, profile, models, names in work:

        def show(share: float, before: int = done, of: int = file.samples) -> None:
            progress((before + share * of) / total)

        found = contain(file.people, profile, models, every=every, progress=show)
        done += file.samples
        results += [
            Result(file, name, profile.name, tuple(rows)) for name, rows in zip(names, found, strict=True)
        ]
    return results


def identified(files: Sequence[RecordedFile], path: str, margin: float) -> tuple[str, tuple[Assumption, ...]]:
    """Return the text of a profile file that allows what the files show, and its numbers.

    Raises
    ------
    SetupError
        The path has another ending than .toml or no word as its name, the margin is not usable, or the files
        show no motion.
    """
    name = Path(path).stem
    if Path(path).suffix != ".toml":
        raise SetupError(f"--identify {path}: must end in .toml")
    if not name.replace("-", "_").isidentifier() or name in profile_names():
        raise SetupError(
            f"profile {name}: must be a word, and none of the bundled {', '.join(profile_names())}"
        )
    base = load_profile(BASE)
    numbers = identify([(file.path.name, file.people) for file in files], base, name, margin)
    errors = sorted({f"{file.position_error_m:g}" for file in files})
    title = (
        f"identified from {len(files)} recordings, position error {', '.join(errors)} m, margin {margin:g}: "
        "no limit for other people or tasks"
    )
    return _toml(name, title, base.models, numbers), numbers


def _toml(name: str, title: str, models: Sequence[str], numbers: Sequence[Assumption]) -> str:
    """Return a profile file."""
    lines = [
        "# What some people did in some recordings, with a margin: no limit for other people or tasks.",
        f"name = {_text(name)}",
        f"title = {_text(title)}",
        f"models = [{', '.join(map(_text, models))}]",
    ]
    table = ""
    for number in numbers:
        place, _, key = number.name.removeprefix(f"people.{name}.").rpartition(".")
        if place != table:
            lines += ["", f"[{place}]"]
            table = place
        value = (
            f"value = {number.value!r}, unit = {_text(number.unit)}, certainty = {_text(number.certainty)}"
        )
        lines.append(f"{key} = {{ {value}, source = {_text(number.source)} }}")
    return "\n".join(lines) + "\n"


def _text(value: str) -> str:
    """Return a TOML string; what does not print, and quotes, escaped."""
    escaped = value.replace("\\", "\\\\").replace('"', '\\"')
    return '"' + "".join(c if c.isprintable() else f"\\U{ord(c):08x}" for c in escaped) + '"'
