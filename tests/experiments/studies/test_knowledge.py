"""The parts of `benchmark knowledge` against numbers known beforehand; nothing asserts what it measures."""

import gymnasium as gym
import numpy as np
import pytest

import agents
import calfree_gym
from experiments.running.lifetime import LifetimeRecorder
from experiments.studies import knowledge

REACH = calfree_gym.ENV_IDS[0]


def test_objects_lie_in_a_region_of_the_given_width():
    env = knowledge.Region(gym.make(REACH, dynamics="kinematic"), 0.25)
    recorder = LifetimeRecorder(env, seed=3)
    places = []
    for _ in range(12):
        _, info = recorder.reset()
        places.append(knowledge._place(info))
        recorder.step(np.zeros(3, np.float32))
    width = np.ptp(places, axis=0)
    assert len(np.unique(places, axis=0)) == 12
    assert (width > 0).all()
    assert (width <= 0.25 * (knowledge.HIGH - knowledge.LOW) + 1e-8).all()


def test_corners_are_counted():
    corners = knowledge._corners(np.array([[-1.0, -1.0], [0.9, 1.0]]), cells=2)
    assert corners.tolist() == [[0, 1, 3, 4], [4, 5, 7, 8]]


def test_visits_are_counted_until_enough_records_were_met():
    sensors = np.zeros((3, 4))
    rng = np.random.default_rng(0)
    assert knowledge._trials_until(16, sensors, 4, 2, rng) == 1
    assert knowledge._trials_until(16 * 9 - 1, sensors, 6, 2, rng) > 1


def test_tables_hold_what_is_required_beside_what_was_found(monkeypatch):
    monkeypatch.setattr(knowledge, "TRIALS", 3)
    monkeypatch.setattr(knowledge, "TABLES", ({"cells": 2},))
    monkeypatch.setattr(knowledge, "STORED", (12, 20))
    monkeypatch.setattr(knowledge, "REQUIRED_AT", 20)
    of_region = knowledge.region(worlds=1)
    assert of_region.rows[0][:3] == ["cells 2", "whole work space", "0.2"]
    assert of_region.frame["required"].isna().tolist() == [True] * 3 + [False] * 3
    seconds = of_region.frame["1-25"].tolist()
    assert seconds[0] < seconds[1] < seconds[2]
    assert "531,441" in knowledge.records(worlds=1, objects=20).markdown()
    stored = knowledge.stored(recalls=3).frame
    assert stored.groupby("pairs")["required"].sum().to_dict() == {12: 0, 20: 300 * (len(stored) // 2)}
    assert list(stored["knowledge"].unique()) == list(agents.KNOWLEDGE)
    assert (stored["bytes"] > 0).all()


def test_memory_recalls_the_pairs_that_it_was_shown():
    remembered, rng = knowledge.RememberedPairs(3), np.random.default_rng(0)
    for _ in range(150):
        remembered.learn(*knowledge._pair(rng))
    for _ in range(5):
        sensors, registers = knowledge._pair(rng)
        assert remembered.recall(sensors).registers == pytest.approx(registers, abs=0.05)
