"""Quaternions and body velocities against SciPy's rotations, for any attitude."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from motions import attitude, body_rates
from scipy.spatial.transform import Rotation

from ortilo_drake.interop.ros.ros_motion import pose_and_twist, twist_covariance

values = arrays(np.float64, 12, elements=st.floats(-3.0, 3.0))


@pytest.mark.long
@given(values)
def test_motion(x):
    motion = pose_and_twist(x)
    np.testing.assert_array_equal(motion[0:3], x[0:3])
    assert (Rotation.from_quat(motion[3:7]) * attitude(x[3:6]).inv()).magnitude() < 1e-14
    assert abs(np.linalg.norm(motion[3:7]) - 1) < 1e-14
    np.testing.assert_allclose(motion[7:10], attitude(x[3:6]).inv().apply(x[6:9]), atol=1e-13)
    np.testing.assert_allclose(motion[10:13], body_rates(x[3:6], x[9:12]), atol=1e-8)


@pytest.mark.long
@given(values, arrays(np.float64, (12, 12), elements=st.floats(-1.0, 1.0)))
def test_twist_covariance_is_that_of_turned_samples(x, root):
    P = root @ root.T
    T = np.zeros((6, 6))
    T[0:3, 0:3] = attitude(x[3:6]).as_matrix().T
    T[3:6, 3:6] = np.column_stack([body_rates(x[3:6], axis) for axis in np.eye(3)])
    np.testing.assert_allclose(twist_covariance(x, P), T @ P[6:12, 6:12] @ T.T, atol=1e-7)
