"""First trials, and the table of first grasps."""

import gymnasium as gym

from calfree_gym.tasks.reach import PRIVILEGED
from experiments.benchmarks.contact.first_grasps import GRASP, first_grasps
from experiments.benchmarks.contact.first_trial import first_trial


def test_who_is_told_where_to_go_is_there_after_one_motion():
    env = gym.make("CalFree/Reach-v0", dynamics="kinematic", tell=tuple(PRIVILEGED))
    trial = first_trial("oracle", env, 3)
    assert (trial.success, trial.told, trial.motions) == (True, True, 1)
    assert trial.truth["error_px"] < 1


def test_a_trial_of_no_use_goes_on_to_the_cap():
    trial = first_trial("random", gym.make(GRASP, shape="sphere"), 3)
    assert (trial.success, trial.told, trial.motions) == (False, False, 60)


def test_a_row_for_each_shape_and_mount():
    (table,) = first_grasps({"points": 1})
    assert len(table.frame) == 10
    assert set(table.frame["success"]) <= {0.0, 1.0}
    assert table.frame["motions"].between(5, 60).all()
