"""Models that name files in all ways that MuJoCo knows: functions that write one and return a source."""

import struct

import cv2
import mujoco
import numpy as np

CORNERS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], np.float32)
FACES = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
FOLDERS = ["", "m", "t", "arm", "arm/m", "arm/t", "hand", "hand/m", "hand/t", "tool", "tool/m", "tool/t"]
GEOM = '<geom type="mesh" mesh="p"/>'
MESH = '<mesh name="p" file="p.stl"/>'
PICTURE = '<texture name="t" type="2d" file="p.png"/><material name="t" texture="t"/>'
SIX = "".join(f' file{face}="{face}.png"' for face in ("right", "left", "up", "down", "front", "back"))


def mesh(size):
    corners = size * CORNERS[FACES]
    triangles = b"".join(bytes(12) + each.tobytes() + bytes(2) for each in corners)
    return bytes(80) + struct.pack("<I", len(FACES)) + triangles


def field(size):
    return struct.pack("<2i", 2, 2) + np.float32([0, size, 2, 3]).tobytes()


def skin(size):
    sizes = np.int32([len(CORNERS), 0, len(FACES), 1])
    bone = struct.pack("<40s7fi", b"b", 0, 0, 0, 1, 0, 0, 0, len(CORNERS))
    weights = np.arange(len(CORNERS), dtype=np.int32).tobytes() + np.ones(len(CORNERS), np.float32).tobytes()
    return sizes.tobytes() + (size * CORNERS).tobytes() + FACES.astype(np.int32).tobytes() + bone + weights


def surface(size):
    corners = "".join(f"v {x} {y} {z}\n" for x, y, z in size * CORNERS)
    return (corners + "".join(f"f {a} {b} {c}\n" for a, b, c in FACES + 1)).encode()


def write_files(folder):
    makers = {"p.stl": mesh, "p.bin": field, "p.skn": skin, "p.obj": surface}
    for number, each in enumerate(FOLDERS):
        (folder / each).mkdir(exist_ok=True)
        for name, make in makers.items():
            (folder / each / name).write_bytes(make(0.1 + 0.01 * number))
        for at, name in enumerate(("p", "right", "left", "up", "down", "front", "back")):
            picture = np.full((2, 2, 3), 10 * number + at, np.uint8)
            cv2.imwrite(str(folder / each / f"{name}.png"), picture)


def model(path, assets, body=GEOM, compiler="", more=""):
    path.parent.mkdir(exist_ok=True)
    text = f'<mujoco><compiler {compiler}/><asset>{assets}</asset><worldbody><body name="b">{body}</body>'
    path.write_text(text + f"</worldbody>{more}</mujoco>")
    return path


def with_hand(folder, hand, compiler="", assets="", body="", prefix="h/"):
    assets += f'<model name="hand" file="{hand}"/>'
    return model(
        folder / "arm/arm.xml", assets, f'{body}<attach model="hand" body="b" prefix="{prefix}"/>', compiler
    )


def arm_of(assets, body=GEOM, compiler=""):
    return lambda folder: model(folder / "arm/arm.xml", assets.format(folder), body, compiler)


plain = arm_of(MESH + PICTURE, compiler='meshdir="m" texturedir="t"')


def other_kinds(folder):
    assets = f'{MESH}<hfield name="p" file="p.bin" size="1 1 1 1"/><skin name="p" file="p.skn"/>'
    assets += f'<texture type="skybox" file="p.png"/><texture name="six" type="cube"{SIX}/>'
    assets += '<texture name="two" type="cube" gridsize="3 4" fileup="p.png" fileback="back.png"/>'
    body = f'{GEOM}<geom type="hfield" hfield="p"/>'
    return model(folder / "hand/hand.xml", assets, body, 'meshdir="m" texturedir="t"')


def attached(folder):
    other_kinds(folder)
    return with_hand(folder, "../hand/hand.xml")


def attached_to_its_likes(folder):
    other_kinds(folder)
    return with_hand(folder, "../hand/hand.xml", 'meshdir="m"', MESH + PICTURE, GEOM)


def attached_without_a_folder(folder):
    model(folder / "hand/hand.xml", MESH + PICTURE)
    return with_hand(folder, "../hand/hand.xml", 'assetdir="m"')


def attached_and_stripped(folder):
    model(folder / "hand/hand.xml", MESH.replace("p.stl", "m/p.stl"))
    return with_hand(folder, "../hand/hand.xml", 'meshdir="m" strippath="true"')


def attached_two_deep(folder):
    model(folder / "tool/tool.xml", MESH + PICTURE, compiler='meshdir="m"')
    inner = '<model name="tool" file="../tool/tool.xml"/>'
    body = f'{GEOM}<body><attach model="tool" body="b" prefix="t/"/></body>'
    model(folder / "hand/hand.xml", inner + MESH, body, 'meshdir="m"')
    return with_hand(folder, "../hand/hand.xml", "", MESH, GEOM)


def included(folder):
    (folder / "hand/assets.xml").write_text(f"<mujoco><asset>{PICTURE}</asset></mujoco>")
    more = '<include file="../hand/assets.xml"/>'
    return model(folder / "arm/arm.xml", MESH, compiler='meshdir="../tool/m"', more=more)


def included_with_its_folder(folder):
    model(folder / "hand/hand.xml", MESH, compiler='meshdir="m"')
    (folder / "arm/arm.xml").write_text('<mujoco><include file="../hand/hand.xml"/></mujoco>')
    return folder / "arm/arm.xml"


def soft(folder):
    flex = '<flexcomp name="f" type="mesh" dim="2" file="p.obj" mass="1"><edge equality="true"/></flexcomp>'
    model(folder / "hand/hand.xml", MESH, GEOM + flex, 'meshdir="m"')
    return with_hand(folder, "../hand/hand.xml")


def text(folder):
    return model(folder / "arm/arm.xml", MESH + PICTURE, compiler='meshdir="hand/m"').read_text()


def text_that_attaches(folder):
    other_kinds(folder)
    return with_hand(folder, "hand/hand.xml").read_text()


def by_hand(folder):
    other_kinds(folder)
    arm = mujoco.MjSpec.from_file(str(plain(folder)))
    hand = mujoco.MjSpec.from_file("hand/hand.xml")
    arm.body("b").add_frame().attach_body(hand.body("b"), "h/", "")
    other = mujoco.MjSpec.from_file(str(model(folder / "tool/tool.xml", MESH)))
    arm.attach(other, prefix="t/", frame=arm.worldbody.add_frame())
    return arm


def added_by_hand(folder):
    arm = mujoco.MjSpec.from_file(str(plain(folder)))
    arm.add_mesh(name="q", file="../../tool/p.stl")
    arm.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname="q")
    return arm


def urdf(compiler="", visual="p.stl"):
    mesh = '<{0}><geometry><mesh filename="{1}"/></geometry></{0}>'
    inertia = '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>'
    link = f'<link name="a"><inertial><mass value="1"/>{inertia}</inertial>'
    link += mesh.format("visual", visual) + mesh.format("collision", "../tool/m/p.stl")
    robot = f'<robot name="u"><mujoco><compiler {compiler}/></mujoco>{link}</link></robot>'

    def written(folder):
        (folder / "arm/arm.urdf").write_text(robot)
        return folder / "arm/arm.urdf"

    return written


KEPT = 'discardvisual="false"'
STRIPPED = MESH.replace("p.stl", "export/p.stl") + PICTURE.replace("p.png", "/no/p.png")
LAYOUTS = {
    "plain": (plain, 2),
    "asset folder": (arm_of(MESH + PICTURE, compiler='assetdir="../hand/m"'), 2),
    "above": (arm_of(MESH.replace("p.stl", "../../hand/p.stl"), compiler='meshdir="m"'), 1),
    "absolute": (arm_of(MESH.replace("p.stl", "{}/tool/p.stl"), compiler='meshdir="m"'), 1),
    "stripped": (arm_of(STRIPPED, compiler='meshdir="m" texturedir="t" strippath="true"'), 2),
    "other kinds": (other_kinds, 3 + 1 + 6),
    "attached": (attached, 9),
    "attached to its likes": (attached_to_its_likes, 11),
    "attached without a folder": (attached_without_a_folder, 2),
    "attached and stripped": (attached_and_stripped, 1),
    "attached two deep": (attached_two_deep, 4),
    "included": (included, 2),
    "included with its folder": (included_with_its_folder, 1),
    "replicated": (arm_of(MESH, f'<replicate count="3" offset="0 0 1">{GEOM}</replicate>', 'meshdir="m"'), 1),
    "soft": (soft, 1),
    "text": (text, 2),
    "text that attaches": (text_that_attaches, 9),
    "by hand": (by_hand, 12),
    "added by hand": (added_by_hand, 3),
    "URDF": (urdf(), 1),
    "URDF that keeps visuals": (urdf(f'meshdir="../hand" {KEPT}', "../tool/m/p.stl"), 1),
    "URDF without paths": (urdf(f'meshdir="../hand/m" strippath="true" {KEPT}', "package://arm/p.stl"), 1),
}
"""What makes each, and how many files it names."""
