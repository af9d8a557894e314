"""The parts of `benchmark knowledge` against numbers known beforehand; nothing asserts what it measures."""

import gymnasium as gym
import numpy as np

import calfree_gym
from experiments.benchmarks import knowledge as remembering
from experiments.benchmarks import region
from experiments.running.lifetime import Life

REACH, _ = calfree_gym.ENV_IDS


def test_objects_lie_in_a_region_of_the_given_width():
    env = region.Region(gym.make(REACH, dynamics="kinematic"), 0.25)
    life = Life(env, seed=3)
    places = []
    for _ in range(12):
        _, info = life.reset()
        places.append(region._place(info))
        life.step(np.zeros(3, np.float32))
    width = np.ptp(places, axis=0)
    assert len(np.unique(places, axis=0)) == 12
    assert (width > 0).all()
    assert (width <= 0.25 * (region.HIGH - region.LOW) + 1e-8).all()


def test_corners_are_counted():
    corners = remembering._corners(np.array([[-1.0, -1.0], [0.9, 1.0]]), cells=2)
    assert corners.tolist() == [[0, 1, 3, 4], [4, 5, 7, 8]]


def test_visits_are_counted_until_enough_records_were_met():
    sensors = np.zeros((3, 4))
    rng = np.random.default_rng(0)
    assert remembering._trials_until(16, sensors, 4, 2, rng) == 1
    assert remembering._trials_until(16 * 9 - 1, sensors, 6, 2, rng) > 1


def test_it_prints_what_is_wanted_beside_what_was_found(monkeypatch):
    monkeypatch.setattr(remembering, "TRIALS", 3)
    monkeypatch.setattr(remembering, "TABLES", ({"cells": 2},))
    monkeypatch.setattr(remembering, "STORED", (12, 20))
    for lines, said in (
        (remembering._region(worlds=1), "cells 2"),
        (remembering._records(worlds=1, objects=20), "531,441"),
        (remembering._stored(recalls=3), "12: "),
    ):
        assert said in "\n".join(lines)


def test_memory_is_told_beside_the_bare_servo(monkeypatch):
    monkeypatch.setattr(remembering, "ASKED", ((0, 1), (1, 2)))
    records = [[type("R", (), {"motions": m, "success": True})() for m in life] for life in ([9, 2], [5, 1])]
    monkeypatch.setattr(remembering, "_lives", lambda *args: ([r[: args[-1]] for r in records], []))
    head, waist, _ = remembering._memory(worlds=2)
    assert "wanted" in head
    assert waist.split("   ")[1:] == [
        "1-1: 7.00 [9.00]",
        "2-2: 1.50 [2.00]",
        "success 100.00%",
    ]
    assert "trial 1: 7.00 (unified_servo 7.00)" in waist
