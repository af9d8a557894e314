"""The agent that takes its arm for a chain of joints, on arms and mounts that it is not told of."""

import numpy as np
import pytest

import agents
from agents.base.prior_knowledge import PriorKnowledge
from experiments.studies import priors
from tests.agents.body_schema.chains import MODELS


def arm_file(file, site, **more):
    return {"arm": {"model": str(MODELS / file), "gripper": site, **more}}


REDUNDANT = arm_file("redundant.xml", "tool", home="home")


@pytest.mark.parametrize(
    ("mount", "arm"),
    [
        ("waist", {}),
        ("stand", arm_file("scara.xml", "tip")),
        pytest.param("stand", REDUNDANT, marks=pytest.mark.slow),
        pytest.param("link 3", REDUNDANT, marks=pytest.mark.slow),
    ],
)
def test_after_a_few_trials_the_first_motion_ends_at_the_rendezvous(make_env, live, mount, arm):
    agent, lengths = live("body_schema", make_env(mount, **arm), seed=1, trials=20)
    assert np.mean(lengths[8:]) <= 1.5
    observation, _ = agent.env.reset()
    assert agent.expected_px(observation) < 4, "it says how far off it will be"
    assert agents.make("body_schema", make_env(mount, **arm)).expected_px(observation) is None


def test_it_tells_which_camera_was_knocked_and_goes_on(make_env, live):
    knocked = [{"at": {"trial": 12}, "do": {"type": "camera_aim", "camera": "right", "degrees": 15}}]
    agent, lengths = live("body_schema", make_env(perturbations=knocked), seed=2, trials=20)
    assert [event.kind for event in agent.body.events] == ["right camera turned"]
    assert agent.body.events[0].trial in (11, 12)
    assert np.mean(lengths[14:]) <= 1.5


def test_a_motor_that_another_one_stopped_is_free_again_in_the_next_trial():
    motions = priors.motions("body_schema", 5000, 4, priors.ALTERATIONS[PriorKnowledge.ARM])
    assert motions[1:].max() <= 8


def test_where_the_chain_is_wrong_the_servo_finds_out_by_itself_where_motors_stop():
    motions = priors.motions("body_schema", 5022, 3, priors.ALTERATIONS[PriorKnowledge.ARM])
    assert motions[2] <= 20
