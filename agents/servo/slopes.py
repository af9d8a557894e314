"""The Jacobian as it usually is, and how smooth points are: what trials teach the next one."""

from typing import NamedTuple, Self

import numpy as np

from calfree_gym.image import RANK_OF_SQUARES

from ..base.observation import POINTS, Array, Flags

DIFFERENT = 0.3
"""Beforehand a trial's Jacobian differs from the usual one by this share of its root mean square: tuned on
wild worlds 3000 and up."""
ALIKE_LOOKS = 8.0
"""Beforehand points are as smooth along one motor as along another, as if so many looks had told that; a
trial of fewer tells nothing of it. Choice: as many as those by which `KeptLooks` first chooses lengths."""


class Slopes(NamedTuple):
    """The Jacobian as it usually is where a trial begins, as far as it is known, and lengths of smoothness.

    It differs from trial to trial: with the place, and where the cameras move also with the object.

    Attributes:
        registers: Of the place (m,).
        jacobian: Gripper and object points by words (8, m), in image units.
        variances: Covariances of a row of it, for each point (4, m, m), where they are known.
        changes: Variances of what a trial's row differs by, for each point and motor (4, m).
        trials: So many trials have told that.
        lengths: Over how many registers gripper and object points are smooth along each motor (2, m), beside
            the others: factors whose product is one.
        looks: So many looks (2,) have told that.
    """

    registers: Array
    jacobian: Array
    variances: Array
    changes: Array
    trials: int
    lengths: Array
    looks: Array

    @classmethod
    def of(cls, jacobian: Array, registers: Array | None = None, variances: Array | None = None) -> Self:
        """Those of a Jacobian (8, m); at home unless registers (m,) are given, sure unless variances are."""
        motors = jacobian.shape[1]
        squares = np.square(jacobian).reshape(2, -1).mean(1)
        return cls(
            np.zeros(motors) if registers is None else registers,
            jacobian,
            np.zeros((POINTS, motors, motors)) if variances is None else variances,
            np.tile((DIFFERENT**2 * squares).repeat(2)[:, None], motors),
            0,
            np.ones((2, motors)),
            np.full(2, ALIKE_LOOKS),
        )

    def corrected(self, seen: Self, hold: Flags) -> Self:
        """By those of a trial that was begun with these: by the more, the less sure they were.

        What trials differ by is learned from all of them, by expectation-maximization; what was assumed
        counts as one.

        Args:
            seen: What the trial showed, with these known beforehand.
            hold: Of which points (4,) these still held; of the others, those of the trial stand.
        """
        usual, found = (each.jacobian.reshape(POINTS, 2, -1) for each in (self, seen))
        unit = np.eye(usual.shape[2])
        known = np.einsum("pmm->pm", self.variances)
        unsure = self.variances + np.maximum(self.changes / (self.trials + 1) - known, 0.0)[:, None] * unit
        assumed = unsure + self.changes[:, None] * unit
        gains = unsure @ np.linalg.pinv(assumed, hermitian=True, rcond=RANK_OF_SQUARES)
        different = found - usual
        jacobian = usual + different @ gains.swapaxes(1, 2)
        variances = unsure - gains @ (assumed - seen.variances) @ gains.swapaxes(1, 2)
        changes = np.square(different).mean(1) + np.einsum("pmm->pm", seen.variances - unsure)
        changes = np.maximum(self.changes + (changes - self.changes) / (self.trials + 2), 0.0)
        return type(self)(
            seen.registers,
            np.where(hold[:, None, None], jacobian, found).reshape(2 * POINTS, -1),
            np.where(hold[:, None, None], variances, seen.variances),
            np.where(hold[:, None], changes, self.changes),
            self.trials + 1,
            self.lengths,
            self.looks,
        )

    def with_lengths(self, lengths: Array, looks: Array) -> Self:
        """With what one more trial tells of lengths (2, m) by so many looks (2,): a geometric mean."""
        logarithms = [each * np.log(of) for each, of in ((self.looks, self.lengths.T), (looks, lengths.T))]
        total = self.looks + looks
        return self._replace(lengths=np.exp(sum(logarithms) / total).T, looks=total)
