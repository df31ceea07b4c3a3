"""The loop: instants, deadlines, clean ends, on a clock that a test moves."""

from __future__ import annotations

import gc
import itertools
import math

import numpy as np
import pytest

from failsafe.silence import Silence
from robots.errors import SetupError
from tests.verifier.supervised import AWAY, AWAY_AND_BACK, CYCLE, HOME, scripted
from verifier.command import Cause, Command, State
from verifier.loop import Granted, Histogram, Loop, LoopSettings, MonotonicClock, ask_for_real_time
from verifier.proposal import NewTrajectory
from verifier.tracking import JointReading


class ToldClock:
    """Stands still unless it is told to go on; sleeping takes as long as it should, and ``overslept``."""

    def __init__(self, t: float = 1000.0) -> None:
        self.t, self.overslept = t, 0.0

    def now(self) -> float:
        return self.t

    def sleep_until(self, t: float) -> None:
        self.t = max(self.t, t) + self.overslept
        self.overslept = 0.0


class Cell:
    """Source and sink whose calls take time, raise or refuse as a test wants."""

    def __init__(self, clock: ToldClock) -> None:
        self.clock = clock
        self.sent: list[Command] = []
        self.number = 0
        self.reading_takes = self.sending_takes = 0.0
        self.events: dict[int, object] = {}

    def measurements(self):
        self.number += 1
        self.clock.t += self.reading_takes
        event = self.events.get(self.number)
        if callable(event):
            event()
        return []

    def joints(self) -> JointReading | None:
        return None

    def send(self, command: Command) -> bool:
        self.clock.t += self.sending_takes
        if self.events.get(-self.number) == "refuse":
            return False
        if self.events.get(-self.number) == "raise":
            raise ConnectionError("planted")
        self.sent.append(command)
        return True


def prepared(**settings: float) -> tuple[Loop, Cell, ToldClock]:
    clock = ToldClock()
    cell = Cell(clock)
    supervisor = scripted()
    supervisor.propose(NewTrajectory(AWAY_AND_BACK))
    return Loop(supervisor, cell, cell, LoopSettings(**settings), clock), cell, clock


# Bad input


@pytest.mark.parametrize("cycle", [0.0009, 0.11])
def test_rates_beyond_the_range_are_refused(cycle):
    cell = Cell(ToldClock())
    with pytest.raises(SetupError, match="cycle"):
        Loop(scripted(cycle=cycle), cell, cell)


@pytest.mark.parametrize("name", ["handover_s", "longest_stop_s", "collect_s"])
@pytest.mark.parametrize("value", [-1.0, math.nan, math.inf])
def test_unusable_settings_are_refused(name, value):
    with pytest.raises(SetupError, match=name):
        LoopSettings(**{name: value})


# Instants and deadlines


def test_every_cycle_has_its_step():
    loop, cell, _ = prepared()
    report = loop.run(100)
    assert report.missed == report.late == report.not_taken == 0
    assert report.cycles == len(cell.sent) == cell.number >= 100
    t = np.array([command.t for command in cell.sent])
    assert np.allclose(np.diff(t), CYCLE, atol=1e-9) and t[0] == pytest.approx(1000.0 + 2 * CYCLE)
    assert report.causes.sum() == report.cycles and report.fault is None


def test_a_command_that_is_ready_too_late_is_withdrawn_and_not_sent():
    loop, cell, _ = prepared()

    check = loop.supervisor.check.check_moving

    def slow(*arguments):
        cell.clock.t += 1.1 * CYCLE if cell.number == 30 else 0.0
        return check(*arguments)

    loop.supervisor.check.check_moving = slow
    report = loop.run(60)
    assert report.late == 1 and report.missed == 0
    assert report.causes[Cause.WITHDRAWN] == 1
    assert len(cell.sent) == report.cycles - 1
    one_curve(cell.sent)


def test_reports_have_arrived_when_the_step_is_called():
    loop, cell, clock = prepared()
    cell.reading_takes = 0.3 * CYCLE
    called = []
    step = loop.supervisor.step
    loop.supervisor.step = lambda now, *rest: (called.append(now - clock.t), step(now, *rest))[1]
    loop.run(10)
    assert set(called) == {0.0}


def one_curve(commands: list[Command]) -> None:
    for a, b in itertools.pairwise(commands):
        h = b.t - a.t
        assert np.abs(b.q - a.q - h * (a.dq + b.dq) / 2).max() <= 400.0 * h**3 / 12 + 1e-12


def test_the_time_for_handing_over_is_kept_free():
    loop, cell, _ = prepared(handover_s=0.4 * CYCLE)
    cell.reading_takes = 0.5 * CYCLE
    assert loop.run(50).late == 0
    loop, cell, _ = prepared(handover_s=0.6 * CYCLE)
    cell.reading_takes = 0.5 * CYCLE
    report = loop.run(50)
    # the grid begins when the first report is read
    assert report.late == report.cycles - 1 and len(cell.sent) == 1 and report.at_rest


@pytest.mark.parametrize("how", ["refuse", "raise"])
def test_what_the_robot_side_does_not_take_is_withdrawn(how):
    loop, cell, _ = prepared()
    cell.events |= {-k: how for k in (30, 31, 32, 50)}
    report = loop.run(80)
    assert report.not_taken == 4 and report.late == 0
    assert (report.fault is not None) is (how == "raise")
    one_curve(cell.sent)


def test_without_an_answer_nothing_counts_as_taken():
    loop, cell, _ = prepared()
    cell.send = lambda command: None
    report = loop.run(20)
    assert report.not_taken == report.cycles and report.at_rest


def prepared_for_silence() -> tuple[Loop, Cell]:
    clock = ToldClock()
    cell = Cell(clock)
    supervisor = scripted(silence=Silence(0.02, False, np.array([5.0, 5.0])))
    supervisor.propose(NewTrajectory(AWAY_AND_BACK))
    return Loop(supervisor, cell, cell, LoopSettings(), clock), cell


@pytest.mark.parametrize("refused", [7, 20, 36])
def test_where_the_last_command_is_refused_a_robot_that_stops_by_itself_is_not_at_rest(refused):
    clock = ToldClock()
    cell = Cell(clock)
    supervisor = scripted(silence=Silence(0.1, False, np.ones(2)))
    supervisor.propose(NewTrajectory(AWAY.stretched(3.0)))
    cell.events[-refused] = "refuse"
    report = Loop(supervisor, cell, cell, LoopSettings(), clock).run(refused - 1)
    assert report.not_taken == 1 and cell.sent[-1].outcome is not State.STOPPED
    assert report.silence and not report.at_rest


@pytest.mark.parametrize("how", ["refuse", "raise"])
def test_to_a_robot_that_stops_by_itself_nothing_is_sent_after_a_command_that_it_did_not_get(how):
    loop, cell = prepared_for_silence()
    cell.events[-30] = how
    report = loop.run(100)
    assert report.silence and not report.at_rest
    assert report.cycles == 30 and len(cell.sent) == 29
    assert (report.causes[Cause.WITHDRAWN], report.causes[Cause.LATCHED]) == (1, 0)
    again = loop.run(100)
    assert again.silence and again.cycles == 31 and len(cell.sent) == 29
    assert again.causes[Cause.LATCHED] == 1


def test_nor_after_a_cycle_that_was_missed():
    loop, cell = prepared_for_silence()

    def oversleep() -> None:
        cell.clock.overslept = 3.0 * CYCLE

    cell.events[30] = oversleep
    report = loop.run(100)
    assert report.silence and report.missed == 3 and report.cycles == 31 and len(cell.sent) == 30


def test_a_robot_that_rests_does_not_mind_what_it_did_not_get():
    loop, cell = prepared_for_silence()
    cell.events[-1] = "refuse"
    report = loop.run(100)
    assert not report.silence and report.at_rest and len(cell.sent) == report.cycles - 1 >= 99


@pytest.mark.parametrize("cycles", [1.2, 3.0, 40.7])
def test_a_loop_that_overslept_counts_and_goes_on(cycles):
    loop, cell, _ = prepared()

    def oversleep() -> None:
        cell.clock.overslept = cycles * CYCLE

    cell.events[30] = oversleep
    report = loop.run(100)
    assert report.missed == math.floor(cycles + 0.25) and report.causes[Cause.CLOCK] == 0
    assert report.wake_up.longest_s == pytest.approx(cycles * CYCLE)
    one_curve(cell.sent)


def test_a_source_that_raises_is_no_report_and_stops_the_robot():
    loop, cell, _ = prepared()

    def broken() -> None:
        raise OSError("planted")

    cell.events |= dict.fromkeys(range(30, 60), broken)
    report = loop.run(60)
    assert report.source_faults == 30 and "planted" in str(report.fault)
    assert {c.outcome for c in cell.sent[40:58]} == {State.STOPPED}
    assert report.causes[Cause.LATCHED] == 0


# Ends


def test_it_ends_with_the_robot_at_rest():
    loop, cell, _ = prepared()
    report = loop.run(40)
    assert report.at_rest and cell.sent[-1].outcome is State.STOPPED and not cell.sent[-1].dq.any()
    assert cell.sent[39].dq.any() and report.cycles > 40
    one_curve(cell.sent)


def test_whatever_is_proposed_meanwhile_it_ends():
    loop, cell, _ = prepared()
    cell.events |= {k: lambda: loop.supervisor.propose(NewTrajectory(AWAY)) for k in range(35, 400)}
    cell.events[30] = loop.stop
    report = loop.run()
    assert report.at_rest and report.cycles < 60


def test_where_the_robot_cannot_be_brought_to_rest_in_time_it_ends_all_the_same():
    loop, cell, clock = prepared(longest_stop_s=0.02)
    cell.events[30] = loop.stop
    begin = clock.t
    report = loop.run()
    assert not report.at_rest and report.cycles <= 34 and clock.t - begin < 0.4


def test_the_collector_is_held_off_and_given_back(monkeypatch):
    seen, young = [], []
    loop, cell, _ = prepared()
    cell.events[10] = lambda: seen.append((gc.isenabled(), gc.get_freeze_count() > 0))
    collect = gc.collect
    monkeypatch.setattr(gc, "collect", lambda *g: (young.append(g), collect(*g))[1])
    assert gc.isenabled()
    loop.run(20)
    assert seen == [(False, True)] and gc.isenabled() and gc.get_freeze_count() == 0
    assert young[0] == () and set(young[1:]) == {(0,)}


def test_the_collector_is_given_back_after_an_exception():
    loop, cell, _ = prepared()

    def interrupt() -> None:
        raise KeyboardInterrupt

    cell.events[10] = interrupt
    with pytest.raises(KeyboardInterrupt):
        loop.run(20)
    assert gc.isenabled() and gc.get_freeze_count() == 0


def test_without_idle_time_nothing_is_collected(monkeypatch):
    loop, cell, _ = prepared(collect_s=0.5 * CYCLE)
    cell.reading_takes = 0.6 * CYCLE
    young = []
    monkeypatch.setattr(gc, "collect", lambda *g: young.append(g))
    loop.run(20)
    assert young in ([()], [(), (0,)])  # the grid begins when the first report is read


# Histogram


def test_histogram_counts_everything(rng, count):
    histogram = Histogram()
    values = 10.0 ** rng.uniform(-8, 1.5, count(100_000))
    for value in values.tolist():
        histogram.add(value)
    own, _ = np.histogram(np.clip(values, 1.0000001e-6, 0.9999999), histogram.edges)
    assert histogram.counts.sum() == len(values)
    assert np.abs(np.cumsum(histogram.counts) - np.cumsum(own)).max() <= 1
    assert histogram.longest_s == values.max()
    for share in (0.01, 0.5, 0.9):
        assert histogram.quantile(share) >= np.quantile(values, share, method="inverted_cdf") * (1 - 1e-9)


@pytest.mark.parametrize("value", [0.0, -1.0, math.nan, math.inf, 1e-300, 1e300])
def test_histogram_takes_any_number(value):
    histogram = Histogram()
    histogram.add(value)
    assert histogram.counts.sum() == 1
    assert histogram.counts[-1 if not value < 1.0 else 0] == 1


def test_histogram_of_nothing():
    assert math.isnan(Histogram().quantile(0.5))


# The operating system


def test_what_is_not_granted_is_said(monkeypatch):
    import os

    def refuse(*_):
        raise PermissionError("not permitted")

    monkeypatch.setattr(os, "sched_setscheduler", refuse, raising=False)
    monkeypatch.setattr("verifier.loop._lock_memory", lambda: "not permitted either")
    granted = ask_for_real_time()
    assert granted == Granted(
        False, None, ("memory is not locked: not permitted either", "no real-time priority: not permitted")
    )


def test_a_priority_that_was_not_set_is_not_claimed(monkeypatch):
    import os

    monkeypatch.setattr(os, "sched_setscheduler", lambda *_: None, raising=False)
    monkeypatch.setattr(os, "sched_getscheduler", lambda *_: os.SCHED_OTHER, raising=False)
    monkeypatch.setattr("verifier.loop._lock_memory", lambda: None)
    assert ask_for_real_time() == Granted(True, None, ())


def test_a_short_run_in_real_time():
    """No statement about time: only that the loop runs on the clock of the machine, and ends at rest."""
    clock = MonotonicClock()
    cell = Cell(ToldClock())
    supervisor = scripted(cycle=0.02)
    supervisor.propose(NewTrajectory(AWAY))
    report = Loop(supervisor, cell, cell, LoopSettings(), clock).run(20)
    assert report.at_rest and report.cycles >= 20
    assert supervisor.fault is None and (cell.sent[-1].q >= HOME).all() if cell.sent else True
