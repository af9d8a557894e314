"""Small tables for one or two sensor coordinates each, whose sum are registers (section 4.3)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents.agent import Array
from agents.knowledge.checks import check_whole, fitting
from agents.knowledge.knowledge import Change, Recall
from calfree_gym.world import IMAGE_UNIT

PAIRS = ((0, 1), (2, 3), (0, 2), (1, 3))
"""Coordinates that share a 2-D table: each image's own, and those that are alike in both images."""
