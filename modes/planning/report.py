"""What the proactive scenario prints, writes and draws."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import version

import numpy as np

from modes.planning.outcomes import Errors, Run, Setting
from modes.planning.trials import END_S, Trial

_DISCLAIMER = (
    "Simulated, with people, friction, drives and noise that are made up. Not a manufacturer's declaration, "
    "not a safety function, no performance level claimed; validate by measurement."
)
PAPERS = Setting(supervised=False, proposer="forecast")
"""As in the paper: nothing verifies, and forecasts shape the ways."""
_NAMES = {
    "fixed": "the straight way",
    "present": "the mode without forecasts",
    "forecast": "the mode with forecasts",
}
_SHOWN_S = (0.1, 0.5, 1.0)


@dataclass(frozen=True, slots=True)
class Summary:
    """What came of all trials in one setting.

    Attributes
    ----------
    setting:
        Which.
    trials, arrived:
        How many there were, and in how many the arm arrived in time.
    contacts:
        Trials in which a moving link touched somebody.
    clearance_m, least_m:
        Median and least gap between the person and moving links, over trials in which a clear way exists and
        somebody was within 1 m of one [m]; NaN: none.
    below:
        Trials in which a clear way exists, and a moving link was nearer than the clearance.
    lost_s:
        Median and largest of the time over that of the straight way alone [s]; who has not arrived lost all.
    standstills:
        How often the arm rested before its goal.
    halts, needed, ways:
        Stops of the mode because somebody was near the way ahead, how many were needed, and ways taken.
    """

    setting: Setting
    trials: int
    arrived: int
    contacts: int
    clearance_m: float
    least_m: float
    below: int
    lost_s: tuple[float, float]
    standstills: int
    halts: int
    needed: int
    ways: int

    def to_dict(self) -> dict[str, object]:
        """Return what ``--json`` gets."""
        return {
            "under_the_verifier": self.setting.supervised,
            "proposer": self.setting.proposer,
            "trials": self.trials,
            "arrived": self.arrived,
            "trials_with_contact_while_moving": self.contacts,
            "clearance_m": {"min": _number(self.least_m), "median": _number(self.clearance_m)},
            "below_clearance": self.below,
            "time_lost_s": {"median": self.lost_s[0], "max": self.lost_s[1]},
            "standstills": self.standstills,
            "halts": {"needed": self.needed, "not_needed": self.halts - self.needed},
            "ways": self.ways,
        }


@dataclass(frozen=True, slots=True, eq=False)
class ProactiveReport:
    """Everything that the scenario found.

    Attributes
    ----------
    trials, runs:
        All of them; each trial in each setting.
    with_clear_way:
        Numbers of the trials in which a way that keeps the clearance was found with the truth.
    clearance_m:
        That is wanted [m].
    forecaster:
        Name of the one that the mode had.
    errors:
        Of forecasts of these people; NaN: there was no forecast.
    alone_s:
        How long the straight way takes [s].
    """

    trials: tuple[Trial, ...]
    runs: tuple[Run, ...]
    with_clear_way: frozenset[int]
    clearance_m: float
    forecaster: str
    errors: tuple[Errors, ...]
    alone_s: float

    def of(self, setting: Setting) -> list[Run]:
        """Return the runs in a setting."""
        return [each for each in self.runs if each.setting == setting]

    def summary(self, setting: Setting) -> Summary:
        """Return what came of all trials in a setting."""
        runs = self.of(setting)
        lost = [min(each.arrived_s, END_S) - self.alone_s for each in runs]
        gaps = [each.moving_m for each in runs if each.number in self.with_clear_way]
        near = np.array([each for each in gaps if math.isfinite(each)])
        return Summary(
            setting=setting,
            trials=len(runs),
            arrived=sum(each.arrived for each in runs),
            contacts=sum(each.contacts > 0 for each in runs),
            clearance_m=float(np.median(near)) if len(near) else math.nan,
            least_m=float(near.min(initial=math.inf)) if len(near) else math.nan,
            below=sum(each < self.clearance_m for each in gaps),
            lost_s=(float(np.median(lost)), float(np.max(lost))) if lost else (0.0, 0.0),
            standstills=sum(each.standstills for each in runs),
            halts=sum(each.halts for each in runs),
            needed=sum(each.needed for each in runs),
            ways=sum(each.ways for each in runs),
        )

    @property
    def settings(self) -> tuple[Setting, ...]:
        """Return the settings in their order."""
        return tuple(dict.fromkeys(each.setting for each in self.runs))

    def to_dict(self) -> dict[str, object]:
        """Return what ``--json`` gets."""
        papers, runs = self.summary(PAPERS), self.of(PAPERS)
        verified = [self.summary(each) for each in self.settings if each.supervised]
        return {
            "version": version("stopproof"),
            "disclaimer": _DISCLAIMER,
            "trials": len(self.trials),
            "succeeded": papers.arrived,
            "violations": sum(each.contacts for each in verified),
            "planning_time_s": _median_max([s for each in runs for s in each.planning_s]),
            "trials_with_clear_path": len(self.with_clear_way),
            "clearance_m": {"min": _number(papers.least_m), "median": _number(papers.clearance_m)},
            "delay_s": _median_max([s for each in runs for s in each.decisions_s]),
            "forecaster": self.forecaster,
            "forecast_error_m": [each._asdict() for each in self.errors if math.isfinite(each.error_m)],
            "settings": [self.summary(each).to_dict() for each in self.settings],
        }

    def pictures(self) -> Mapping[str, bytes]:
        """Return the paper's figures 5 and 6, gaps and times of all trials, and errors of forecasts."""
        from modes.planning.pictures import draw

        return draw(self)

    def lines_of_text(self) -> list[str]:
        """Return what is printed."""
        return [
            "proactive avoidance (Mathiazhagan, Murugesan, Joshi and Arab) with a simulated UR16e",
            "",
            *self._table_i(),
            "",
            *self._setting_lines(),
            "",
            *self._error_lines(),
            "",
            _DISCLAIMER,
        ]

    def _table_i(self) -> list[str]:
        runs, summary = self.of(PAPERS), self.summary(PAPERS)
        planning = _median_max([s for each in runs for s in each.planning_s])
        delay = _median_max([s for each in runs for s in each.decisions_s])
        nodes = [n for each in runs for n in each.nodes]
        corners = [n for each in runs for n in each.corners]
        halted = sum(each.halts > 0 or each.ways > 1 for each in runs)
        rows = (
            ("planning time", "0.6 to 5.0 s (GPU)", _spread(planning)),
            ("nodes explored", "200", f"{_mean(nodes):.0f} (mean), at most {max(nodes, default=0)}"),
            ("nodes used", "73 (mean)", f"{_mean(corners) + 2.0:.1f} (mean): shortened"),
            (
                "least clearance", "275 mm",
                f"{_mm(summary.least_m)} moving, in {len(self.with_clear_way)} trials with a clear way",
            ),
            ("replans triggered", "100 %", f"in {100.0 * halted / max(len(runs), 1):.0f} % of the trials"),
            ("loop", "10 Hz", "10 Hz; the supervisor's 100 Hz"),
            ("from a view to a proposal", "below 200 ms", _spread(delay)),
        )  # fmt: skip
        return [
            f"Table I, {len(self.trials)} trials; nothing is verified here",
            f"  {'':28}{'the paper':22}here",
            *(f"  {name:28}{theirs:22}{ours}" for name, theirs, ours in rows),
        ]

    def _setting_lines(self) -> list[str]:
        lines = [
            f"the same trials in other settings; the straight way alone takes {self.alone_s:.2f} s",
            f"  {'':46}{'arrived':>9}{'touched':>9}{'below':>7}{'least gap':>11}{'time lost':>11}{'stops':>7}"
            f"{'halts needed':>14}",
        ]
        for setting in self.settings:
            each = self.summary(setting)
            name = f"{_NAMES[setting.proposer]}{', verified' if setting.supervised else ''}"
            lines.append(
                f"  {name:46}{each.arrived:>9}{each.contacts:>9}{each.below:>7}{_mm(each.least_m):>11}"
                f"{each.lost_s[0]:>9.2f} s{each.standstills:>7}"
                + (f"{f'{each.needed} of {each.halts}':>14}" if setting.proposer != "fixed" else f"{'-':>14}")
            )
        return [
            *lines,
            "  touched: trials in which a moving link touched somebody. below: trials in which a way with "
            f"{_mm(self.clearance_m)} exists,",
            "    and a moving link was nearer. time lost: median; who has not arrived within "
            f"{END_S:g} s counts as {END_S:g} s.",
        ]

    def _error_lines(self) -> list[str]:
        models = tuple(dict.fromkeys(each.model for each in self.errors))
        lines = [
            "mean error of forecasts of these people, as the camera sees them",
            f"  {'':22}" + "".join(f"{s:>9.1f} s" for s in _SHOWN_S),
        ]
        for model in models:
            found = {round(each.horizon_s, 1): each.error_m for each in self.errors if each.model == model}
            lines.append(f"  {model:22}" + "".join(f"{_mm(found.get(s, math.nan)):>11}" for s in _SHOWN_S))
        return lines


def _median_max(values: Sequence[float]) -> dict[str, float]:
    if not values:
        return {"median": 0.0, "max": 0.0}
    return {"median": float(np.median(values)), "max": float(np.max(values))}


def _spread(of: Mapping[str, float]) -> str:
    return f"{_ms(of['median'])}, at most {_ms(of['max'])}"


def _mean(values: Sequence[int]) -> float:
    return float(np.mean(values)) if values else 0.0


def _number(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _ms(seconds: float) -> str:
    return f"{1e3 * seconds:.0f} ms"


def _mm(metres: float) -> str:
    return f"{1e3 * metres:.0f} mm" if math.isfinite(metres) else "-"
