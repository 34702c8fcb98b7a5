"""A servo of one's own that declares its gain has the linear theory of the LQ servo."""

from pathlib import Path
from runpy import run_path
from types import SimpleNamespace
from typing import Any, Literal

import numpy as np
import pytest

import ortilo_drake as od
from ortilo_drake.onboard.estimator.extra_states import D
from ortilo_drake.onboard.servo.lq_gain import gain_of
from ortilo_drake.scenario import LqServo, Scenario
from ortilo_drake.studies.linearization.operating_point import frozen_gain
from ortilo_drake.studies.loop.hover_loop import closed_loop_matrix, hover_loop, why_no_loop
from ortilo_drake.studies.tube.tube import predict_tube
from ortilo_drake.theory.margins.loop_margins import spectral_radius

EXAMPLE = Path(__file__).parents[2] / "examples" / "cascade_servo.py"
pytestmark = pytest.mark.usefixtures("own_register")


class Lent(od.Frozen):
    """Settings of a servo that has the LQ servo's gain, or what else `lent` holds."""

    kind: Literal["lent"] = "lent"


lent: dict[str, np.ndarray] = {}


def never(belief: od.Belief) -> Any:
    raise NotImplementedError("its gain alone is asked for")


def scenario(servo: dict[str, Any]) -> Scenario:
    return od.load_scenario("nominal_imu_uwb_yolo", {"servo": servo, "camera.kind": "projected"})


@pytest.fixture
def own() -> Scenario:
    od.register_servo("lent", Lent, never, gain=lambda belief: lent["L"])
    lent["L"] = gain_of(scenario({"kind": "lq"}))
    return scenario({"kind": "lent"})


@pytest.mark.long
def test_with_the_lq_servos_gain_it_has_its_loop_and_its_tube(own: Scenario) -> None:
    lq = scenario({"kind": "lq", "form": "error"})
    assert not isinstance(own.servo, LqServo)
    loops = [closed_loop_matrix(hover_loop(s), *frozen_gain(s)) for s in (own, lq)]
    np.testing.assert_array_equal(*loops)
    tubes = [predict_tube(s) for s in (own, lq)]
    np.testing.assert_allclose(tubes[0].covariance, tubes[1].covariance, rtol=1e-12)


def test_the_examples_gain_is_the_slope_of_what_it_says() -> None:
    say = run_path(str(EXAMPLE))["say"]
    flown = scenario({"kind": "cascade"})
    vehicle = flown.vehicle
    numbers = SimpleNamespace(mass=vehicle.mass, inertia=np.array(vehicle.inertia), position=1.0, velocity=1.6)

    def said(estimate: np.ndarray) -> np.ndarray:
        out = np.zeros(4)
        say(numbers, estimate, np.zeros(9), out)
        return out

    steps = 1e-3 * np.eye(15)
    slope = np.array([(said(step) - said(-step)) / 2e-3 for step in steps]).T
    np.testing.assert_allclose(gain_of(flown), -slope, atol=1e-10)


def test_without_an_integral_the_loop_settles_all_the_same() -> None:
    run_path(str(EXAMPLE))
    flown = scenario({"kind": "cascade"})
    K, delta = frozen_gain(flown)
    A = closed_loop_matrix(hover_loop(flown), K, delta)
    # Position by acceleration by angles: the slowest mode along z is that of s^2 + 1.6 s + 1, sampled.
    slow = np.exp(np.roots([1.0, 1.6, 1.0]) * flown.h)
    eigenvalues = np.linalg.eigvals(A)
    assert spectral_radius(A) < 1.0
    assert all(abs(eigenvalues - root).min() < 2e-3 for root in slow)


def test_a_servo_that_reads_no_force_counters_none() -> None:
    run_path(str(EXAMPLE))
    loops = [hover_loop(od.load_scenario("imu_uwb", {"servo": {"kind": kind}})) for kind in ("cascade", "lq")]
    assert [bool(loop.L[:, [loop.names.index(d) for d in D]].any()) for loop in loops] == [False, True]


def test_what_is_no_gain_is_refused(own: Scenario) -> None:
    lent["L"] = np.zeros((4, 12))
    with pytest.raises(od.InputError, match=r"servo.kind: lent: its gain, \(4, 12\), must be \(4, 15\)"):
        hover_loop(own)
    od.register_servo("lent", Lent, never)
    assert "lent: must be lq, or registered with its gain" in (why_no_loop(own) or "")


def test_drake_differentiates_no_servo_of_ones_own(own: Scenario) -> None:
    with pytest.raises(od.InputError, match=r"servo\.kind: lent: must be lq: Drake differentiates no other"):
        od.linearize(own, "servo")
