"""What the scenario prints: the paper's numbers beside ours, and what an index below 1 does not say."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from importlib.metadata import version

import numpy as np
from numpy.typing import NDArray

from modes.speed.simulations import METHODS, Method, Run, mean_and_deviation, simulation

Array = NDArray[np.float64]

WINDOWS = {1: (15, 20), 2: (8, 22)}
"""Samples over which the paper's Table 1 takes the jerk."""
_STEP_S = 0.01
"""Of the scenes under the verifier."""
_DISCLAIMER = (
    "Simulated. Not a manufacturer's declaration, not a safety function, no performance level claimed; "
    "validate by measurement."
)


@dataclass(frozen=True, slots=True)
class Paper:
    """Numbers that the paper prints (section IV, Table 1, section V)."""

    goal_sample: int = 29
    index_20: float = 0.7596
    index_29: float = 0.994
    speed_9: float = -49.88
    speed_10: float = -10.79
    jerk: Mapping[tuple[int, str], tuple[float, float]] = field(
        default_factory=lambda: {
            (1, "proposed"): (-267.307, 216.218), (1, "hwang"): (-287.956, 436.477),
            (1, "morato"): (833.333, 2041.241), (2, "proposed"): (-1.533, 1462.905),
            (2, "hwang"): (0.0, 56694.670), (2, "morato"): (0.0, 3273.268),
        }
    )  # fmt: skip
    collides: Mapping[tuple[str, float], bool] = field(
        default_factory=lambda: {
            (name, value): (name, value) in {("penalty", 1.0), ("closeness", 100.0), ("smoothness", 100.0)}
            for name in ("penalty", "closeness", "smoothness")
            for value in (1.0, 10.0, 100.0)
        }
    )


@dataclass(frozen=True, slots=True, eq=False)
class Watched:
    """A scene under the supervisor.

    Attributes
    ----------
    scene, mode:
        Which one; whether the mode proposed speeds, or the supervisor was alone.
    contact:
        Whether power and force limiting was declared for hands and arms; otherwise separation for everybody.
    alone_s, goal_s:
        When the goal is reached with nobody around, and in this run [s]; NaN: it is not.
    stood_s:
        How long the arm stood still [s].
    stop_time_s:
        Longest stop of a plan of the motion with nobody around [s].
    nearest_moving_m:
        Least gap between the two balls while the arm moved [m]; inf: it never moved with a hand in sight.
    highest_index, highest_index_moving:
        Of the danger index; while the arm moved.
    contacts_while_moving:
        Steps in which the balls overlapped while the arm moved.
    speed_m_s, danger_index, separation_m, required_m:
        Of each step, 10 ms apart: of the end effector; gap of the balls (inf: nobody in sight); S_p at that
        speed (0: at rest).
    """

    scene: str
    mode: bool
    contact: bool
    alone_s: float
    goal_s: float
    stood_s: float
    stop_time_s: float
    nearest_moving_m: float
    highest_index: float
    highest_index_moving: float
    contacts_while_moving: int
    speed_m_s: Array
    danger_index: Array
    separation_m: Array
    required_m: Array

    def to_dict(self) -> dict[str, object]:
        """Return what ``--json`` gets."""
        return {
            "scene": self.scene,
            "mode": self.mode,
            "contact_declared": self.contact,
            "alone_s": _number(self.alone_s),
            "goal_s": _number(self.goal_s),
            "stood_s": self.stood_s,
            "stop_time_s": _number(self.stop_time_s),
            "nearest_moving_m": _number(self.nearest_moving_m),
            "highest_danger_index": self.highest_index,
            "highest_danger_index_moving": self.highest_index_moving,
            "contacts_while_moving": self.contacts_while_moving,
        }


@dataclass(frozen=True, slots=True, eq=False)
class SpeedReport:
    """Everything that the scenario found.

    Attributes
    ----------
    simulations:
        Number -> method -> run.
    sweeps:
        (weight, value) -> run of simulation 1.
    experiments:
        Number -> ``proposed`` and ``none``.
    watched:
        Scenes under the supervisor, each alone and with the mode.
    required_m:
        S_p at the programmed speed of the simulations [m].
    hands:
        Simulation -> ``(samples, 3)``: where its hand is [m].
    paper:
        What it prints.
    """

    simulations: Mapping[int, Mapping[Method, Run]]
    sweeps: Mapping[tuple[str, float], Run]
    experiments: Mapping[int, Mapping[Method, Run]]
    watched: tuple[Watched, ...]
    required_m: float
    hands: Mapping[int, Array]
    paper: Paper = field(default_factory=Paper)

    def to_dict(self) -> dict[str, object]:
        """Return what ``--json`` gets; index k of a list is sample k, sample 0 being the start."""
        return {
            "version": version("stopproof"),
            "disclaimer": _DISCLAIMER,
            **{
                f"simulation_{n}": {m: _run(r, n) for m, r in runs.items()}
                for n, runs in self.simulations.items()
            },
            "sweeps": [
                {"weight": name, "value": value, "highest_danger_index": float(r.danger_index.max())}
                for (name, value), r in self.sweeps.items()
            ],
            **{
                f"experiment_{n}": {
                    m: {"goal_sample": r.goal_sample, "highest_danger_index": float(r.danger_index.max())}
                    for m, r in runs.items()
                }
                for n, runs in self.experiments.items()
            },
            "required_distance_m": self.required_m,
            "under_the_verifier": [each.to_dict() for each in self.watched],
        }

    def pictures(self) -> Mapping[str, bytes]:
        """Return the paper's figures 3 to 9 and 11, and two of the scenes under the verifier."""
        from modes.speed.pictures import draw

        return draw(self)

    def lines_of_text(self) -> list[str]:
        """Return what is printed."""
        return [
            "speed alteration (Chan and Tsai 2020): the paper's numbers beside ours",
            "",
            *self._simulation_lines(),
            "",
            *self._jerk_lines(),
            "",
            *self._sweep_lines(),
            "",
            *self._experiment_lines(),
            "",
            *self._verifier_lines(),
            "",
            _DISCLAIMER,
        ]

    def _simulation_lines(self) -> list[str]:
        paper, (one, two) = self.paper, (self.simulations[1], self.simulations[2])
        rows = [
            ("goal reached at sample", f"{paper.goal_sample}", *(f"{r.goal_sample}" for r in _both(one))),
            (
                "danger index at sample 20",
                f"{paper.index_20:.4f}",
                *_cells(one, lambda r: r.danger_index[19]),
            ),
            ("danger index at sample 29", f"{paper.index_29:.4f}", *_at_goal(one)),
            ("largest danger index", "below 1", *(_down(r.danger_index.max()) for r in _both(one))),
            (
                "speed at sample 9 [mm/s]",
                f"{paper.speed_9:.2f}",
                *_cells(two, lambda r: 1e3 * r.speed[8], ".2f"),
            ),
            (
                "speed at sample 10 [mm/s]",
                f"{paper.speed_10:.2f}",
                *_cells(two, lambda r: 1e3 * r.speed[9], ".2f"),
            ),
        ]
        lines = [f"{'simulations (speeds: of the second)':46}{'paper':>12}{'exact':>12}{'genetic':>12}"]
        return lines + [f"{name:46}{a:>12}{b:>12}{c:>12}" for name, a, b, c in rows]

    def _jerk_lines(self) -> list[str]:
        lines = [f"{'jerk [mm/s³], mean and SD':46}{'paper':>24}{'ours':>24}"]
        for n, runs in self.simulations.items():
            first, last = WINDOWS[n]
            for method in METHODS[1:]:
                theirs = self.paper.jerk.get((n, "proposed" if method == "genetic" else method))
                shown = "" if theirs is None else f"{theirs[0]:.3f} / {theirs[1]:.3f}"
                mean, deviation = mean_and_deviation(runs[method].jerk(first, last))
                name = f"simulation {n}, samples {first}-{last}: {method.replace('_', ', ')}"
                ours = f"{mean:.3f} / {deviation:.3f}"
                lines.append(f"{name:46}{shown:>24}{ours:>24}")
        return [
            *lines,
            "  hwang: its index is not in the paper; ours in its place never slows the arm. With a negative",
            "  programmed speed the printed (13) rewards deviation, from one end of the cap to the other.",
        ]

    def _sweep_lines(self) -> list[str]:
        lines = [f"{'simulation 1, weights':46}{'paper':>12}{'largest danger index':>24}"]
        for (name, value), r in self.sweeps.items():
            theirs = "above 1" if self.paper.collides[name, value] else "below 1"
            lines.append(f"{f'  {name} {value:g}':46}{theirs:>12}{_down(r.danger_index.max()):>24}")
        return lines

    def _experiment_lines(self) -> list[str]:
        lines = [f"{'experiments (hands are made up)':46}{'without':>12}{'with':>12}"]
        for n, runs in self.experiments.items():
            without, proposed = runs["none"].danger_index.max(), runs["proposed"].danger_index.max()
            lines.append(f"{f'  {n}: largest danger index':46}{_down(without):>12}{_down(proposed):>12}")
        return lines

    def _verifier_lines(self) -> list[str]:
        nearest = min(float(run["proposed"].gap.min()) for run in self.simulations.values())
        at_goal = float(self.simulations[1]["proposed"].gap[-1])
        stop = self.watched[0].stop_time_s
        lines = [
            "what an index below 1 does not say",
            f"  with the method alone surfaces come within {1e3 * nearest:.2f} mm in the simulations, and",
            f"  are {1e3 * at_goal:.2f} mm apart at the goal, where the paper prints an index of 0.994.",
            f"  At the programmed 50 mm/s the arm needs up to {1e3 * stop:.0f} ms to stop, and S_p of "
            f"ISO/TS 15066 is {1e3 * self.required_m:.0f} mm.",
            "",
            "the same scenes under the verifier (ISO 13855, 2.0 m/s; each alone, then with the mode)",
            *_watched_lines([each for each in self.watched if not each.contact]),
            "",
            "with power and force limiting declared for hands and arms, which the arm may touch",
            *_watched_lines([each for each in self.watched if each.contact]),
        ]
        return lines


def _watched_lines(those: Sequence[Watched]) -> list[str]:
    """Return a table of scenes under the verifier."""
    lines = [
        f"{'  scene':22}{'mode':>6}{'goal, nobody':>14}{'goal':>9}{'stood':>9}{'index, moving':>15}"
        f"{'gap, moving':>13}{'in contact':>12}"
    ]
    for each in those:
        goal = "never" if math.isnan(each.goal_s) else f"{each.goal_s:.1f} s"
        gap = "-" if math.isinf(each.nearest_moving_m) else f"{each.nearest_moving_m:.3f} m"
        lines.append(
            f"  {each.scene:20}{'yes' if each.mode else 'no':>6}{each.alone_s:>12.1f} s{goal:>9}"
            f"{each.stood_s:>7.1f} s{each.highest_index_moving:>15.3f}{gap:>13}"
            f"{_STEP_S * each.contacts_while_moving:>10.2f} s"
        )
    return lines


def _down(index: float) -> str:
    """Return an index with four digits, rounded down: none below 1 is shown as 1."""
    return f"{math.floor(1e4 * index) / 1e4:.4f}"


def _both(runs: Mapping[Method, Run]) -> tuple[Run, Run]:
    return runs["proposed"], runs["genetic"]


def _cells(runs: Mapping[Method, Run], value: Callable[[Run], float], form: str = ".4f") -> list[str]:
    return [format(float(value(r)), form) for r in _both(runs)]


def _at_goal(runs: Mapping[Method, Run]) -> list[str]:
    return [f"{r.danger_index[28]:.4f}" if len(r.danger_index) > 28 else "-" for r in _both(runs)]


def _run(run: Run, number: int) -> dict[str, object]:
    mean, deviation = mean_and_deviation(run.jerk(*WINDOWS[number]))
    index, speed = run.danger_index, 1e3 * run.speed
    return {
        "goal_sample": run.goal_sample,
        "danger_index": [float(index[0]), *index.tolist()],
        "speed_mm_s": [1e3 * simulation(number).programmed, *speed.tolist()],
        "jerk_mean": mean,
        "jerk_sd": deviation,
    }


def _number(value: float) -> float | None:
    return value if math.isfinite(value) else None
