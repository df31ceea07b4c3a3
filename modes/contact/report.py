"""What the contact scenario prints, writes and draws."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import version

import numpy as np
from numpy.typing import NDArray

from modes.contact.course import Course
from modes.contact.trials import Alarms, Broken, Delays
from modes.contact.twin import Body
from modes.contact.wrench import ToolLoad

Array = NDArray[np.float64]

_DISCLAIMER = (
    "Simulated, with masses, friction and noise that are made up. Not a manufacturer's declaration, not a "
    "safety function, no performance level claimed; validate by measurement."
)
PAPER_MM_N = 1000.0 / 300.0
"""1 / K of (19)."""
NOT_CHECKED = "pressure, edges and points"


@dataclass(frozen=True, slots=True)
class Done:
    """An experiment of the paper, and what came of it.

    Attributes
    ----------
    name, expected, observed:
        As in :mod:`modes.contact.experiments`.
    figures:
        Of the paper.
    """

    name: str
    expected: str
    observed: str
    figures: str

    @property
    def as_expected(self) -> bool:
        """Whether the machine went through the states that were expected, for the reasons expected."""
        return self.observed == self.expected

    def to_dict(self) -> dict[str, object]:
        """Return what ``--json`` gets."""
        return {
            "name": self.name,
            "expected": self.expected,
            "observed": self.observed,
            "as_expected": self.as_expected,
        }


@dataclass(frozen=True, slots=True)
class Declared:
    """Who may touch whom, slowly; separation holds for every other pair.

    Attributes
    ----------
    links:
        That may be touched.
    limits_m_s:
        Part of the body -> speed of a link against it that is allowed [m/s].
    """

    links: tuple[str, ...]
    limits_m_s: Mapping[str, float]

    def to_dict(self) -> dict[str, object]:
        """Return what ``--json`` gets."""
        return {
            "links": list(self.links),
            "parts": [{"part": part, "limit_m_s": limit} for part, limit in self.limits_m_s.items()],
            "every_other_pair": "separation",
            "not_checked": NOT_CHECKED,
        }


@dataclass(frozen=True, slots=True)
class Tracked:
    """By how much the simulated joints were not where, and not as fast as, the supervisor commanded.

    Attributes
    ----------
    position_rad, velocity_rad_s:
        Largest errors of any joint, at the ends of control steps.
    beyond:
        In how many control steps one of them was larger than the cell declares.
    declared_rad, declared_rad_s:
        What it declares.
    """

    position_rad: float
    velocity_rad_s: float
    beyond: int
    declared_rad: float
    declared_rad_s: float

    def to_dict(self) -> dict[str, object]:
        """Return what ``--json`` gets."""
        return {
            "position_error_rad": self.position_rad,
            "velocity_error_rad_s": self.velocity_rad_s,
            "declared_position_error_rad": self.declared_rad,
            "declared_velocity_error_rad_s": self.declared_rad_s,
            "steps_beyond": self.beyond,
        }


@dataclass(frozen=True, slots=True, eq=False)
class Guided:
    """Somebody walks up and guides the tool, under the supervisor.

    Attributes
    ----------
    links, latency_s:
        Which links hand and forearm may touch (empty: separation alone); bound of how late reports are [s].
    wanted_m, led_m:
        How far the hand wants to lead the tool, and how far it was when the hand let go [m].
    stood, on_stop:
        Share of the time in which it was held: at rest; on a verified stop, because the next plan was not
        verified.
    lacking:
        Why the first plan that was refused after a second was: who was too near whom, and by how much.
    states:
        Of the machine.
    tracked:
        What the drives made of the commands.
    t, place_m:
        Instants, and where the hand's place on the tool was ``(k, 3)`` [s, m].
    """

    links: tuple[str, ...]
    latency_s: float
    wanted_m: float
    led_m: float
    stood: float
    on_stop: float
    lacking: str
    states: str
    tracked: Tracked
    t: Array
    place_m: Array

    def to_dict(self) -> dict[str, object]:
        """Return what ``--json`` gets."""
        return {
            "links": list(self.links),
            "latency_s": self.latency_s,
            "wanted_m": self.wanted_m,
            "led_m": self.led_m,
            "share_stood": self.stood,
            "share_on_stop": self.on_stop,
            "lacking": self.lacking,
            "states": self.states,
            "tracking": self.tracked.to_dict(),
        }


@dataclass(frozen=True, slots=True, eq=False)
class ContactReport:
    """Everything that the scenario found.

    Attributes
    ----------
    compliance_mm_N:
        How far the tool yields at rest [mm/N].
    alarms:
        False ones.
    experiments, watched:
        The paper's, without and with the supervisor in between.
    tracked:
        What the drives made of the supervisor's commands in the latter.
    hits, broken, guided:
        Blows that were to be detected; sensors that broke; hands that guided the tool under the supervisor.
    declared:
        Who may touch whom, where contact is declared.
    load, body:
        What was identified of the tool, and what the arm is made of.
    course:
        Of ``experiments``, for the figures.
    """

    compliance_mm_N: float
    alarms: Alarms
    experiments: tuple[Done, ...]
    watched: tuple[Done, ...]
    tracked: Tracked
    hits: tuple[Delays, ...]
    broken: tuple[Broken, ...]
    guided: tuple[Guided, ...]
    declared: Declared
    load: ToolLoad
    body: Body
    course: Course

    def to_dict(self) -> dict[str, object]:
        """Return what ``--json`` gets."""
        return {
            "version": version("stopproof"),
            "disclaimer": _DISCLAIMER,
            "static_compliance_mm_per_N": self.compliance_mm_N,
            "false_alarms_per_hour": self.alarms.per_hour,
            "false_alarms": {
                "hours": self.alarms.hours,
                "left_task": self.alarms.left_task,
                "filters": [
                    {
                        "variant": name,
                        "detected": found,
                        "largest_share_of_a_threshold": self.alarms.largest_share[name],
                    }
                    for name, found in self.alarms.detected.items()
                ],
            },
            "experiments": [each.to_dict() for each in self.experiments],
            "experiments_under_the_verifier": [each.to_dict() for each in self.watched],
            "tracking_under_the_verifier": self.tracked.to_dict(),
            "detection_delays": [_delays(each) for each in self.hits],
            "sensor_faults": [_broken(each) for each in self.broken],
            "power_and_force_limiting": self.declared.to_dict(),
            "guided_under_the_verifier": [each.to_dict() for each in self.guided],
        }

    def pictures(self) -> Mapping[str, bytes]:
        """Return the paper's figures 4 to 9, the delays, and how far the tool was led."""
        from modes.contact.pictures import draw

        return draw(self)

    def lines_of_text(self) -> list[str]:
        """Return what is printed."""
        return [
            "contact (Mariotti, Magrini and De Luca 2019) on a simulated KR5 sixx",
            "",
            *_experiment_lines("the paper's experiments", self.experiments),
            "",
            *_experiment_lines("the same, every motion verified; nobody in the camera's sight", self.watched),
            *self._tracking_lines(),
            "",
            f"static compliance {self.compliance_mm_N:.3f} mm/N (1 / K: {PAPER_MM_N:.3f}); load identified "
            f"as {self.load.mass_kg:.3f} kg (it has {self.body.tool_kg:.3f} kg)",
            "",
            *self._alarm_lines(),
            "",
            *self._delay_lines(),
            "",
            *self._sensor_lines(),
            "",
            *self._guided_lines(),
            "",
            _DISCLAIMER,
        ]

    def _tracking_lines(self) -> list[str]:
        tracked = self.tracked
        lines = [
            f"  drives were off by up to {1e3 * tracked.position_rad:.1f} mrad, "
            f"{tracked.velocity_rad_s:.3f} rad/s; declared are {1e3 * tracked.declared_rad:.1f} mrad, "
            f"{tracked.declared_rad_s:.3f} rad/s",
        ]
        if tracked.beyond:
            lines.append(
                f"  in {tracked.beyond} control steps, hit, they were off by more: A2 does not hold there, "
                "nor what rests on it"
            )
        return lines

    def _alarm_lines(self) -> list[str]:
        alarms = self.alarms
        lines = [
            f"false alarms: the task was left {alarms.left_task} times in {alarms.hours:.2f} h in which "
            f"nobody touched the arm",
            f"  {'filters':14}{'detected':>10}{'largest share of a threshold':>32}",
        ]
        for name, found in alarms.detected.items():
            lines.append(f"  {name:14}{found:>10}{_down(alarms.largest_share[name]):>32}")
        return lines

    def _delay_lines(self) -> list[str]:
        lines = [
            "blows of 40 ms, level, from any side: how long until they are told",
            f"  {'on':14}{'peak':>8}{'blows':>8}{'detected':>10}{'median':>10}{'worst':>10}",
        ]
        for each in self.hits:
            ms = 1e3 * each.delays_s
            shown = (f"{np.median(ms):.0f} ms", f"{ms.max():.0f} ms") if len(ms) else ("-", "-")
            lines.append(
                f"  {each.spot:14}{each.peak_N:>6.0f} N{each.blows:>8}{len(ms):>10}"
                f"{shown[0]:>10}{shown[1]:>10}"
            )
        return lines

    def _sensor_lines(self) -> list[str]:
        lines = [
            "sensors that break, every motion verified",
            f"  {'fault':22}{'told after':>12}{'at rest after':>15}",
        ]
        for each in self.broken:
            told = "never" if math.isinf(each.told_s) else f"{1e3 * each.told_s:.0f} ms"
            rests = f"{1e3 * each.rests_s:.0f} ms" if each.moved else "never moved"
            lines.append(f"  {each.fault:22}{told:>12}{rests:>15}")
            lines.append(f"      {each.reason or 'no reason was given'}")
        return lines

    def _guided_lines(self) -> list[str]:
        lines = [
            "a person walks up and leads the tool aside, under the verifier (ISO 13855, 2.0 m/s)",
            f"  {'may touch':34}{'reports':>9}{'led':>14}{'stood':>8}{'on a stop':>11}   first refusal lacks",
        ]
        for each in self.guided:
            declared = f"hand, forearm: {_links(each.links)}" if each.links else "separation only"
            led = f"{1e3 * each.led_m:.0f} of {1e3 * each.wanted_m:.0f} mm"
            lines.append(
                f"  {declared:34}{1e3 * each.latency_s:>6.0f} ms{led:>14}{100.0 * each.stood:>6.0f} %"
                f"{100.0 * each.on_stop:>9.0f} %   {each.lacking or '-'}"
            )
        limits = ", ".join(f"{part} {limit:.2f} m/s" for part, limit in self.declared.limits_m_s.items())
        return [
            *lines,
            "  hand and forearm: power and force limiting for those parts beside "
            + ", ".join(self.declared.links),
            f"    ({limits});",
            "    separation for every other pair of link and part, and for these where a link is too fast.",
            f"    Not checked: {NOT_CHECKED}.",
        ]


def _links(names: Sequence[str]) -> str:
    """Return names of links, short."""
    return ", ".join(name.removeprefix("link_").removeprefix("tool:") for name in names)


def _down(share: float) -> str:
    """Return a share with two digits, rounded down: none below 1 is shown as 1."""
    return f"{math.floor(100.0 * share) / 100.0:.2f}"


def _experiment_lines(title: str, those: Sequence[Done]) -> list[str]:
    lines = [title]
    for each in those:
        mark = "as expected" if each.as_expected else f"NOT as expected: {each.expected}"
        figures = f" (fig. {each.figures})" if each.figures else ""
        lines += [f"  {each.name}{figures}", f"      {each.observed}: {mark}"]
    return lines


def _delays(each: Delays) -> dict[str, object]:
    ms = 1e3 * each.delays_s
    return {
        "on": each.spot,
        "peak_N": each.peak_N,
        "blows": each.blows,
        "detected": len(ms),
        "median_ms": float(np.median(ms)) if len(ms) else None,
        "worst_ms": float(ms.max()) if len(ms) else None,
    }


def _broken(each: Broken) -> dict[str, object]:
    return {
        "fault": each.fault,
        "expected": each.expected,
        "observed": each.reason,
        "as_expected": each.as_expected,
        "told_after_s": each.told_s if math.isfinite(each.told_s) else None,
        "at_rest_after_s": each.rests_s,
        "moved": each.moved,
    }
