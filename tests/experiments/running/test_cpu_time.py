"""CPU seconds are booked to what they were spent on, and to nothing else."""

from types import SimpleNamespace

import pytest

from experiments.running import cpu_time
from experiments.running.cpu_time import CpuTimes, TimedPredictor


@pytest.fixture
def clock(monkeypatch):
    """CPU time that passes only where a test says so."""
    now = SimpleNamespace(seconds=100.0)
    monkeypatch.setattr(cpu_time.time, "process_time", lambda: now.seconds)

    def work(seconds):
        now.seconds += seconds

    return work


def test_what_is_measured_within_something_else_does_not_count_for_it(clock):
    times, env = CpuTimes(), SimpleNamespace(step=lambda seconds: clock(seconds))
    times.watch(env, "environment", "step")
    clock(7)
    with times.of("learning"):
        clock(1)
        env.step(5)
        clock(2)
        with times.of("evaluation"):
            clock(20)
        env.step(5)
    clock(7)
    env.step(1)
    assert times.seconds == {"learning": 3, "environment": 11, "evaluation": 20}
    assert times.a_motion(learned=2) == {"learning": 1.5}


def test_decisions_are_counted_one_by_one(clock):
    times = CpuTimes()
    agent = TimedPredictor(SimpleNamespace(predict=lambda words: clock(words)), times)
    with times.of("evaluation"):
        agent.predict(1)
        agent.predict(words=2)
    assert times.a_motion(learned=0) == {"decision": 1.5}


def test_an_error_ends_what_was_measured(clock):
    def fails():
        clock(1)
        raise ZeroDivisionError

    times, agent = CpuTimes(), SimpleNamespace(learn=fails)
    times.watch(agent, "learning", "learn")
    with pytest.raises(ZeroDivisionError):
        agent.learn()
    clock(5)
    with times.of("decision"):
        clock(1)
    assert times.seconds == {"learning": 1, "decision": 1}
