"""The agent that takes its arm for a chain of joints, on arms and mounts that it is not told of."""

import gymnasium as gym
import numpy as np
import pytest

import agents
from tests.agents.body_schema.chains import MODELS


def arm(file, site, **more):
    return {"arm": {"model": str(MODELS / file), "gripper": site, **more}}


@pytest.mark.parametrize(
    "options",
    [
        {"mount": "waist"},
        {"mount": "stand", **arm("scara.xml", "tip")},
        pytest.param({"mount": "stand", **arm("redundant.xml", "tool", home="home")}, marks=pytest.mark.slow),
        pytest.param(
            {"mount": "link 3", **arm("redundant.xml", "tool", home="home")}, marks=pytest.mark.slow
        ),
    ],
)
def test_after_a_few_trials_the_first_motion_ends_at_the_rendezvous(make_env, live, options):
    _, lengths = live("body_schema", make_env(**options), seed=1, trials=20)
    assert np.mean(lengths[8:]) <= 1.5


def test_it_tells_which_camera_was_knocked_and_goes_on(make_env, live):
    knocked = [{"at": {"trial": 12}, "do": {"type": "camera_aim", "camera": "right", "degrees": 15}}]
    agent, lengths = live("body_schema", make_env(perturbations=knocked), seed=2, trials=20)
    assert [event.kind for event in agent.body.events] == ["right camera"]
    assert agent.body.events[0].trial in (11, 12)
    assert np.mean(lengths[14:]) <= 1.5


def test_it_says_how_far_off_it_will_be(make_env, live):
    agent, _ = live("body_schema", make_env(), seed=3, trials=10)
    observation, _ = agent.env.reset()
    assert agent.expected_px(observation) < 4
    assert agents.make("body_schema", make_env()).expected_px(observation) is None


def test_what_it_takes_its_body_for_lasts_in_a_file(make_env, live, tmp_path):
    """A change that is still being explained, too."""
    moved = [{"at": {"trial": 6}, "do": {"type": "camera_replace", "camera": "left"}}]
    agent, _ = live("body_schema", make_env(perturbations=moved), seed=4, trials=8)
    agent.save(tmp_path / "body.npz")
    again = agents.make("body_schema", make_env()).load(tmp_path / "body.npz")
    assert again.body.events == agent.body.events
    assert agent.body.events
    for name, array in agent.arrays().items():
        np.testing.assert_array_equal(again.arrays()[name], array)


def test_it_goes_over_any_servo():
    env = gym.make("CalFree/Reach-v0")
    assert "PaperServo" in agents.make("body_schema", env, servo="paper_servo").kind
    with pytest.raises(ValueError, match=r"servo is 'memory'; allowed: .*unified_servo"):
        agents.make("body_schema", env, servo="memory")
