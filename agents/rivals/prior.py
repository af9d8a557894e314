"""A prior of image points: polynomials of simulated worlds, their mean and how they differ."""

from __future__ import annotations

import json
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from calfree_gym.errors import check_choice

from ..base import storage
from ..base.checks import checked_array
from ..base.observation import Array
from ..base.storage import AgentFile, prefixed, under
from .monomials import exponents, monomials

MOUNTS = ("waist", "stand")
MOTORS = 3
"""Of the arm that is simulated."""
GRIPPER = exponents((5,), (MOTORS,), 5)
"""Of the gripper's polynomial in registers. Choice, as in `polynomial`."""
OBJECT = np.array([each for each in exponents((5, 2), (1, 4), 7) if each[0]])
"""Of the object's in the first motor's register, which alone can move the cameras, and in its home view."""
TERMS = len(GRIPPER) + len(OBJECT)
KEPT = Path(__file__).parent / "prior.npz"
"""The priors that come with the code."""
_KIND = "simulation_prior"


@dataclass(frozen=True)
class Prior:
    """Coefficients of both polynomials are `mean` and a normal mixture of the columns of `basis`.

    Attributes:
        mean: Of the coefficients (`TERMS`, 4), first the gripper's, of each image coordinate.
        basis: Their principal components (`TERMS`, 4, k) over simulated worlds.
        deviations: Standard deviations of these components (k,).
    """

    mean: Array
    basis: Array
    deviations: Array

    @property
    def checksum(self) -> int:
        """Of all its numbers: weights that were learned with another prior mean something else."""
        return zlib.crc32(b"".join(each.tobytes() for each in vars(self).values()))

    @classmethod
    def of(cls, arrays: Mapping[str, NDArray[Any]]) -> Self:
        """From arrays; raises ValueError where they do not fit."""
        deviations = checked_array(arrays, "deviations", (None,))
        basis = checked_array(arrays, "basis", (TERMS, 4, len(deviations)))
        return cls(checked_array(arrays, "mean", (TERMS, 4)), basis, deviations)


def features(registers: Array, homes: Array) -> tuple[Array, Array]:
    """Monomials of the gripper (n, `len(GRIPPER)`) and of the object (n, `len(OBJECT)`).

    Args:
        registers: Registers (n, 3).
        homes: The object's sensor vectors at home (n, 4), or (1, 4) for all.
    """
    first = np.hstack([registers[:, :1], np.broadcast_to(homes, (len(registers), 4))])
    return monomials(registers, GRIPPER), monomials(first, OBJECT)


def save_priors(file: AgentFile, priors: Mapping[str, Prior], training: Mapping[str, Any]) -> None:
    """Writes a prior for each mount, in single precision, and how they came about."""
    arrays = {"training": np.array(json.dumps(training))}
    for mount, prior in priors.items():
        arrays |= prefixed(mount, {name: each.astype(np.float32) for name, each in vars(prior).items()})
    storage.save(file, _KIND, arrays, 0, MOTORS)


def load_prior(file: AgentFile, mount: str, motors: int) -> tuple[Prior, dict[str, Any]]:
    """Reads the prior of a mount, and how it came about.

    Raises:
        FileNotFoundError: There is no such file.
        ValueError: The file is damaged or holds none, or the prior is of another number of motors.
    """
    check_choice("camera_mount", mount, MOUNTS)
    arrays, _ = storage.load(file, _KIND, motors)
    try:
        return Prior.of(under(mount, arrays)), json.loads(str(arrays["training"]))
    except (KeyError, ValueError) as error:
        raise ValueError(f"{file} is damaged: {error}") from error
