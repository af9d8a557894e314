"""Our own arms are what their table says, and between them have what breaks code that is too sure of MJCF."""

import mujoco
import numpy as np
import pytest

from tests.arms.own import ARMS, MOTORS

FREE = mujoco.mjtJoint.mjJNT_FREE


@pytest.fixture(params=ARMS)
def arm(request):
    arguments = ARMS[request.param]
    return arguments, mujoco.MjModel.from_xml_path(str(arguments["model"])), MOTORS[request.param]


def gripper_body(model, name):
    sites = [model.site(i).name for i in range(model.nsite)]
    return model.site(name).bodyid.item() if name in sites else model.body(name).id


def joints_to(model, body, base):
    """Names of the joints from `base` (its own left out) to a body, in their order."""
    names = []
    while body not in (0, base):
        first, count = model.body_jntadr[body], model.body_jntnum[body]
        names = [model.joint(i).name for i in range(first, first + count)] + names
        body = model.body_parentid[body]
    return names


def test_motors_are_the_joints_from_the_base_to_the_gripper(arm):
    arguments, model, motors = arm
    base = model.body(arguments["base"]).id if "base" in arguments else 0
    assert joints_to(model, gripper_body(model, arguments["gripper"]), base) == list(motors)
    kinds = [model.joint(name).type.item() for name in motors]
    assert set(kinds) <= {mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE}


def test_every_motor_has_one_actuator(arm):
    _, model, motors = arm
    driven = [
        model.joint(joint).name
        for joint, kind in zip(model.actuator_trnid[:, 0], model.actuator_trntype, strict=True)
        if kind == mujoco.mjtTrn.mjTRN_JOINT
    ]
    assert [name for name in driven if name in motors] == list(motors)


@pytest.mark.parametrize("name", [name for name, arguments in ARMS.items() if "home" in arguments])
def test_a_home_that_is_given_is_a_keyframe_within_the_limits(name):
    model = mujoco.MjModel.from_xml_path(str(ARMS[name]["model"]))
    qpos = model.key(ARMS[name]["home"]).qpos
    for motor in MOTORS[name]:
        joint = model.joint(motor)
        low, high = joint.range
        assert low < qpos[joint.qposadr.item()] < high


def test_masses_are_those_of_arms(arm):
    _, model, motors = arm
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    first = model.joint(motors[0]).bodyid.item()
    assert 0.2 < model.body_subtreemass[first] < 40
    inertia = np.empty((model.nv, model.nv))
    mujoco.mj_fullM(model, data, inertia)
    assert np.linalg.eigvalsh(inertia).min() > 0


def test_between_them_they_have_what_real_files_have():
    models = {name: mujoco.MjModel.from_xml_path(str(arm["model"])) for name, arm in ARMS.items()}

    def some(has):
        return {name for name, model in models.items() if has(model)}

    assert some(lambda m: not m.jnt_limited.all()) >= {"hobby", "torque"}
    assert some(lambda m: (m.dof_frictionloss > 0).any())
    assert some(lambda m: (m.dof_damping > 0).any())
    assert some(lambda m: (m.jnt_stiffness > 0).any()) == {"mobile"}
    assert some(lambda m: m.neq > 0 and m.ntendon > 0 and m.nkey > 0) == {"gripper"}
    assert some(lambda m: m.na > 0) == {"gantry"}
    assert some(lambda m: m.nmesh == 2) == {"names"}
    assert some(lambda m: m.actuator_ctrllimited.all() and (m.actuator_gear[:, 0] != 1).all()) >= {"names"}
    assert some(lambda m: m.jnt_pos.any()) == {"names"}
    assert some(lambda m: m.jnt_actfrclimited.any()) == {"hobby"}
    assert some(lambda m: (m.qpos0[m.jnt_qposadr[m.jnt_type != FREE]] != 0).any()) == {"mobile"}
    assert some(lambda m: (m.body_jntnum[-1:] == 2).any()) == {"mobile"}
    assert set(map(len, MOTORS.values())) == {3, 4, 5, 6, 7}
