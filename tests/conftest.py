"""Registers the environments for every test, and makes every test repeatable."""

import itertools
import zlib

import pytest
from gymnasium.utils import seeding

import calfree_gym  # noqa: F401


@pytest.fixture(autouse=True)
def repeatable(monkeypatch, request):
    """Environments that nobody has seeded draw from the test's name, not from the machine's entropy."""

    def np_random(seed=None):
        return drawn(next(seeds) if seed is None else seed)

    drawn, seeds = seeding.np_random, itertools.count(zlib.crc32(request.node.nodeid.encode()))
    monkeypatch.setattr(seeding, "np_random", np_random)
