"""Agents declare what they are built on: none breaks but those that declare what a world contradicts."""

import gymnasium as gym
import pytest

import agents
from agents import KNOWLEDGE
from agents.base.prior_knowledge import PriorKnowledge
from experiments.studies.priors import ALTERATIONS, BREAKS, declared, effect, measured

SOME = ("oracle", "unified_servo", "affine_stereo", "model_based")
"""Cheap ones that between them declare nothing, a few words, and nearly all."""


@pytest.mark.parametrize(
    ("word", "names", "size"),
    [
        (PriorKnowledge.IMAGE_SCALE, SOME, {"worlds": 2, "trials": 4}),
        (PriorKnowledge.MOTOR_ORDER, SOME, {"worlds": 2, "trials": 4}),
        *[pytest.param(word, None, {}, marks=pytest.mark.slow) for word in ALTERATIONS],
    ],
)
def test_none_breaks_but_those_that_declare_it(word, names, size):
    broken, all_agents = set(), names is None
    names = names or measured()
    for name in names:
        held, contradicted = effect(name, word, **size)
        if contradicted > BREAKS * held:
            broken.add(name)
    know = {name for name in names if word in declared(name)}
    assert broken and broken <= know if all_agents else broken == know


@pytest.mark.parametrize("word", ALTERATIONS)
def test_an_alteration_leaves_the_task_as_it_was(word):
    held, contradicted = effect("oracle", word, worlds=2, trials=4)
    assert held == 1
    assert contradicted <= (1.5 if word is PriorKnowledge.NOISE else 1)


def test_a_learning_servo_declares_what_its_parts_do():
    env = gym.make("CalFree/Reach-v0")
    for name in KNOWLEDGE:
        agent = agents.make(name, env)
        remembers = agent.adaptation if name == "memory" else agent.knowledge
        assert agent.prior_knowledge == agent.servo.prior_knowledge | remembers.prior_knowledge
