"""Scenarios: experiments of papers that plug-ins bring, as entry points of ``stopproof.scenarios``.

An entry point names a function that takes a progress report (told the share that is done) and returns a
:class:`ScenarioReport`.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from traceback import extract_tb
from typing import Protocol

from robots.errors import SetupError
from verifier.plug_ins import find_plug_in, plug_in_names

GROUP = "stopproof.scenarios"
Progress = Callable[[float], None]


class ScenarioReport(Protocol):
    """What a scenario found."""

    def lines_of_text(self) -> Sequence[str]:
        """Return what is printed."""
        ...

    def to_dict(self) -> Mapping[str, object]:
        """Return what ``--json`` gets."""
        ...

    def pictures(self) -> Mapping[str, bytes]:
        """Return pictures, by the names of their files; drawn when this is called."""
        ...


Scenario = Callable[[Progress], ScenarioReport]


def scenario_names() -> tuple[str, ...]:
    """Return the names of the scenarios that are installed."""
    return plug_in_names(GROUP)


def load_scenario(name: str) -> Scenario:
    """Return the installed scenario of that name.

    Raises
    ------
    SetupError
        There is none, or it cannot be loaded.
    """
    found = find_plug_in(GROUP, name, "scenario")
    try:
        scenario: Scenario = found.load()
    except Exception as error:
        why = f"{type(error).__name__}: {error}"
        raise SetupError(f"scenario {name!r} ({found.value}) cannot be loaded: {why}") from error
    if not callable(scenario):
        raise SetupError(f"scenario {name!r} cannot be run: its entry point names no function")
    return scenario


class ScenarioError(Exception):
    """A scenario raised, or returned what is no report; says which one, what and where."""


@contextmanager
def blaming(name: str) -> Iterator[None]:
    """Give the name of a scenario to whatever is raised within; input that it refuses stays as it is."""
    try:
        yield
    except (SetupError, ScenarioError):
        raise
    except Exception as error:
        last = extract_tb(error.__traceback__)[-1]
        where = f"{last.filename}, line {last.lineno}"
        raise ScenarioError(f"scenario {name!r}: {type(error).__name__}: {error} ({where})") from error


def run_scenario(name: str, scenario: Scenario, progress: Progress) -> ScenarioReport:
    """Run a scenario.

    Raises
    ------
    ScenarioError
        It raised, or did not return a report.
    """
    with blaming(name):
        report = scenario(progress)
    for method in ("lines_of_text", "to_dict", "pictures"):
        if not callable(getattr(report, method, None)):
            kind = type(report).__name__
            raise ScenarioError(f"scenario {name!r} returned {kind}, which has no method {method}")
    return report


def document_of(name: str, report: ScenarioReport) -> dict[str, object]:
    """Return what ``--json`` gets, known to be writable.

    Raises
    ------
    ScenarioError
        It cannot be made, or is no JSON.
    """
    with blaming(name):
        document = dict(report.to_dict())
        json.dumps(document, allow_nan=False)
    return document
