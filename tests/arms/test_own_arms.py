"""Our own arms are what their table says."""

import mujoco
import pytest

from tests.arms.own import ARMS, MOTORS


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


@pytest.mark.parametrize("name", ARMS)
def test_motors_are_the_joints_from_the_base_to_the_gripper(name):
    model, arm = mujoco.MjModel.from_xml_path(str(ARMS[name]["model"])), ARMS[name]
    base = model.body(arm["base"]).id if "base" in arm else 0
    assert joints_to(model, gripper_body(model, arm["gripper"]), base) == list(MOTORS[name])
