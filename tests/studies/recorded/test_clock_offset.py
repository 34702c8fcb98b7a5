"""The truth's clock by the body rates, where the truth is rounded to more than it turns between two stamps."""

import numpy as np
import pytest
from made_up_motion import attitude, place
from scipy.spatial.transform import Rotation

from ortilo_drake.interop.recorded.recording import Imu, Truth
from ortilo_drake.studies.recorded.clock_offset import SPANS, TELLS, best_by_rates, intervals_apart

LATE, MOUNT = 0.137, Rotation.from_euler("z", 4.0, degrees=True)


def heard(duration=20.0) -> Imu:
    t, h = np.arange(0.0, duration, 1e-3), 1e-4
    rates = (attitude(t - h).inv() * attitude(t + h)).as_rotvec() / (2.0 * h)
    return Imu(t, rates + [0.01, -0.02, 0.005], np.zeros((len(t), 3)), None)


def seen(step: float, rounded: float, duration=20.0) -> Truth:
    """Return a truth LATE by its clock, of a body turned by MOUNT, its quaternion rounded."""
    t = np.arange(0.5, duration - 0.5, step)
    q = (attitude(t) * MOUNT.inv()).as_quat()
    q = np.round(q / rounded) * rounded if rounded else q
    return Truth(t + LATE, place(t), Rotation.from_quat(q).as_matrix())


@pytest.mark.family
@pytest.mark.parametrize(("step", "rounded", "within"), [(1 / 300, 0.0014, 1.0), (1 / 300, 0.0, 0.2), (0.05, 0.0, 0.2)])
def test_offset_and_mount_are_found(step, rounded, within) -> None:
    found = best_by_rates(heard(), seen(step, rounded), lambda _: (-np.inf, np.inf), 0.5, None)
    assert found.left < TELLS
    assert found.offset == pytest.approx(LATE, abs=0.004)
    assert Rotation.from_matrix(found.mount @ MOUNT.as_matrix().T).magnitude() < np.radians(within)


def test_other_turns_are_refused() -> None:
    truth = seen(1 / 300, 0.0014)
    turned = truth._replace(R=truth.R.transpose(0, 2, 1))
    assert best_by_rates(heard(), turned, lambda _: (-np.inf, np.inf), 0.5, None).left > TELLS


def test_intervals_are_as_short_as_the_noise_lets_them_be() -> None:
    fine, slow = seen(1 / 300, 0.0), seen(0.25, 0.0)
    R = Rotation.from_matrix(fine.R)
    shaken = R * Rotation.from_rotvec(0.005 * np.random.default_rng(1).standard_normal((len(fine.t), 3)))
    assert intervals_apart(fine.t, R) == round(SPANS[0] * 300)
    assert intervals_apart(fine.t, shaken) > round(SPANS[0] * 300)
    assert intervals_apart(slow.t, Rotation.from_matrix(slow.R)) == 1
