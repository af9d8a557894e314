"""The median time by what it must come to; Kaplan and Meier's curve itself is SciPy's."""

import numpy as np
import pytest

from experiments.statistics import median_time, median_world


def test_where_every_world_reaches_it_the_median_is_that_of_order_statistics():
    times = np.random.default_rng(1).exponential(1_000, 21)
    found = median_time(times, np.ones(21, bool))
    exact = median_world(times)
    assert found.value == exact.value
    place = np.searchsorted(np.sort(times), [found.low, found.high, exact.low, exact.high])
    assert np.abs(place[:2] - place[2:]).max() <= 1, "one world more or less"


def test_a_world_that_was_looked_at_for_a_short_time_tells_only_that():
    """Of three worlds one ends early: the others are the half of it that is left."""
    times = np.repeat([100.0, 200.0, 300.0], 10)
    reached = np.repeat([False, True, True], 10)
    assert median_time(times, reached).value == 200
    assert median_time(times, np.repeat([True, True, True], 10)).value == 200
    assert median_time(times, np.repeat([False, False, True], 10)).value == 300


def test_a_median_that_was_not_reached_is_infinite():
    reached = np.arange(20) < 9
    found = median_time(np.where(reached, 100.0, 5_000.0), reached)
    assert (found.value, found.low, found.high) == (np.inf, 100, np.inf)
    never = median_time(np.full(20, 5_000.0), np.zeros(20, bool))
    assert (never.value, never.low) == (np.inf, np.inf)


def test_fewer_than_20_worlds_have_no_interval():
    found = median_time(np.arange(19.0), np.ones(19, bool))
    assert found.value == 9
    assert not found.has_interval


@pytest.mark.filterwarnings("error")
def test_equal_times_are_one_time():
    found = median_time(np.full(20, 50.0), np.ones(20, bool))
    assert (found.value, found.low, found.high) == (50, 50, 50)
