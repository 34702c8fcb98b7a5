"""Gates, weights, noise scale, re-acquisition and drift against chi-square's quantiles and closed forms."""

from typing import Any

import numpy as np
import pytest
from scipy.spatial.distance import mahalanobis
from scipy.stats import chi2, norm

from ortilo_drake.model.measurement import ATTITUDE_CAMERA, CAMERA, IMU, UWB, Measurement
from ortilo_drake.model.signals import STATE_NAMES
from ortilo_drake.onboard.estimator.extra_states import IMU_ROWS
from ortilo_drake.onboard.estimator.robust.weights import (
    NEVER,
    OPEN_ALL,
    OPEN_RATES,
    SHUT,
    initial_gate_state,
    judge_sensors,
    weighed,
    weighing_of,
)
from ortilo_drake.scenario.estimator import Robust

H = 1.0 / 30.0
N = 15
ROWS = (("uwb", UWB), ("camera", (*CAMERA, *ATTITUDE_CAMERA)), ("imu", IMU))
MEASUREMENT = Measurement(ROWS)
SLICES = {name: MEASUREMENT.rows_of(name) for name in MEASUREMENT.sensors}
RNG = np.random.default_rng(5)
_A = RNG.normal(size=(N, N))
P = 1e-3 * (_A @ _A.T)
X = RNG.normal(size=N)
BELIEF = np.concatenate((X, P.ravel()))
BLOCKS = [1e-3 * (A @ A.T + np.eye(m)) for m in (3, 6, 3) for A in [RNG.normal(size=(m, m))]]
V2 = np.concatenate([V.ravel() for V in BLOCKS])


def settings(**changes: Any) -> Robust:
    plain = {"gate": 0.99, "weight": {"kind": "huber", "c": 100.0}, "adaptation": None, "drift": None}
    return Robust.model_validate(plain | changes)


class Gate:
    """The judge with its state, tick by tick."""

    def __init__(self, robust: Robust, measurement: Measurement = MEASUREMENT, sensors: int = 3):
        self.weighing = weighing_of(robust, measurement, sensors)
        self.state, self.seen, self.mean = initial_gate_state(sensors)
        self.opens = SHUT

    def __call__(self, y: np.ndarray, delta: list[float], t: float = H, belief: np.ndarray = BELIEF) -> np.ndarray:
        beliefs = np.tile(belief, (len(delta), 1))
        factors, self.state, self.seen, self.mean, self.opens = judge_sensors(
            y, np.array(delta), V2, beliefs, self.state, self.seen, self.mean, t, self.weighing
        )
        return factors


def innovation_covariance(j: int) -> np.ndarray:
    C = MEASUREMENT.C_of(MEASUREMENT.sensors[j])
    return C @ P[:12, :12] @ C.T + BLOCKS[j]


def value_at(j: int, distance: float, direction: int = 0) -> np.ndarray:
    """Return y whose value of sensor j is that Mahalanobis distance from the prediction, the others on it."""
    y = MEASUREMENT.layout.C @ X[:12]
    e = np.linalg.cholesky(innovation_covariance(j))[:, direction] * distance
    y[SLICES[MEASUREMENT.sensors[j]]] += e
    return np.asarray(y)


@pytest.mark.parametrize("j", [0, 1, 2])
@pytest.mark.parametrize("probability", [0.9, 0.999])
def test_a_value_is_refused_beyond_the_quantile_of_chi_square(j: int, probability: float) -> None:
    m = BLOCKS[j].shape[0]
    limit = np.sqrt(chi2.ppf(probability, m))
    for share, used in ((0.999, 1.0), (1.001, 0.0)):
        y = value_at(j, share * limit, direction=m - 1)
        C = MEASUREMENT.C_of(MEASUREMENT.sensors[j])
        d = mahalanobis(y[SLICES[MEASUREMENT.sensors[j]]], C @ X[:12], np.linalg.inv(innovation_covariance(j)))
        assert (d < limit) == bool(used)
        factors = Gate(settings(gate=probability))(y, [1.0, 1.0, 1.0])
        assert factors[j] == used
        assert np.all(np.delete(factors, j) == 1.0)


def test_right_values_are_refused_as_seldom_as_the_gate_says() -> None:
    gate, refused, count = Gate(settings(gate=0.9)), 0, 4000
    L = np.linalg.cholesky(innovation_covariance(1))
    for _ in range(count):
        y = MEASUREMENT.layout.C @ X[:12]
        y[SLICES["camera"]] += L @ RNG.normal(size=6)
        refused += gate(y, [0.0, 1.0, 0.0])[1] == 0.0
    assert abs(refused / count - 0.1) < norm.ppf(0.9999) * np.sqrt(0.1 * 0.9 / count)


@pytest.mark.parametrize(("d", "factor"), [(1.0, 1.0), (2.9, 1.0), (3.3, 3.3 / 3.0), (4.0, 4.0 / 3.0)])
def test_hubers_weight(d: float, factor: float) -> None:
    found = Gate(settings(gate=0.999999, weight={"kind": "huber", "c": 3.0}))(value_at(0, d), [1.0, 0.0, 0.0])
    assert found[0] == pytest.approx(factor, rel=1e-9)


@pytest.mark.parametrize("d", [0.5, 1.7, 2.0, 4.5])
def test_students_weight(d: float) -> None:
    found = Gate(settings(gate=0.999999, weight={"kind": "student_t", "dof": 4.0}))(value_at(0, d), [1.0, 0.0, 0.0])
    assert found[0] == pytest.approx(max(1.0, (4.0 + d**2) / (4.0 + 3.0)), rel=1e-9)


def test_students_weight_is_the_posterior_mean_of_the_noises_scale() -> None:
    """Of a Gaussian whose precision is chi-square(nu) / nu, E[precision | d] = (nu + m) / (nu + d^2), by quadrature."""
    nu, m, d = 4.0, 3, 3.5
    grid = np.linspace(1e-6, 20.0, 400_001)
    density = chi2.pdf(nu * grid, nu) * grid ** (m / 2) * np.exp(-0.5 * grid * d**2)
    mean = float(np.sum(grid * density) / np.sum(density))
    found = Gate(settings(gate=0.999999, weight={"kind": "student_t", "dof": nu}))(value_at(0, d), [1.0, 0.0, 0.0])
    assert found[0] == pytest.approx(1.0 / mean, rel=1e-5)


def test_what_is_refused_is_as_if_it_had_not_come_and_weights_scale_covariances() -> None:
    y, delta = np.arange(1.0, 13.0), np.array([1.0, 1.0, 0.0])
    first, block = MEASUREMENT.layout.first, MEASUREMENT.layout.block
    out = weighed(y, delta, V2, np.array([0.0, 2.5, 0.0]), first, block)
    np.testing.assert_array_equal(out[:12], np.concatenate((np.zeros(3), y[3:9], np.zeros(3))))
    np.testing.assert_array_equal(out[12:15], [0.0, 1.0, 0.0])
    np.testing.assert_array_equal(out[15:], np.concatenate((V2[:9], 2.5 * V2[9:45], V2[45:])))
    np.testing.assert_array_equal(
        weighed(y, np.ones(3), V2, np.ones(3), first, block), np.concatenate((y, np.ones(3), V2))
    )


def test_the_noise_follows_its_innovations_and_comes_back() -> None:
    """The average goes to d^2 / m as 1 - exp(-t / time); the factor is that over what is tolerated, within bounds."""
    gate = Gate(settings(gate=0.999999, adaptation={"time": 2.0, "tolerates": 1.5, "most": 2.0}))
    d, t = 3.0, 0.0
    plain = innovation_covariance(0)
    for _ in range(30):
        t += 0.1
        gate(value_at(0, d), [1.0, 0.0, 0.0], t)
    average = 1.0 + (d**2 / 3 - 1.0) * (1.0 - np.exp(-t / 2.0))
    assert gate.state[0, 1] == pytest.approx(average, rel=1e-9)
    assert average / 1.5 > 1.0
    assert gate(value_at(0, 0.0), [1.0, 0.0, 0.0], t + 0.1)[0] == pytest.approx(min(average / 1.5, 2.0), rel=1e-9)
    assert np.linalg.det(plain) > 0.0
    for _ in range(200):
        t += 0.1
        factors = gate(value_at(0, d * 1.4), [1.0, 0.0, 0.0], t)
    assert factors[0] == 2.0
    for _ in range(100):
        t += 0.1
        factors = gate(value_at(0, 1.0), [1.0, 0.0, 0.0], t)
    assert factors[0] == 1.0


def far(*sensors: str) -> np.ndarray:
    y = MEASUREMENT.layout.C @ X[:12]
    for sensor in sensors:
        y[SLICES[sensor]] += 100.0
    return np.asarray(y)


def opened_at(gate: Gate, y: np.ndarray, delta: list[float], ticks: int = 75) -> list[float]:
    """Return the times after the first refusal at which P is opened."""
    times = []
    for k in range(ticks):
        gate(y, delta, (k + 1) * H)
        if gate.opens == OPEN_ALL:
            times.append(k * H)
    return times


def test_a_sensor_that_is_refused_alone_is_believed_after_a_while() -> None:
    times = opened_at(Gate(settings(reacquire_after=1.0)), far("uwb"), [1.0, 0.0, 1.0])
    np.testing.assert_allclose(times, [1.0, 2.0], atol=1.5 * H)  # the imu sees no position


@pytest.mark.parametrize(
    ("refused", "opens"),
    [
        (("uwb",), False),  # the camera stands for the position
        (("imu",), False),  # and for the attitude
        (("camera",), False),  # uwb and imu stand for both
        (("uwb", "camera"), True),  # the imu does not stand for the position
        (("camera", "imu"), True),  # nothing stands for the attitude
    ],
)
def test_it_is_not_believed_while_others_stand_for_the_estimate(refused: tuple[str, ...], opens: bool) -> None:
    assert bool(opened_at(Gate(settings()), far(*refused), [1.0, 1.0, 1.0])) == opens


def test_a_slower_sensor_stands_for_the_estimate_between_its_messages() -> None:
    """The camera is refused at 30 Hz; uwb comes at 10 Hz and is used."""
    gate = Gate(settings())
    for k in range(90):
        gate(far("camera"), [float(k % 3 == 0), 1.0, 1.0], (k + 1) * H)
        assert gate.opens == SHUT


def test_a_value_that_is_used_ends_the_waiting() -> None:
    gate = Gate(settings())
    for k in range(90):
        y = far("uwb") if k % 25 else far()
        gate(y, [1.0, 0.0, 1.0], (k + 1) * H)
        assert gate.opens == SHUT
    assert gate.state[0, 0] > NEVER


def test_nothing_finite_is_needed_to_refuse() -> None:
    bad = BELIEF.copy()
    bad[0] = np.nan
    assert Gate(settings())(far(), [1.0, 0.0, 1.0], belief=bad)[0] == 0.0


WATCHED = Measurement((*ROWS, ("gyroscope", IMU_ROWS["gyroscope"][1])), STATE_NAMES + ("c_x", "c_y", "c_z"))


def test_innovations_that_are_not_zero_on_average_open_angles_and_gyroscope() -> None:
    """The average of n values by weights alpha (1 - alpha)^i has a mean and a variance in closed form."""
    n = N + 3
    belief = np.concatenate((np.zeros(n), (1e-6 * np.eye(n)).ravel()))
    gate = Gate(settings(gate=0.9999, drift=1.0), WATCHED)
    S = 1e-6 * np.eye(3) + BLOCKS[2]
    step = 0.7 * np.linalg.cholesky(S)[:, 2]
    alpha = 1.0 - np.exp(-H)
    expected = None
    for k in range(1, 60):
        mean = 0.7 * (1.0 - (1.0 - alpha) ** k)
        if mean**2 * (2.0 - alpha) / alpha > chi2.ppf(0.9999, 3):
            expected = k
            break
    y = np.zeros(12)
    y[9:12] = step
    for k in range(1, 60):
        gate(y, [0.0, 0.0, 1.0], k * H, belief)
        if gate.opens == OPEN_RATES:
            break
    assert k == expected
    np.testing.assert_array_equal(gate.mean, np.zeros(3))


def test_white_innovations_open_nothing() -> None:
    belief = np.concatenate((np.zeros(N + 3), np.zeros((N + 3) ** 2)))
    gate, L = Gate(settings(gate=0.999999, drift=1.0), WATCHED), np.linalg.cholesky(BLOCKS[2])
    for k in range(1, 3000):
        y = np.zeros(12)
        y[9:12] = L @ RNG.normal(size=3)
        gate(y, [0.0, 0.0, 1.0], k * H, belief)
        assert gate.opens == SHUT


def test_a_prediction_that_is_none_refuses_what_arrives() -> None:
    """P is negative definite: the squared distance, below 0, would lie within any gate."""
    belief = np.concatenate((X, -P.ravel() - np.eye(N).ravel()))
    assert not Gate(settings())(value_at(0, 1.0), [1.0, 1.0, 1.0], belief=belief).any()
