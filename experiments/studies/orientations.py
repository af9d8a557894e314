"""In which orientations things can be grasped by five joints, and in which the agent grasps them (3.5)."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
import pandas as pd

import agents
from calfree_gym import MOUNTS
from calfree_gym.geometry import Array, rotation_matrix
from calfree_gym.robot.grasping.gripping_arm import STROKE
from calfree_gym.robot.grasping.held import PITCHES, ROLLS, HeldSimulation, drawn_pose
from calfree_gym.robot.grasping.shapes import SHAPE_NAMES
from experiments.reporting.tables import Table, beside
from experiments.statistics import mean_share
from experiments.studies.common import GRASP, first_trial

FIRST_WORLD, WORLDS = 40_000, 50
"""Wild worlds that nobody tuned on."""
ASKED_OF = 0.90
"""Of things that can be grasped, the agent is to grasp so many."""
SQUARELY = np.cos(np.radians(15.0))
"""Jaws that press within 15 degrees of a face's normal."""
EACH = 20
"""Things in a world, for the map."""
SLANTS = (0, 30, 60, 90)
DOWN = -np.pi / 2
COLUMNS = ("map", "straight down", "squarely", "search", "agree", "grasped", "required")
"""Shares."""
UP = np.array([0.0, 0.0, 0.06])
"""The search lifts things by so much (m), or draws them back where the arm cannot."""
HANGS = 0.03
"""A thing that is then so near to the gripper point (m) was held. Derived: the longest slip to it by less."""


class Told(NamedTuple):
    """What geometry says of a thing at one orientation; the slant is that of its main axis (degrees).

    Attributes:
        down: The same of a gripper that points straight down.
        squarely: The same of jaws that press squarely.
    """

    slant: float
    map: bool
    down: bool
    squarely: bool


def tables(worlds: int = WORLDS, mounts: tuple[str, ...] = MOUNTS) -> Iterator[Table]:
    """The map by geometry, on the first mount; beside it what a search finds, and what the agent grasps."""
    drawn = (
        f"wild worlds {FIRST_WORLD}-{FIRST_WORLD + worlds - 1}, 30 to 50 cm away, in view, all orientations "
        "alike"
    )
    told = (
        "Map: geometry and friction say that five joints can grasp it; straight down: by a gripper that "
        "points down; squarely: by jaws within 15 degrees of a face's normal."
    )
    shares = dict.fromkeys(COLUMNS, ".0%")
    rows = [row for shape in SHAPE_NAMES for row in _map(shape, mounts[0], worlds)]
    title = "Which orientations five joints can grasp"
    note = f"{EACH} things of a shape in each of {drawn}. Slant: of the main axis, from the vertical. {told}"
    yield Table("orientations_map", title, pd.DataFrame(rows), shares, note)
    rows = [_searched(shape, mount, worlds) for mount in mounts for shape in SHAPE_NAMES]
    note = (
        f"One thing in each of {drawn}. {told} Search: some pitch (every 7.5 degrees) and roll (every 15) "
        "has lifted it in full physics. Agree: map and search. Grasped: by `grasp`, which knew nothing, in "
        "its first trial, of those that the search has lifted; by the truth. Brackets: 95 % intervals over "
        "worlds."
    )
    yield Table("orientations", "Things at any orientation", pd.DataFrame(rows), shares, note)


def _map(shape: str, mount: str, worlds: int) -> list[dict[str, Any]]:
    env, found = _env(shape, mount), list[Told]()
    for seed in range(FIRST_WORLD, FIRST_WORLD + worlds):
        env.reset(seed=seed)
        arms, rng = env.unwrapped.arms, np.random.default_rng(seed)  # type: ignore[attr-defined]
        found += [_told(arms, _pose(arms, rng)) for _ in range(EACH)]
    env.close()
    frame = pd.DataFrame(found)
    rows = []
    for least, most in pairwise(SLANTS):
        those = frame[(frame["slant"] >= least) & (frame["slant"] < most)]
        shares = {"map": those["map"], "straight down": those["down"], "squarely": those["squarely"]}
        row = {"shape": shape, "slant": f"{least} to {most}°", "things": len(those)}
        rows.append(row | {name: share.mean() for name, share in shares.items()})
    return rows


def _searched(shape: str, mount: str, worlds: int) -> dict[str, Any]:
    env = _env(shape, mount)
    found = []
    for seed in range(FIRST_WORLD, FIRST_WORLD + worlds):
        env.reset(seed=seed)
        arms: Any = env.unwrapped.arms  # type: ignore[attr-defined]
        pose = _pose(arms, np.random.default_rng(seed))
        told = _told(arms, pose)
        lifted = search(arms, pose)
        agent = agents.make("grasp", env, seed=seed)
        grasped = lifted and first_trial(agent, env, seed, pose).success
        found.append((*told[1:], lifted, grasped))
    env.close()
    mapped, down, squarely, searched, grasped = np.array(found).T
    return {
        "shape": shape,
        "mount": mount,
        "things": worlds,
        "map": mapped.mean(),
        "straight down": down.mean(),
        "squarely": squarely.mean(),
        "search": searched.mean(),
        "agree": (mapped == searched).mean(),
        **beside("grasped", mean_share(grasped[searched][:, None]), ".0%"),
        "required": ASKED_OF,
    }


def _env(shape: str, mount: str) -> gym.Env[Any, Any]:
    return gym.make(GRASP, shape=shape, camera_mount=mount, orientation="any", disable_env_checker=True)


def _pose(arms: Any, rng: np.random.Generator) -> Array:
    """A pose (7,) of the first arm's thing, in view."""
    pose = drawn_pose(rng)
    while not arms.placing.in_view(0, arms.placed[0].thing, pose):
        pose = drawn_pose(rng)
    return pose


def _told(arms: Any, pose: Array) -> Told:
    thing = arms.placed[0].thing
    ways = list(arms.placing.ways(0, arms.world(0), thing, pose))
    upwards = (rotation_matrix(pose[3:]) @ thing.axis)[2] / np.linalg.norm(thing.axis)
    return Told(
        slant=float(np.degrees(np.arccos(min(abs(upwards), 1.0)))),
        map=bool(ways),
        down=any(np.isclose(way.pitch, DOWN) for way in ways),
        squarely=any(way.square >= SQUARELY for way in ways),
    )


def search(arms: Any, pose: Array) -> bool:
    """Whether some pitch and roll of the gripper lifts the thing of the first arm at a pose (7,).

    By inverse kinematics and contact: the gripper comes straight from one gripper length before, closes its
    jaws, and lifts.
    """
    for pitch in PITCHES:
        postures = arms.placing.postures(0, arms.world(0), pose[:3], pitch)
        if postures is None:
            continue
        higher = arms.placing.postures(0, arms.world(0), pose[:3] + UP, pitch) or postures[::-1]
        for roll in ROLLS[::2]:
            turn = roll if roll < np.pi / 2 else roll - np.pi
            at, before, up = (np.append(each[:4], turn) for each in (*postures, higher[0]))
            if _lifts(arms.simulation, pose, before, at, up):
                return True
    return False


def _lifts(simulation: HeldSimulation, pose: Array, before: Array, at: Array, up: Array) -> bool:
    one, is_open, closed = np.array([0]), np.array([STROKE]), np.zeros(1)
    simulation.place(one, before[None], pose[None])
    if simulation.move(one, at[None], is_open).shares[0] < 1:
        return False
    simulation.move(one, at[None], closed)
    simulation.wait(one)
    simulation.move(one, up[None], closed)
    simulation.wait(one)
    simulation.refresh()
    gripper, object_ = simulation.positions()
    return bool(np.linalg.norm(gripper[0] - object_[0]) < HANGS)
