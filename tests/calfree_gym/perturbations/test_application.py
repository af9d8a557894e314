"""What the draws of an event depend on: the row's seed, its place in the schedule, and the count."""

import numpy as np
import pytest

from calfree_gym import nominal
from calfree_gym.perturbations.schedule import PerturbationScheduler
from calfree_gym.robot.arms.movemaster import MOVEMASTER

WAIST = ("waist", "waist")
EVENT = {"every": {"trial": 1}, "do": {"type": "camera_roll", "camera": "left"}}
DRIFT = {"drift": {"per": "trial"}, "do": {"type": "camera_roll", "camera": "left"}}


def drawn(schedule, seeds=(0,), row=0, count=1):
    """The degrees that the events of a schedule draw for one row of several."""
    scheduler = PerturbationScheduler(len(seeds), schedule, MOVEMASTER, WAIST, keep_in_view=False)
    for each, seed in enumerate(seeds):
        scheduler.seed(each, seed)
    events = scheduler.events["trial"]
    return [scheduler.apply(place, event, row, count, nominal())[1].degrees for place, event in events]


@pytest.mark.parametrize("entry", [EVENT, DRIFT], ids=["event", "drift"])
def test_draws_depend_on_the_rows_own_seed(entry):
    assert drawn([entry], seeds=(3,)) == drawn([entry], seeds=(8, 3), row=1)
    assert drawn([entry], seeds=(3,)) != drawn([entry], seeds=(4,))
    assert drawn([entry], seeds=(3, 4), row=0) != drawn([entry], seeds=(3, 4), row=1)


@pytest.mark.parametrize("entry", [EVENT, DRIFT], ids=["event", "drift"])
def test_draws_depend_on_the_place_in_the_schedule(entry):
    degrees = drawn([entry] * 4)
    assert len(set(degrees)) == 4
    assert drawn([entry] * 2) == degrees[:2]


def test_draws_of_an_event_depend_on_the_count_and_those_of_a_drift_do_not():
    assert drawn([EVENT], count=1) != drawn([EVENT], count=2)
    assert drawn([DRIFT], count=1) == drawn([DRIFT], count=2)


def test_an_event_in_view_is_the_first_draw_that_is_in_view():
    scheduler = PerturbationScheduler(
        1, [{**EVENT, "do": {"type": "camera_aim", "camera": "left", "degrees": 25}}], MOVEMASTER, WAIST, True
    )
    ((place, event),) = scheduler.events["trial"]
    directions = []
    for seed in range(12):
        scheduler.seed(0, seed)
        world, perturbation = scheduler.apply(place, event, 0, 1, nominal())
        assert world == perturbation.change(nominal())
        directions.append(perturbation.direction)
    assert np.unique(directions).size == 12
