"""What the network keeps of places: registers at which it met objects, as a function of their first view.

A Bayesian linear regression, taught by Kalman steps, whose features are trained with the network (ALPaCA;
Harrison et al. 2018). It has no prior knowledge of signs or order of motors: the prior mean is zero.
"""

from typing import NamedTuple

import torch
from torch import Tensor, nn

FIRST_VIEW = 8
"""Numbers in it: the image points of gripper and object, seen from home."""
SMALLEST = 0.25
"""Of a feature, about, before training. Choice: a register is expected within some 0.5 of home."""
LEAST_VARIANCE = 3e-6
"""Of a register that is told (a guard): its root is about a pixel."""


class PlaceRegression(NamedTuple):
    """The regression of n robots with m motors, by f features.

    Attributes:
        weights: Means (n, m, f).
        covariance: Of each motor's weights (n, f, f), alike for all.
        features: Of the view with which this trial began (n, f).
    """

    weights: Tensor
    covariance: Tensor
    features: Tensor

    @property
    def registers(self) -> Tensor:
        """Where the object of this trial is expected (n, m)."""
        return (self.weights @ self.features[:, :, None]).squeeze(-1)

    @property
    def variance(self) -> Tensor:
        """Of each of these registers (n,)."""
        spread = (self.covariance @ self.features[:, :, None]).squeeze(-1)
        return (spread * self.features).sum(1).clamp(min=0)

    def told(self, registers: Tensor, variance: Tensor) -> "PlaceRegression":
        """The regression after a Kalman step: the object is met at registers (n, m), with variance (n,)."""
        spread = self.covariance @ self.features[:, :, None]
        gain = spread / (self.variance + variance)[:, None, None]
        return self._replace(
            weights=self.weights + (registers - self.registers)[:, :, None] * gain.transpose(1, 2),
            covariance=self.covariance - gain * spread.transpose(1, 2),
        )

    def forgotten(self, share: Tensor) -> "PlaceRegression":
        """The regression drawn back to its prior by a share (n,)."""
        left = (1 - share)[:, None, None]
        prior = torch.diag_embed((1 - left[:, :, 0]).expand_as(self.features))
        covariance = left * self.covariance + prior
        return self._replace(weights=left * self.weights, covariance=covariance)

    def surprise(self, registers: Tensor) -> Tensor:
        """Negative log-likelihood (n,) of meeting the object at registers (n, m)."""
        variance = self.variance[:, None] + 3 * LEAST_VARIANCE
        error = registers - self.registers
        return 0.5 * (error.square() / variance + variance.log()).sum(1)


class Features(nn.Module):
    """Features (n, f) of first views (n, 8); one is constant.

    Args:
        features: f.
        hidden: Width of the layers between.
    """

    def __init__(self, features: int, hidden: int) -> None:
        super().__init__()
        last = nn.Linear(hidden, features - 1)
        first, between = nn.Linear(FIRST_VIEW, hidden), nn.Linear(hidden, hidden)
        self.layers = nn.Sequential(first, nn.SiLU(), between, nn.SiLU(), last)

    def forward(self, views: Tensor) -> Tensor:
        """See the class."""
        one = views.new_ones(len(views), 1)
        return SMALLEST * torch.cat([one, self.layers(views)], 1)
