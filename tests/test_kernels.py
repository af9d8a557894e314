"""The kernel of linear algebra under which `make test` runs agents' tests a second time."""

import os
import platform
import re
import subprocess
import sys
from pathlib import Path

import numpy
import pytest

ROOT = Path(__file__).parents[1]
LIBRARIES = [str(path) for path in Path(numpy.__file__).parents[1].glob("numpy.libs/libscipy_openblas64_*")]


@pytest.mark.skipif(platform.machine() != "x86_64" or not LIBRARIES, reason="numpy has other kernels")
def test_numpy_has_it():
    (kernel,) = re.findall(r"OPENBLAS_CORETYPE=(\w+)", (ROOT / "Makefile").read_text())
    code = (
        f"import ctypes; name = ctypes.CDLL({LIBRARIES[0]!r}).scipy_openblas_get_corename64_;"
        "name.restype = ctypes.c_char_p; print(name().decode())"
    )
    environment = os.environ | {"OPENBLAS_CORETYPE": kernel}
    assert subprocess.check_output([sys.executable, "-c", code], env=environment, text=True).strip() == kernel
