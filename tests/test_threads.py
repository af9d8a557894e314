"""The suite computes on one thread: small matrices cost more on two, and tests run side by side."""

import os
import subprocess
import sys

import pytest

from tests.conftest import ONE_THREAD


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="threads are counted in /proc")
def test_numpy_computes_on_one_thread_also_in_what_tests_start():
    code = "import os, numpy as np; a = np.ones((600, 600)); a @ a; print(len(os.listdir('/proc/self/task')))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "1"
    assert ONE_THREAD.items() <= os.environ.items()
