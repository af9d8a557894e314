"""SafeReach: contacts as MuJoCo alone has them, arms that stop short, and what ends a trial."""

import collections
import itertools
from dataclasses import replace

import mujoco
import numpy as np
import pytest

from calfree_gym import Arm, WorldDistribution, nominal
from calfree_gym.robot.arms.movemaster import MOVEMASTER
from calfree_gym.robot.touching import (
    CLEARANCE,
    LEAST,
    REACTION,
    RETREAT,
    SENSOR,
    TRIP,
    TouchingSimulation,
    furniture,
    of_arm,
    ramp,
)
from tests.arms.own import ARMS
from tests.calfree_gym.environments import begun, kinematic, make, trials

DOWN = np.radians([0.0, -35.0, 0.0, 35.0, 0.0])
"""From home, the RV-M2's gripper then meets the table."""


def alone(scene, control):
    model, data = scene.model, mujoco.MjData(scene.model)
    data.qpos[:] = data.act[:] = MOVEMASTER.built_home
    forces, one = [], np.zeros(6)
    for ctrl in control:
        data.ctrl[:] = ctrl
        mujoco.mj_step(model, data)
        largest = 0.0
        for contact in range(data.ncon):
            mujoco.mj_contactForce(model, data, contact, one)
            largest = max(largest, float(np.linalg.norm(one[:3])))
        forces.append(largest)
    return np.array(forces)


def test_a_contact_is_recorded_as_mujoco_has_it_and_stops_the_arm():
    simulation, home = TouchingSimulation(1, MOVEMASTER, MOVEMASTER.mounts("stand"), 1), MOVEMASTER.built_home
    simulation.set_world(0, nominal())
    simulation.place(np.array([0]), home[None], np.full((1, 3), 9.0))
    simulation.move(slice(None), (home + DOWN)[None])
    touched = simulation.touched
    there, here = MOVEMASTER.gripper_position(np.stack([home + DOWN, home]), MOVEMASTER.lengths)
    apart = float(np.linalg.norm(there - here))
    substeps = max(int(np.ceil(max(1.875 * apart / 0.25, 1.875 * np.abs(DOWN).max() / 0.7) / 0.005)), LEAST)
    control = home + ramp(substeps)[:, None] * DOWN
    forces = alone(simulation._scene, control)
    trip = int((forces > TRIP).argmax())
    assert forces[trip] > TRIP
    before = float(forces[: trip + REACTION + 1].max())
    assert touched.force[0] >= before * (1 - 1e-9), "the way to where the drive stops it is MuJoCo's own"
    assert touched.shares[0] == pytest.approx((1 - RETREAT) * ramp(substeps)[trip + REACTION])
    at_rest = home + touched.shares[0] * DOWN
    np.testing.assert_allclose(simulation.joints()[0], at_rest, atol=1e-3)
    assert touched.contacts[0] >= 1
    assert 0 < touched.travel[0] < np.abs(DOWN).max()
    assert simulation._model.sensor(SENSOR).dim[0] == 4


def test_a_motion_that_touches_nothing_ends_where_that_of_reaching_does():
    world, words = nominal(), np.array([[0.1, 0.05, 0.02], [-0.3, 0.1, 0.0], [0.2, 0.0, 0.1]])
    ends, arguments = [], {"world": world, "terminate_on_success": False}
    for env in (make("SafeReach", **arguments), kinematic(**arguments)):
        env.reset(seed=0, options={"object": (0.4, 0.1, 0.15)})
        ends.append(np.array([env.step(each)[-1]["truth"]["points"] for each in words]))
    assert np.abs(ends[0] - ends[1]).max() * 256 < 0.1


def test_joints_never_pass_their_stops_however_strong_motors_are():
    env = make("SafeReach", gains=(8.0, 8.0), force_bound=1e9).unwrapped
    stops = env.arms.robot.stops
    for seed in range(3):
        env.reset(seed=seed)
        for words in np.random.default_rng(seed).choice([-1.0, 1.0], (4, 3)):
            _, _, _, _, info = env.step(words)
            joints = info["truth"]["joints"][:3]
            assert (joints >= stops[:, 0]).all()
            assert (joints <= stops[:, 1]).all()
            assert info["joint_travel"] <= np.ptp(stops, 1).max()


def test_a_world_is_that_of_reaching_but_for_the_strength_of_its_motors():
    env = make("SafeReach").unwrapped
    factors = []
    for seed in range(12):
        env.reset(seed=seed)
        drawn = dict(env.world.to_dict())
        usual = WorldDistribution("wild")
        attempts = [usual.sample(seed, attempt).to_dict() for attempt in range(40)]
        others = drawn.keys() - {"motor_gain"}
        (same,) = (each for each in attempts if all(each[key] == drawn[key] for key in others))
        factors.append(np.array(drawn["motor_gain"]) / same["motor_gain"])
    factors = np.array(factors)
    assert 0.25 <= factors.min() < 0.4
    assert 5 < factors.max() <= 8
    world = nominal()
    env = begun(make("SafeReach", world=world).unwrapped)
    assert env.world == world, "a given world is as it is"


def test_the_way_to_an_object_touches_nothing():
    env = make("SafeReach", tell=("object_registers",)).unwrapped
    for seed in range(5):
        observation, _ = env.reset(seed=seed)
        arms = env.arms
        registers = np.stack([np.zeros(3), observation["object_registers"]])
        home, there = (arms.motors.joints(each[None], slice(None))[0] for each in registers)
        picture = arms.simulation.picture()
        for share in np.linspace(0, 1, 30):
            model, data = arms.simulation.show(0, picture, home + share * (there - home))
            mujoco.mj_collision(model, data)
            assert not data.ncon, f"seed {seed} at {share}"


def test_a_contact_above_the_bound_ends_the_trial_and_says_so():
    for bound, ends in ((20.0, True), (1e6, False)):
        env = begun(make("SafeReach", world="nominal", force_bound=bound))
        _, _, terminated, truncated, info = env.step([0.0, -0.3, 0.0])
        assert info["peak_force"] > 20
        assert (truncated, bool(info["harmed"]), terminated) == (ends, ends, False)
        assert env.reset()[1]["harmed"] == np.False_


@pytest.mark.parametrize("name", ARMS)
def test_walls_stand_beside_any_arm_at_home(name):
    env = begun(make("SafeReach", arm=ARMS[name], camera_mount="stand", world="nominal"))
    arms = env.unwrapped.arms
    home = arms.motors.joints(np.zeros((1, len(arms.robot.motors))), np.array([0]))[0]
    assert arms.simulation.is_collision_free(0, home)


def test_weak_motors_of_a_drawn_world_leave_an_object_to_reach():
    env = make("SafeReach", gains=(0.05, 0.4))
    for seed in range(12):
        env.reset(seed=seed)
        env.reset()
    with pytest.raises(ValueError, match=r"too weak with gains \[0.02, 0.02\]"):
        make("SafeReach", gains=(0.02, 0.02)).reset(seed=0)


def test_a_place_that_is_free_is_so_by_mujocos_distances():
    arms = make("SafeReach", world="nominal").unwrapped.arms
    arms.seed(0, 0)
    simulation = arms.simulation
    picture, rng = simulation.picture(), np.random.default_rng(0)
    model = picture[0]
    room = [g for g in range(model.ngeom) if model.geom(g).name.startswith("calfree room")]
    moves = model.body_weldid[model.geom_bodyid] != 0
    arm = [g for g in range(model.ngeom) if model.geom_contype[g] and moves[g]]
    nearest = []
    for registers in rng.uniform(-1, 1, (600, 1, 3)):
        joints = arms.motors.joints(registers, np.array([0]))[0]
        model, data = simulation.show(0, picture, joints)
        way = [mujoco.mj_geomDistance(model, data, a, r, 1.0, None) for a in arm for r in room]
        near = min(way)
        nearest.append(near)
        if simulation.is_collision_free(0, joints):
            assert near >= CLEARANCE - 1e-6
    assert sum(0 < near < CLEARANCE for near in nearest) > 3


@pytest.mark.parametrize("name", ["torque", "redundant", "scara", "hobby", "gripper"])
def test_links_do_not_count_that_are_so_near_to_each_other_as_built(name):
    robot = Arm(**ARMS[name]).robot
    scene = robot.scene(("world", "world"), furniture(robot))
    model, data = scene.model, mujoco.MjData(scene.model)
    data.qpos[:] = scene.home
    mujoco.mj_fwdPosition(model, data)
    nearest = collections.defaultdict(lambda: np.inf)
    links = [geom for geom in np.flatnonzero(of_arm(model, robot)) if model.geom_contype[geom]]
    for one, other in itertools.combinations(links, 2):
        bodies = tuple(sorted(model.geom_bodyid[[one, other]].tolist()))
        welded = [int(model.body_weldid[body]) for body in bodies]
        parents = [int(model.body_weldid[model.body_parentid[body]]) for body in welded]
        joined = welded[0] in (welded[1], parents[1]) or welded[1] == parents[0]
        if not joined:  # else they never count
            near = mujoco.mj_geomDistance(model, data, one, other, 1.0, None)
            nearest[bodies] = min(nearest[bodies], near)
    excluded = {(pair >> 16, pair & 0xFFFF) for pair in model.exclude_signature.tolist()}
    clear = CLEARANCE * robot.rig.scale
    assert nearest
    assert {bodies for bodies, near in nearest.items() if near <= clear} == excluded & nearest.keys()


def test_a_stopped_arm_stays_where_it_is():
    world = replace(nominal(), backlash=np.full(3, np.radians(2)))
    env = begun(make("SafeReach", world=world, force_bound=1e6))
    *_, info = env.step([0.0, -0.3, 0.0])
    assert info["contacts"]
    *_, info = env.step([0.0, 0.0, 0.0])
    assert info["joint_travel"] < np.radians(0.1)


def test_a_world_in_which_the_arm_touches_at_home_is_named():
    down = replace(nominal(), joint_zeros=np.radians([0.0, -35.0, 0.0, 0.0]))
    env = make("SafeReach", world=down, keep_in_view=False)
    message = r"touches itself at home, or is nearer to table or walls than 0\.030 m"
    with pytest.raises(ValueError, match=message):
        env.reset(seed=0)


@pytest.mark.parametrize(
    ("task", "joint", "degrees"),
    [("SafeReach", "J2", -2.0), ("Grasp", "J4", 3.0), ("Insert", "J4", 2.0)],
)
def test_a_drift_turns_back_before_no_trial_can_begin(task, joint, degrees):
    do = {"type": "joint_zero", "joint": joint, "degrees": degrees}
    env = make(task, world="nominal", perturbations=[{"drift": {"per": "trial"}, "do": do}])
    zeros = [env.unwrapped.world.joint_zeros.sum() for _ in trials(env, 25)]
    assert len(set(np.sign(np.diff(zeros)))) == 2


def test_another_arm_that_stands_beside_a_wall_does_not_count(tmp_path):
    arm = ARMS["hobby"]
    env = make("SafeReach", arm=arm, camera_mount="stand", world="nominal")
    room = env.unwrapped.arms.simulation.picture()[0]
    spec = mujoco.MjSpec.from_file(str(arm["model"]))
    wall, turn = room.geom("calfree room front wall"), np.zeros(9)
    mujoco.mju_quat2Mat(turn, wall.quat)
    other = spec.worldbody.add_body(pos=wall.pos + (wall.size[0] + 0.04) * turn[::3])
    other.add_joint(type=mujoco.mjtJoint.mjJNT_HINGE)
    other.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[0.03, 0, 0], mass=0.1)
    (tmp_path / "two.xml").write_text(spec.to_xml())
    env = make("SafeReach", arm={**arm, "model": tmp_path / "two.xml"}, camera_mount="stand", world="nominal")
    env.reset(seed=0)
    *_, info = env.step(np.zeros(env.action_space.shape, np.float32))
    assert info["contacts"] == 0
