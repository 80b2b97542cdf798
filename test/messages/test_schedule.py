# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Output times in integer nanoseconds, and the real-time factor."""
from fractions import Fraction
import math

from icofabric_sim.messages.schedule import nanoseconds_not_before, Schedule, seconds
from icofabric_sim.running import real_time_factor
from icofabric_sim.running.real_time_factor import RealTimeFactor
import numpy as np
import pytest

RATES = (60.0, 10.0, 100.0, 1.0, 3.0, 59.94, 1e6, 0.1, 999.999, math.pi, 1e-6)


@pytest.mark.parametrize('rate', RATES)
def test_output_k_comes_at_round_of_k_over_rate(rate):
    schedule = Schedule(rate)
    for k in (0, 1, 2, 3, 59, 60, 61, 10**6 + 1, 10**9 + 7):
        exact = Fraction(k * 10**9) / Fraction(rate)
        assert schedule.time(k) == round(exact)
        assert isinstance(schedule.time(k), int)
        assert schedule.is_due(schedule.time(k))


@pytest.mark.parametrize('rate', RATES)
def test_after_walks_through_all_outputs(rate):
    schedule = Schedule(rate)
    now = 0
    for k in range(1, 500):
        now = schedule.after(now)
        assert now == schedule.time(k)
    assert schedule.after(now - 1) == now


def test_after_from_any_time():
    random = np.random.default_rng(4)
    for rate in RATES:
        schedule = Schedule(rate)
        for now in random.integers(0, 10**13, 100).tolist():
            found = schedule.after(now)
            assert found > now
            k = round(found * Fraction(rate) / 10**9)
            assert schedule.time(k) == found and schedule.time(k - 1) <= now


def test_no_drift_after_a_year():
    year = 365 * 86400
    assert Schedule(60.0).time(60 * year) == year * 10**9
    assert Schedule(3.0).time(3 * year + 1) == year * 10**9 + 333333333


def test_times_between_outputs_are_not_due():
    schedule = Schedule(60.0)
    due = {schedule.time(k) for k in range(7)}
    assert [now for now in range(0, 10**8, 333_333) if schedule.is_due(now)] == [
        now for now in range(0, 10**8, 333_333) if now in due]
    assert not schedule.is_due(1) and not schedule.is_due(16_666_666)
    assert schedule.is_due(16_666_667)


def test_nanoseconds_and_seconds():
    random = np.random.default_rng(5)
    for nanoseconds in [0, 1, 10**9, *random.integers(0, 10**15, 1000).tolist()]:
        assert nanoseconds_not_before(seconds(nanoseconds)) == nanoseconds
        assert seconds(nanoseconds) == float(Fraction(nanoseconds, 10**9))
    for time in random.random(1000) * 100.0:
        found = nanoseconds_not_before(time)
        assert seconds(found) >= time > seconds(found - 1)
    # Months: a float of seconds stands for several nanoseconds, of which the first is meant.
    for time in (8459865.412308943, 40073491.63087638):
        found = nanoseconds_not_before(time)
        assert seconds(found) == seconds(found + 1) == time > seconds(found - 1)


class FakeWall:
    """A wall clock that is moved by hand."""

    def __init__(self, monkeypatch):
        self.now = 1000.0
        monkeypatch.setattr(real_time_factor.wall, 'monotonic', lambda: self.now)


def test_a_run_waits_for_the_target_factor(monkeypatch):
    clock = FakeWall(monkeypatch)
    kept = RealTimeFactor(2.0)
    assert kept.wait_time(10**9) == pytest.approx(0.5)
    clock.now += 0.5
    assert kept.wait_time(10**9) == 0.0
    assert kept.measure(10**9) == pytest.approx(2.0)
    assert RealTimeFactor(0.0).wait_time(10**9) == 0.0


def test_a_large_lag_is_dropped(monkeypatch):
    clock = FakeWall(monkeypatch)
    kept = RealTimeFactor(1.0)
    clock.now += 10.0
    assert kept.wait_time(10**9) == 0.0
    # Nine seconds behind: simulated time does not race to catch up.
    assert kept.wait_time(2 * 10**9) == pytest.approx(1.0)
    # A small lag is made good.
    clock.now += 1.05
    assert kept.wait_time(2 * 10**9) == 0.0
    assert kept.wait_time(2_100_000_000) == pytest.approx(0.05)


def test_measurement_restarts_after_a_pause_or_a_new_factor(monkeypatch):
    clock = FakeWall(monkeypatch)
    kept = RealTimeFactor(1.0)
    clock.now += 5.0
    kept.restart(0)
    assert kept.wait_time(10**8) == pytest.approx(0.1)
    kept.set_target(4.0, 0)
    assert kept.wait_time(10**9) == pytest.approx(0.25)


def test_chunks_follow_the_measured_speed():
    kept = RealTimeFactor(0.0)
    assert kept.chunk(0.01, 0.002) == 2_000_000  # one step, while nothing is known
    for _ in range(100):
        kept.record_steps(10**9, 0.5)
    assert kept.chunk(0.01, 0.002) == pytest.approx(2e7, rel=1e-6)
    kept.record_steps(0, 1.0)  # an input that acted at once says nothing
    assert kept.chunk(0.01, 0.002) == pytest.approx(2e7, rel=1e-6)
    assert kept.chunk(0.0, 0.0) == 1
