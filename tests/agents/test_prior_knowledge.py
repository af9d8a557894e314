"""Agents declare what they are built on: exactly those break that declare what a world contradicts."""

import gymnasium as gym
import numpy as np
import pytest

import agents
from agents import KNOWLEDGE
from agents.base.prior_knowledge import PriorKnowledge, in_order
from experiments.studies.priors import ALTERATIONS, BREAKS, AlteredSenses, declared, effect, measured

SOME = ("oracle", "unified_servo", "affine_stereo", "model_based")
"""Cheap ones that between them declare nothing, a few words, and nearly all."""


@pytest.mark.parametrize(
    ("word", "names", "size"),
    [
        (PriorKnowledge.IMAGE_SCALE, SOME, {"worlds": 2, "trials": 4}),
        (PriorKnowledge.MOTOR_ORDER, SOME, {"worlds": 2, "trials": 4}),
        *[pytest.param(word, measured(), {}, marks=pytest.mark.slow) for word in ALTERATIONS],
    ],
)
def test_exactly_those_break_that_declare_it(word, names, size):
    broken = set()
    for name in names:
        held, contradicted = effect(name, word, **size)
        if contradicted > BREAKS * held:
            broken.add(name)
    assert broken == {name for name in names if word in declared(name)}


@pytest.mark.parametrize("word", ALTERATIONS)
def test_an_alteration_leaves_the_task_as_it_was(word):
    """Who is told where to go still gets there, in one motion unless points are noisy."""
    held, contradicted = effect("oracle", word, worlds=2, trials=4)
    assert held == 1
    assert contradicted <= (1.5 if word is PriorKnowledge.NOISE else 1)


@pytest.mark.parametrize("word", [word for word, each in ALTERATIONS.items() if each.motors])
def test_altered_motors_obey_words_as_their_registers_say(word):
    """Words add up in the registers that an agent sees, and one that is not sent to does not move."""
    env = AlteredSenses(gym.make("CalFree/Reach-v0", dynamics="kinematic"), ALTERATIONS[word])
    env.reset(seed=0)
    for motor, sent in enumerate(0.01 * np.eye(3)):
        before = env.step(np.zeros(3))[0]["observation"][4:]
        after = env.step(sent)[0]["observation"][4:]
        np.testing.assert_allclose(after - before, sent, atol=2e-6)
        assert (np.delete(after - before, motor) == 0).all()


def test_a_learning_servo_declares_what_its_parts_do():
    env = gym.make("CalFree/Reach-v0")
    for name in KNOWLEDGE:
        agent = agents.make(name, env)
        remembers = agent.adaptation if name == "memory" else agent.knowledge
        assert agent.prior_knowledge == agent.servo.prior_knowledge | remembers.prior_knowledge


def test_words_are_printed_in_the_order_of_the_vocabulary():
    assert in_order({PriorKnowledge.NOISE, PriorKnowledge.IMAGE_SCALE}) == ("image scale", "noise")
