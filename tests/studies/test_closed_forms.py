"""The closed forms against Drake's matrices, and the closed loop's modes against those of its parts."""

import numpy as np
import pytest
from scipy.linalg import block_diag
from scipy.signal import cont2discrete
from test_linearize import H, V, hover_matrices

from ortilo_drake.model.vehicle import M100, Arm, Vehicle
from ortilo_drake.onboard.servo.lq_gain import servo_gain
from ortilo_drake.scenario import IntermittentFilter as FilterSettings
from ortilo_drake.scenario import LqServo as ServoSettings
from ortilo_drake.scenario import Scenario, World
from ortilo_drake.studies.linearization.closed_forms import agreement, closed_form
from ortilo_drake.studies.linearization.linearize import linearize
from ortilo_drake.studies.linearization.operating_point import frozen_gain
from ortilo_drake.studies.loop.hover_loop import closed_loop_matrix, hover_loop


def flown(kinematics: str = "small_angle", integrator: str = "hold", **servo: object) -> Scenario:
    return Scenario(
        world=World(kinematics=kinematics, plant="sampled"),
        servo=ServoSettings(**servo),
        estimator=FilterSettings(V=V, integrator=integrator),
    )


@pytest.mark.parametrize("integrator", ["literal", "hold", "estimate"])
def test_closed_loop_is_the_matrix_of_the_theory(integrator: str) -> None:
    scenario = flown(integrator=integrator)
    K, delta = frozen_gain(scenario)
    loop = linearize(scenario, "closed_loop")
    np.testing.assert_allclose(loop.A, closed_loop_matrix(hover_loop(scenario), K, delta), rtol=0.0, atol=1e-13)
    assert len(loop.states) == 27
    # By separation its modes are the servo's and the filter's.
    Phi, Gamma, *_ = cont2discrete((*hover_matrices(), np.eye(12), np.zeros((12, 4))), H)
    C = np.kron([[1.0, 0.0], [1.0, 0.0], [0.0, 1.0]], np.eye(3)) @ np.eye(6, 12)
    Phibar, Gammabar = block_diag(Phi, np.eye(3)), np.vstack([Gamma, np.zeros((3, 4))])
    Phibar[12:, :3] = -np.eye(3)
    L = servo_gain(M100, scenario.servo.weights, H)
    apart = np.concatenate([np.linalg.eigvals(Phibar - Gammabar @ L), np.linalg.eigvals(Phi - K @ C)])
    np.testing.assert_allclose(np.poly(loop.A), np.real(np.poly(apart)), rtol=1e-6, atol=1e-3)


def test_five_rotors_of_unlike_speeds_agree_with_their_closed_form() -> None:
    arms = tuple(Arm(angle=2.0 * np.pi * i / 5, length=0.3, spin=(-1) ** i) for i in range(5))
    scenario = flown().model_copy(update={"vehicle": Vehicle(arms=arms)})
    assert np.ptp(scenario.vehicle.hover_rotor_speeds) > 100.0
    for lag in ("up", "down"):
        by_drake, by_hand = (f(scenario, "rotors_and_plant", lag=lag) for f in (linearize, closed_form))
        assert by_drake.A.shape == (17, 17)
        assert by_drake.states[-1] == "W_5"
        for name, its, ours in zip("ABCD", by_drake, by_hand, strict=False):
            np.testing.assert_allclose(its, ours, rtol=1e-9, atol=1e-9, err_msg=name)


def test_every_part_agrees_with_its_closed_form() -> None:
    for settings in ({}, {"form": "paper", "integrator": "literal"}, {"velocities": "truth"}, {"yaw": 0.1}):
        for part, matrices in agreement(flown(**settings)).items():
            assert set(matrices) == set("ABCD")
            assert max(matrices.values()) < 1e-10, (settings, part)
