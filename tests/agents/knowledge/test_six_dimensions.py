"""Tables whose keys the object's direction has joined (section 4.3), against the function that they learn."""

import gymnasium as gym
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import agents
from agents.grasp.observation import NAMES, GraspObservation
from agents.grasp.turning import direction_key, directions, quarter
from experiments.running.lifetime import LifetimeRecorder, learn_trials


def looked(edge, axis):
    """What is seen of jaws and an object that point so (rad) in both images."""
    points = np.zeros((len(NAMES), 2, 2))
    for name, angles in {"edge_1": edge, "end_1": axis}.items():
        points[NAMES.index(name)] = np.stack([np.cos(angles), np.sin(angles)], 1)
    visible = np.ones((len(NAMES), 2), bool)
    return GraspObservation(points, visible, np.zeros(5), 1.0, False, np.zeros((2, 2)))


def test_directions_are_those_between_edge_and_axis_in_each_image():
    seen = looked([0.2, 1.0], [0.9, 0.5])
    assert directions(seen) == pytest.approx([0.7, -0.5])
    assert direction_key(seen) * np.pi / 2 == pytest.approx([0.1, 0.6])


@given(st.floats(-np.pi, np.pi), st.floats(-0.7, 0.7))
def test_keys_of_objects_that_are_turned_a_little_are_near(angle, differ):
    before, after = (
        direction_key(looked([0.0, 0.0], [turned + differ, turned - differ]))
        for turned in (angle, angle + 0.01)
    )
    assert abs(quarter((after - before)[0] * np.pi / 2)) == pytest.approx(0.01, abs=1e-6)
    assert after[1] == pytest.approx(before[1], abs=1e-6)


def test_a_grasp_jumps_to_where_it_grasped_before_and_a_saved_one_does_too(tmp_path):
    env = gym.make("CalFree/Grasp-v0", shape="bar", world="nominal")
    recorder, settings = (
        LifetimeRecorder(env, seed=3),
        {"knowledge": "grid_table", "direction": True, "cells": 2},
    )
    agent = agents.make("grasp", recorder, **settings)
    assert all(record.success for record in learn_trials(agent, recorder, 3))
    agent.save(tmp_path / "grasp")
    again = agents.make("grasp", env, **settings).load(tmp_path / "grasp")
    assert np.array_equal(again.table.records, agent.table.records, equal_nan=True)
    assert np.count_nonzero(~np.isnan(agent.table.records[:, 0])) >= 2**6
