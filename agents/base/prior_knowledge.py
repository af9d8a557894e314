"""What an agent can be built on beyond its observations: the closed vocabulary of every table."""

from collections.abc import Collection
from enum import StrEnum


class PriorKnowledge(StrEnum):
    """One thing that an agent takes for granted and does not learn from its observations.

    Where the thing is otherwise than the agent takes it, the agent fails or needs more motions.
    """

    IMAGE_SCALE = "image scale"
    """How long a unit of its image points is: lengths in pixels among its constants."""
    NOISE = "noise"
    """How large the errors of image points are."""
    CAMERA_MODEL = "camera model"
    """How a camera projects: pinhole, affine, lens; or that it stands upright."""
    ARM = "arm"
    """The arm's joints, links, or the form of its motors' curves."""
    CHAIN = "chain of joints"
    """That the arm is one, with a joint for each motor; none of its numbers."""
    FLOOR = "flat floor"
    """That a robot on wheels stays on a flat floor; and drives arcs, where it plans them."""
    MOUNT = "mount"
    """What the cameras are fixed to."""
    MOTOR_ORDER = "which motor is which"
    """Which motor turns which joint."""
    REWARD = "reward"
    """A reward, given after each motion."""
    WORD_LIMIT = "word limit"
    """How large a word may be, chosen for motors of this strength."""
    TRAINING_WORLDS = "training worlds"
    """Worlds of the same distribution, in which it was trained before."""
    UNDECLARED = "not declared"
    """What an agent in a module of the user's is built on that does not set its `prior_knowledge`."""


def in_order(known: Collection[PriorKnowledge]) -> tuple[PriorKnowledge, ...]:
    """The words that are among `known`, in the order of the vocabulary."""
    return tuple(word for word in PriorKnowledge if word in known)
