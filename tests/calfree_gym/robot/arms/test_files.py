"""Each file of a model is the one that MuJoCo itself takes, whichever model names it and however."""

import hashlib
import re
import shutil
from pathlib import Path

import mujoco
import numpy as np
import pytest

from calfree_gym import Arm
from calfree_gym.robot.arms.arm import digest_of
from calfree_gym.robot.arms.mjcf import compiled, read
from tests.calfree_gym.robot.arms.layouts import LAYOUTS, MESH, mesh, model, with_hand, write_files
from tests.calfree_gym.robot.arms.test_arm import CHAIN


@pytest.fixture
def files(tmp_path, monkeypatch):
    write_files(tmp_path)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def of_mujoco(source):
    if isinstance(source, mujoco.MjSpec):
        spec = source.copy()
    elif str(source).startswith("<"):
        spec = mujoco.MjSpec.from_string(source)
    else:
        spec = mujoco.MjSpec.from_file(str(source))
    spec.compiler.discardvisual = spec.compiler.fusestatic = False
    return spec.compile()


@pytest.mark.parametrize("layout", LAYOUTS)
def test_all_arrays_are_those_of_mujocos_own_model(layout, files):
    make, count = LAYOUTS[layout]
    source = make(files)
    expected, (text, assets) = of_mujoco(source), read(source)
    found = compiled(text)[1]
    compared = 0
    for name in dir(expected):
        wanted, values = getattr(expected, name), getattr(found, name)
        if isinstance(wanted, np.ndarray) and not name.startswith(("name", "_")) and "path" not in name:
            exact = name.split("_")[0] in ("mesh", "tex", "hfield")
            np.testing.assert_allclose(values, wanted, *((0, 0) if exact else (1e-5, 1e-6)), err_msg=name)
            compared += 1
    assert compared > 300
    assert len(assets) == count
    for file, digest in assets.items():
        assert hashlib.sha256(Path(file).read_bytes()).hexdigest() == digest
    assert read(text) == (text, assets)


def digest(source):
    text, assets = read(source)
    return digest_of({"model": text, "assets": assets})


@pytest.mark.parametrize("layout", LAYOUTS)
def test_the_digest_is_of_the_files_wherever_they_are(layout, files, monkeypatch):
    shutil.copytree(files, files / "a & b")
    make, _ = LAYOUTS[layout]
    here = digest(make(files))
    monkeypatch.chdir(files / "a & b")
    source = make(files / "a & b")
    assert digest(source) == here
    for file in (Path(each) for each in read(source)[1] if each.endswith(".stl")):
        file.write_bytes(file.read_bytes()[:-1] + b"\1")  # a byte that no mesh is made of
        before, here = here, digest(source)
        assert here != before


def test_an_arm_with_a_hand_of_another_file(files):
    model(files / "hand/hand.xml", MESH, compiler='meshdir="m"')
    hand = '<asset><model name="hand" file="../hand/hand.xml"/></asset><worldbody>'
    text = CHAIN.replace("<worldbody>", hand).replace(
        "<site", '<attach model="hand" body="b" prefix="h/"/><site'
    )
    (files / "arm/arm.xml").write_text(text)
    arm = Arm(files / "arm/arm.xml", "tip")
    own = mujoco.MjModel.from_xml_path(str(files / "arm/arm.xml"))
    described = arm.to_dict()
    again = Arm.from_dict(described)
    for each in (arm, again):
        np.testing.assert_array_equal(each.robot.model.mesh_vert, own.mesh_vert)
    assert again == arm
    assert again.to_dict() == described
    assert described["assets"].keys() == {str(files / "hand/m/p.stl")}
    (files / "hand/m/p.stl").write_bytes(mesh(3))
    with pytest.raises(ValueError, match=r"asset .*/hand/m/p.stl has changed since the arm was described"):
        Arm.from_dict(described)
    (files / "hand/m/p.stl").unlink()
    with pytest.raises(ValueError, match=r"text names p.stl, .* at .*/hand/m/p.stl \(mesh 'h/p'\)$"):
        Arm.from_dict(described)


@pytest.mark.parametrize(
    ("assets", "found"),
    [
        ('<mesh name="p" file="no.stl"/>', "{0}/no.stl (mesh 'p')"),
        ('<mesh file="no.stl"/><mesh name="q" file="no.stl"/>', "{0}/no.stl (mesh 'no', mesh 'q')"),
        ('<hfield name="p" file="up/no.png" size="1 1 1 1"/>', "{0}/up/no.png (hfield 'p')"),
        ('<skin name="p" file="no.skn"/>', "{0}/no.skn (skin 'p')"),
        ('<texture name="p" type="2d" file="no.png"/>', "{1}/no.png (texture 'p')"),
        ('<texture name="p" type="cube" fileup="p.png" fileback="no.png"/>', "{1}/no.png (texture 'p')"),
        (
            '<mesh name="p" file="package://up/no.stl"/>',
            "package:/up/no.stl, seen from the model that names it (mesh 'p')",
        ),
        ('<mesh name="p" file="/up/no.stl"/>', "/up/no.stl (mesh 'p')"),
    ],
)
def test_a_missing_file_and_what_it_is_for_are_named(assets, found, files):
    arm = model(files / "arm/arm.xml", assets, '<geom size="1"/>', 'meshdir="m" texturedir="t"')
    found = found.format(files / "arm/m", files / "arm/t")
    with pytest.raises(
        ValueError, match=rf"arm.xml names no.\w+, which cannot be read at {re.escape(found)}$"
    ):
        read(arm)


NO_MODEL = r"arm.xml is no MJCF that MuJoCo can read: [^']*'.*no.xml'\nElement '"


@pytest.mark.parametrize(
    ("hand", "assets", "message"),
    [
        (True, '<mesh name="p" file="no.stl"/>', r" at m/no.stl, seen from .* it \(mesh 'h/p'\)$"),
        (True, '<texture name="p" type="2d" file="no.png"/>', r" at no.png, .* it \(texture 'h/p'\)$"),
        (False, '<model name="hand" file="no.xml"/>', NO_MODEL),
        (False, '</asset><include file="no.xml"/><asset>', NO_MODEL),
    ],
)
def test_missing_models_and_files_of_attached_ones_are_named(hand, assets, message, files):
    path = files / ("hand/hand.xml" if hand else "arm/arm.xml")
    arm = model(path, assets, '<geom size="1"/>', 'meshdir="m"' if hand else "")
    with pytest.raises(ValueError, match=message):
        read(with_hand(files, "../hand/hand.xml") if hand else arm)


@pytest.mark.parametrize("named", ["hand.xml", "../arm/&#97;rm.xml"])
def test_a_model_that_is_made_of_itself_is_refused(named, files, monkeypatch):
    """MuJoCo would end the process."""
    monkeypatch.chdir(files / "arm")
    arm = with_hand(files, "../hand/hand.xml")
    model(files / "hand/hand.xml", f'<model name="h" file="{named}"/>', '<geom size="1"/>')
    for take, source in ((read, arm), (read, arm.read_text()), (compiled, arm.read_text())):
        with pytest.raises(ValueError, match=r"is made of itself: .*hand\.xml names "):
            take(source)


@pytest.mark.parametrize("named", ["nothing/../hand.xml", "./" * 2100 + "hand.xml", "ha&#x6e;d.xml"])
def test_so_is_one_however_the_file_is_spelled(named, files):
    arm = with_hand(files, "../hand/hand.xml")
    model(files / "hand/hand.xml", f'< model name="h" file="{named}"/>', '<geom size="1"/>')
    with pytest.raises(ValueError, match=r"crashes MuJoCo, as a model does that is made of itself"):
        read(arm)
