"""Any arm settles, and can be led to its objects by its own kinematics."""

import mujoco
import numpy as np
import pytest

from tests.arms.every import EVERY, arm_named, rows_of, three_mounts
from tests.arms.fetched import FETCHED
from tests.arms.own import ARMS

FEW, MANY = 4, 50
CASES = [
    *((name, FEW) for name in ARMS),
    *(pytest.param(name, MANY, marks=pytest.mark.slow) for name in [*ARMS, *FETCHED]),
]


def reached(arm, mount, worlds):
    """In how many worlds the oracle comes to the rendezvous within two motions."""
    arguments = {"camera_mount": mount, "terminate_on_success": False, "tell": ("object_registers",)}
    env = rows_of(arm, worlds, dynamics="kinematic", **arguments)
    observation, infos = env.reset(seed=100)
    motors = len(arm.robot.motors)
    done = infos["is_success"].copy()
    for _ in range(2):
        words = observation["object_registers"] - observation["observation"][:, 4 : 4 + motors]
        observation, *_, infos = env.step(words)
        done |= infos["is_success"]
    return int(done.sum())


@pytest.mark.parametrize(("name", "worlds"), CASES)
def test_the_oracle_reaches(name, worlds):
    arm = arm_named(name)
    counts = {mount: reached(arm, mount, worlds) for mount in three_mounts(arm.robot)}
    assert sum(counts.values()) >= 0.99 * worlds * len(counts), counts


ROWS, MOTIONS = 4, 8
HALF_AN_IMAGE = 256


def both(arm, **arguments):
    made = [
        rows_of(arm, ROWS, dynamics=dynamics, terminate_on_success=False, **arguments)
        for dynamics in ("physics", "kinematic")
    ]
    assert [env.reset(seed=0)[0]["observation"][:, :4].min() for env in made] == [1, 1]
    return made


@pytest.mark.parametrize("mount", ["waist", "stand"])
@pytest.mark.parametrize("name", EVERY)
def test_physics_settles_where_kinematics_places_it(name, mount):
    """Words of the full range: half of them end at stops."""
    envs, rng = both(arm_named(name), camera_mount=mount), np.random.default_rng(1)
    compared = 0
    for _ in range(MOTIONS):
        words = rng.uniform(-1, 1, envs[0].action_space.shape)
        physics, kinematic = (env.step(words)[-1]["truth"]["points"] for env in envs)
        shown = np.abs(kinematic) <= 1
        compared += shown[:, :4].sum()
        assert physics[shown] * HALF_AN_IMAGE == pytest.approx(kinematic[shown] * HALF_AN_IMAGE, abs=0.2)
    assert compared > ROWS * MOTIONS


@pytest.mark.parametrize("name", EVERY)
def test_all_other_joints_stay_at_home(name):
    """Also a free body beside the arm, whatever gravity there is, and whatever springs the joints have."""
    robot, rng = arm_named(name).robot, np.random.default_rng(2)
    env = both(arm_named(name))[0]
    for _ in range(MOTIONS):
        env.step(rng.uniform(-1, 1, env.action_space.shape))
    moved = np.zeros(robot.model.nq, bool)
    moved[robot.qpos_of_motors] = True
    for row in range(ROWS):
        batch = env.unwrapped.arms.simulation._batch
        model, data = batch.get_model(row), batch.get_data(row)
        mujoco.mj_forward(model, data)
        assert data.qpos[~moved] == pytest.approx(robot.home_qpos[~moved], abs=1e-4)
        assert (data.qpos[moved] != robot.home_qpos[moved]).all()
        for key in range(robot.model.nkey):
            assert (model.key_qpos[key] == robot.model.key_qpos[key]).all()
        assert np.abs(data.qvel).max() < 0.02
        assert not data.ncon
        assert model.opt.timestep == 0.005
        assert model.opt.integrator == mujoco.mjtIntegrator.mjINT_IMPLICITFAST
