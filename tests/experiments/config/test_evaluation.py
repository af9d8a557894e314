"""When agents are evaluated: spaced as written, from the beginning on, on whole moves."""

import math
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from experiments.config.life import EvaluationConfig


@given(st.integers(1, 12), st.integers(1, 500_000), st.sampled_from([1, 4, 64]))
def test_so_many_a_decade_are_evenly_spaced_on_whole_moves(per_decade, motions, rows):
    found = EvaluationConfig(trials=1, per_decade=per_decade).offsets(motions, rows)
    assert list(found) == sorted(set(found))
    assert found[0] == 0
    assert found[-1] <= motions
    assert not any(at % rows for at in found)
    step = 10 ** (1 / per_decade)
    moves = [at for at in found if at >= 1]
    assert moves[:1] == ([rows] if rows <= motions else [])
    for earlier, later in pairwise(moves):
        assert later < earlier * step + 1 + rows  # the next is no further off than a step, rounded up
        assert later - earlier == rows or later > (earlier - rows) * step
    if moves:
        assert motions < moves[-1] * step + 1 + rows  # and they go on to the end


def test_whole_decades_are_hit_exactly():
    found = EvaluationConfig(trials=1, per_decade=3).offsets(1_000_000)
    assert {0, *(10**power for power in range(7))} < set(found)
    assert found[:8] == (0, 1, 3, 5, 10, 22, 47, 100)
    assert math.isclose(found[9] / found[8], 10 ** (1 / 3), rel_tol=0.01)


def test_written_checkpoints_are_those_of_the_life():
    assert EvaluationConfig(trials=1, every=400).offsets(1_000) == (0, 400, 800)
    assert EvaluationConfig(trials=1, at=(0, 1, 30)).offsets(29) == (0, 1)


@pytest.mark.parametrize(
    ("evaluation", "said"),
    [
        ({}, "one of every, at, per_decade says when; found none"),
        ({"every": 40, "at": [0]}, "found every and at"),
        ({"at": [0, 40, 40]}, "it must be whole numbers from 0 on that ascend"),
        ({"at": [-1]}, "it must be whole numbers from 0 on that ascend"),
        ({"at": [0, 91]}, "evaluation.at has 91; lives in 'aimed' have at most 90 motions"),
        ({"per_decade": 0}, "evaluation.per_decade: found 0"),
    ],
    ids=str,
)
def test_what_does_not_say_when_is_refused(suite_data, refused, evaluation, said):
    assert said in refused(suite_data | {"evaluation": {"trials": 2, **evaluation}})
