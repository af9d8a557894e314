"""One thread for all arithmetic; environments for every test; every test repeatable."""

import itertools
import os
import sys
import zlib

for library in ("OMP", "OPENBLAS", "MKL", "BLIS", "VECLIB", "NUMEXPR"):
    os.environ[f"{library}_NUM_THREADS"] = "1"  # before numpy is imported, and for all that tests start

import gymnasium as gym  # noqa: E402
import pytest  # noqa: E402
from gymnasium.utils import seeding  # noqa: E402
from hypothesis import settings  # noqa: E402

import calfree_gym  # noqa: E402, F401

settings.register_profile("of any speed", deadline=None)  # a test asserts nothing of how fast it is
settings.load_profile("of any speed")


@pytest.fixture(autouse=True)
def repeatable(monkeypatch, request):
    """Environments that nobody has seeded draw from the test's name, not from the machine's entropy."""

    def np_random(seed=None):
        return drawn(next(seeds) if seed is None else seed)

    drawn, seeds = seeding.np_random, itertools.count(zlib.crc32(request.node.nodeid.encode()))
    monkeypatch.setattr(seeding, "np_random", np_random)


@pytest.fixture(autouse=True)
def one_torch_thread():
    """Networks of a few units lose more by a second thread than they gain."""
    if torch := sys.modules.get("torch"):
        torch.set_num_threads(1)


@pytest.fixture(scope="session")
def opengl():
    """Skips tests that render where nothing can."""
    from calfree_gym.rendering.renderer import gl_context  # it needs a newer MuJoCo than Perturb

    try:
        gl_context(16).free()
    except gym.error.DependencyNotInstalled as error:
        pytest.skip(str(error))
