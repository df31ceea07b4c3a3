"""Scenarios: experiments of papers that plug-ins bring, as entry points of ``stopproof.scenarios``.

An entry point names a function that takes a progress report (told the share that is done) and returns a
:class:`ScenarioReport`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
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
    except (ImportError, AttributeError, SyntaxError) as error:
        raise SetupError(f"scenario {name!r} cannot be loaded: {error}") from error
    if not callable(scenario):
        raise SetupError(f"scenario {name!r} cannot be run: its entry point names no function")
    return scenario
