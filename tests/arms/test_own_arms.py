"""Arms are what their tables say: our own, and those that `make arms` has fetched."""

import mujoco
import pytest

from tests.arms.fetched import FETCHED, fetched_arms
from tests.arms.own import ARMS, MOTORS

COUNTS = {"so101": 5, "so100": 5, "aloha": 6, "spot_arm": 6, "ur5e": 6}
"""Motors of the fetched ones; seven where nothing else is said."""


def motors_of(arm):
    """Names of the joints from its base (its own left out) to its gripper, in their order."""
    model = mujoco.MjModel.from_xml_path(str(arm["model"]))
    sites = [model.site(i).name for i in range(model.nsite)]
    gripper, names = arm["gripper"], []
    body = model.site(gripper).bodyid.item() if gripper in sites else model.body(gripper).id
    while body not in (0, model.body(arm["base"]).id if "base" in arm else 0):
        first, count = model.body_jntadr[body], model.body_jntnum[body]
        names = [model.joint(i).name for i in range(first, first + count)] + names
        body = model.body_parentid[body]
    return names


@pytest.mark.parametrize("name", ARMS)
def test_motors_are_the_joints_from_the_base_to_the_gripper(name):
    assert motors_of(ARMS[name]) == list(MOTORS[name])


@pytest.mark.slow
@pytest.mark.parametrize("name", FETCHED)
def test_fetched_arms_are_what_the_table_says(name):
    if (arm := fetched_arms().get(name)) is None:
        pytest.skip("`make arms` has not fetched it")
    motors = motors_of(arm)
    assert len(motors) == COUNTS.get(name, 7)
    assert arm.get("motors", motors) == motors
    assert set(arm.get("home", {})) <= set(motors)
