"""The LQ servo's gain (paper, section IV-A)."""

import numpy as np
from pydrake.systems.controllers import DiscreteTimeLinearQuadraticRegulator

from ortilo_drake.model.hover import discretize, hover_A, hover_B
from ortilo_drake.model.parts import find_part
from ortilo_drake.model.signals import N_I, N_U, N_X, N_XBAR
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.model.vehicle import Vehicle
from ortilo_drake.scenario import Belief, LqServo, ServoWeights
from ortilo_drake.theory.modes.modes import unseen_modes


def augmented_pair(vehicle: Vehicle, h: float, yaw: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Return Phibar = [[Phi, 0], [-E C, I]] and Gammabar = [Gamma; 0] with E = [I 0 0], so E C = [I 0 0 0]."""
    Phi, Gamma = discretize(hover_A(yaw), hover_B(vehicle), h)
    Phibar = np.eye(N_XBAR)
    Phibar[:N_X, :N_X] = Phi
    Phibar[N_X:, :N_I] = -np.eye(N_I)
    Gammabar = np.zeros((N_XBAR, N_U))
    Gammabar[:N_X] = Gamma
    return Phibar, Gammabar


def weight_matrices(weights: ServoWeights) -> tuple[np.ndarray, np.ndarray]:
    """Return the diagonal matrices Qbar (15 x 15) and R (4 x 4) of the weights."""
    groups = (weights.position, weights.angle, weights.velocity, weights.rate, weights.integral)
    return np.diag(np.concatenate(groups)), np.diag(weights.control)


def is_detectable(Phi: np.ndarray, C: np.ndarray) -> bool:
    """Return whether every mode of Phi on or outside the unit circle is observable in C, in any coordinates.

    InputError if Phi or C has a number that is not finite.
    """
    if not (np.isfinite(Phi).all() and np.isfinite(C).all()):
        raise InputError("servo: mass, inertia and control_rate differ too much in size for the computation")
    return not unseen_modes(Phi, C)


def lq_gain(Phi: np.ndarray, Gamma: np.ndarray, Q: np.ndarray, R: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the gain L and the stabilising solution S of the DARE for the infinite-horizon problem.

    L = (Gamma^T S Gamma + R)^-1 Gamma^T S Phi;  S = Q + Phi^T S Phi - Phi^T S Gamma L.

    InputError if (Phi, Gamma) is not stabilisable or (Phi, Q^1/2) is not detectable. Without this check Drake's solver
    would end the process, and SciPy's solver would return a solution that does not stabilise.
    """
    try:
        if not is_detectable(Phi.T, Gamma.T):
            raise InputError("servo: (Phi, Gamma) is not stabilisable, no LQ gain exists")
        if not is_detectable(Phi, Q):
            raise InputError(
                "servo.weights: (Phi, Q^1/2) is not detectable: give positive weights to the integrals and to yaw"
            )
        L, S = DiscreteTimeLinearQuadraticRegulator(Phi, Gamma, Q, R)
    except np.linalg.LinAlgError:
        raise InputError("servo: mass, inertia and control_rate differ too much in size for the computation") from None
    except (RuntimeError, SystemExit) as error:  # the weights differ too much for Drake's own check
        raise InputError(f"servo.weights: Drake finds no stabilising gain with them: {error}") from None
    return L, S


def servo_gain(vehicle: Vehicle, weights: ServoWeights, h: float, yaw: float = 0.0) -> np.ndarray:
    """Return L (4 x 15) of the augmented pair about hover at this yaw [rad]; raises as lq_gain."""
    L, _ = lq_gain(*augmented_pair(vehicle, h, yaw), *weight_matrices(weights))
    return L


def why_no_servo_gain(scenario: Belief) -> str | None:
    """Return the reason why the scenario's servo has no gain; None if it has one."""
    kind = scenario.servo.kind
    part = None if isinstance(scenario.servo, LqServo) else find_part("servo", kind)
    if isinstance(scenario.servo, LqServo) or (part is not None and part.gain is not None):
        return None
    return f"servo.kind: {kind}: must be lq, or registered with its gain, which the linear theory needs"


def gain_of(scenario: Belief) -> np.ndarray:
    """Return L (4 x 15) of the scenario's servo about hover at the heading that the servo holds.

    InputError as in lq_gain, and if an own servo has no gain or a gain that is not 4 x 15 finite numbers.
    """
    if isinstance(scenario.servo, LqServo):
        return servo_gain(scenario.vehicle, scenario.servo.weights, scenario.h, scenario.yaw)
    if why := why_no_servo_gain(scenario):
        raise InputError(why)
    L = np.asarray(find_part("servo", scenario.servo.kind).gain(scenario), dtype=float)
    if L.shape != (N_U, N_XBAR) or not np.isfinite(L).all():
        raise InputError(f"servo.kind: {scenario.servo.kind}: its gain, {L.shape}, must be (4, 15) of finite numbers")
    return L
