"""Printed tags on the bench, in place of its balls: two cards on the gripper, and one for the object."""

import copy

import mujoco
import numpy as np

from calfree_gym.vision.tags import CELL, SPACING
from tests.calfree_gym.vision.printed_tags import HEIGHT, tag

MARKS = ("gripper_1", "gripper_2", "object")
APART, HALF = SPACING * CELL / 1000, 4 * CELL / 1000
"""Between the gripper's tags, and half the side of a card with its white margin; in m."""
HAND_FACES, OBJECT_FACES = (0.94, 0.08, 0.32), (0.68, 0.03, 0.65)
"""Where the gripper's cards face, in the hand's axes, and the object's: from home, between the cameras."""
SPREAD = 0.3
"""As of worlds with balls; tags are not to turn away from the cameras."""
CAMERAS = ((0.6, 0.19, 0.4), (0.63, -0.16, 0.37))
"""More to the front, and nearer, than for balls, which are seen from all sides."""
BEYOND = 0.03
"""The cards are so far beyond the fingers, in m: these would cover them."""
NARROWEST = 37 * np.cos(np.radians(45))
"""In px: tags that large and tilted that much are asked to be found."""

GRID = np.stack(np.meshgrid(*[np.linspace(-0.9, 0.9, 7)] * 2), -1).reshape(-1, 2)
"""Places on a card (n, 2), by half of its side: the tag, and half of its margin."""


def put_tags(spec):
    """Puts cards in place of a model's balls and their bar, by the balls' names. Tags face their z axes."""
    hand, object_ = (spec.geom(name).parent for name in MARKS[1:])
    for name in ("bar", *MARKS):
        spec.delete(spec.geom(name))
    axes, grip = facing(HAND_FACES, (0, 0, 1)), spec.site("grip").pos
    grip[2] -= BEYOND
    sideways = APART / 2 * axes[:, 0]
    to_cameras = facing(OBJECT_FACES, (0, 0, 1))
    places = (hand, grip - sideways, axes), (hand, grip + sideways, axes), (object_, (0, 0, 0), to_cameras)
    for number, (name, (body, at, axes)) in enumerate(zip(MARKS, places, strict=True)):
        cells = np.kron(tag(number), np.ones((16, 16)))
        texture = spec.add_texture(name=name, type=mujoco.mjtTexture.mjTEXTURE_2D, nchannel=3)
        texture.height, texture.width = cells.shape
        texture.data = (25 + 195 * cells).astype(np.uint8).repeat(3).tobytes()
        spec.add_material(name=name).textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = name
        card = body.add_geom(name=name, type=mujoco.mjtGeom.mjGEOM_BOX, size=(HALF, HALF, 0.0005), pos=at)
        card.material, card.contype, card.conaffinity, card.mass = name, 0, 0, 0.004
        mujoco.mju_mat2Quat(card.quat, axes.ravel())


def facing(normal, up):
    """Axes (3, 3), as columns, the third one along a normal, the second one as far up as can be."""
    z = np.array(normal) / np.linalg.norm(normal)
    x = np.cross(up, z)
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(z, x), z])


def see_tags(model, data, world, *places):
    """Whether both cameras see the gripper's tags, and where the object is at a place, its own."""
    shown = copy.copy(data)
    if places:
        shown.mocap_pos[0] = places[0]
    mujoco.mj_kinematics(model, shown)
    cards = [shown.geom(name) for name in MARKS[: 2 + len(places)]]
    return all(_sees(model, shown, world, camera, card) for camera in range(2) for card in cards)


def _sees(model, data, world, camera, card):
    """Whether a camera sees a card: wide enough, well inside the image, and with nothing before it."""
    at, focal = world.positions[camera], HEIGHT / 2 / np.tan(np.radians(world.fovy[camera]) / 2)
    axes = card.xmat.reshape(3, 3)
    ways = card.xpos + HALF * GRID @ axes.T[:2] - at
    far = np.linalg.norm(ways, axis=1)
    wide = focal * 6 * CELL / 1000 * (-ways @ axes[:, 2]) / far**2
    if wide.min() < NARROWEST or not world.shows(card.xpos):
        return False
    met = np.full((len(ways), 1), -1, np.int32)
    for way, geom in zip(ways, met, strict=True):
        mujoco.mj_ray(model, data, at, way, None, 1, -1, geom, None)
    return bool((met == card.id).all())
