"""The agent that takes its arm for a chain of joints, on arms and mounts that it is not told of."""

from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest

import agents
from agents.base.observation import Observation
from agents.base.prior_knowledge import PriorKnowledge
from agents.body_schema.chain import Views
from experiments.studies import priors
from tests.agents.body_schema.chains import MODELS, Arm
from tests.agents.trials import assert_same_arrays, carry_out


def arm_file(file, site, **more):
    return {"arm": {"model": str(MODELS / file), "gripper": site, **more}}


REDUNDANT = arm_file("redundant.xml", "tool", home="home")


@pytest.mark.parametrize(
    ("mount", "arm"),
    [
        ("waist", {}),
        pytest.param("stand", arm_file("scara.xml", "tip"), marks=pytest.mark.slow),
        pytest.param("stand", REDUNDANT, marks=pytest.mark.slow),
        pytest.param("link 3", REDUNDANT, marks=pytest.mark.slow),
    ],
)
def test_after_a_few_trials_the_first_motion_ends_at_the_rendezvous(make_env, live, mount, arm):
    agent, lengths = live("body_schema", make_env(mount, **arm), seed=1, trials=20)
    assert np.mean(lengths[8:]) <= 1.5
    assert not agent.new_findings().stops.been.any(), "trials begin at home"
    observation, _ = agent.env.reset()
    assert agent.expected_px(observation) < 4, "it says how far off it will be"
    assert agents.make("body_schema", make_env(mount, **arm)).expected_px(observation) is None


def test_it_tells_which_camera_was_knocked_and_goes_on(make_env, live):
    knocked = [{"at": {"trial": 12}, "do": {"type": "camera_aim", "camera": "right", "degrees": 15}}]
    agent, lengths = live("body_schema", make_env(perturbations=knocked), seed=2, trials=20)
    assert [event.kind for event in agent.body.events] == ["right camera turned"]
    assert agent.body.events[0].trial in (11, 12)
    assert np.mean(lengths[14:]) <= 1.5


def test_what_it_takes_its_body_for_lasts_in_a_file(make_env, live, tmp_path):
    """A change that is still being explained, too."""
    moved = [{"at": {"trial": 6}, "do": {"type": "camera_replace", "camera": "left"}}]
    agent, _ = live("body_schema", make_env(perturbations=moved), seed=4, trials=8)
    agent.save(tmp_path / "body.npz")
    again = agents.make("body_schema", make_env()).load(tmp_path / "body.npz")
    assert again.body.events == agent.body.events != []
    assert_same_arrays(again, agent)


def test_it_goes_over_any_servo():
    env = gym.make("CalFree/Reach-v0")
    assert "PaperServo" in agents.make("body_schema", env, servo="paper_servo").kind


def test_a_way_longer_than_one_word_is_no_stop(make_env):
    """From one end of a register to the other are two words; the first ends halfway, at no motor's stop."""
    arm, env = Arm("scara.xml", "tip"), make_env("stand", **arm_file("scara.xml", "tip"))
    agent = agents.make("body_schema", env)
    agent.body.known = arm.exact
    here, there = np.full((2, arm.chain.motors), 0.1)
    here[0], there[0] = -0.8, 0.8

    def seen(registers, object_):
        points = Views(arm.chain, arm.numbers, registers[None], object_[None]).points[0]
        return Observation(points, np.ones(4, bool), registers)

    def observed(words):
        here[:] += words
        return seen(here.copy(), home.object)

    findings, home = agent.new_findings(), seen(there, np.zeros(4))
    going = agent._go(there, seen(here.copy(), np.zeros(4)), home, arm.exact, findings)
    words, (_, arrived) = carry_out(going, observed)
    assert np.abs(words[0]).max() <= 1
    assert not arrived
    assert np.isinf(findings.stops.found).all()


@pytest.mark.slow
def test_an_arm_that_comes_before_its_camera_is_no_end(make_env):
    """Image points near a camera's plane are so far away that rounding takes the damping."""
    pusher = Path(gym.__path__[0]) / "envs/mujoco/assets/pusher.xml"
    env = make_env(arm={"model": str(pusher), "gripper": "tips_arm"})
    env.reset(seed=0)
    env.unwrapped.set_world(env.unwrapped.world)
    env.reset(seed=3)
    agents.make("body_schema", env).learn(60)


def test_a_motor_that_another_one_stopped_is_free_again_in_the_next_trial():
    """A belt couples elbow and shoulder: the elbow's joint ends where its motor has been before."""
    motions = priors.motions("body_schema", 5000, 4, priors.ALTERATIONS[PriorKnowledge.ARM])
    assert motions[1:].max() <= 8


def test_where_the_chain_does_not_lead_the_servo_finds_out_by_itself_where_motors_stop(make_env, monkeypatch):
    """A motor that another's posture stopped before may have to go beyond."""
    agent, given = agents.make("body_schema", make_env()), []
    new_findings = agent.new_findings

    def stopped():
        findings = new_findings()
        findings.stops.found[1, 0] = 0.1
        return findings

    monkeypatch.setattr(agent, "new_findings", stopped)
    servo, call = type(agent.servo), type(agent.servo).__call__
    monkeypatch.setattr(
        servo,
        "__call__",
        lambda self, now, findings: given.append(findings.stops.found) or call(self, now, findings),
    )
    agent.predict(agent.env.reset(seed=0)[0])
    assert not np.isfinite(given[0]).any()
