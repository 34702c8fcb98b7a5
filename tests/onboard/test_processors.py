"""What decides on values has the same last bits whichever kernels BLAS takes for the processor at hand.

They differ by the order of their sums. A flight of a minute makes more than 1 nm of a last bit.
"""

import os
import platform
import subprocess
import sys

import pytest

DISTANCES = """
import numpy as np
from ortilo_drake.onboard.estimator.robust.weights import squared_distances
from ortilo_drake.onboard.landmarks.box_fix import joint_distance

rng = np.random.default_rng(3)
A, P = rng.normal(size=(12, 12)), 20.0 * np.eye(12)
P += A + A.T
for m in range(1, 7):
    print(*(d.hex() for d in squared_distances(rng.normal(size=m), P[:m, :m].copy(), np.eye(m), 1.7)))
    e, J = rng.normal(size=2 * m), rng.normal(size=(2 * m, 6))
    print(joint_distance(e, J, P[:6, :6].copy(), rng.uniform(1.0, 2.0, 2 * m)).hex())
"""


def distances(**variables: str) -> str:
    """Return squared distances, in hexadecimal, of a process with these environment variables."""
    command, environment = [sys.executable, "-c", DISTANCES], os.environ | variables
    return subprocess.run(command, env=environment, capture_output=True, text=True, check=True).stdout


@pytest.mark.long
@pytest.mark.skipif(
    platform.machine() not in ("x86_64", "AMD64"), reason="OpenBLAS has Nehalem's kernels on x86-64 alone"
)
def test_distances_are_the_same_on_every_processor() -> None:
    assert distances(OPENBLAS_CORETYPE="Nehalem") == distances()
