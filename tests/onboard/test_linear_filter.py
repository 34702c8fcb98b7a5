"""The intermittent Kalman filter of any linear model, beside filterpy's and Drake's."""

from typing import Any

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter
from pydrake.autodiffutils import ExtractGradient, InitializeAutoDiff
from pydrake.systems.controllers import DiscreteTimeLinearQuadraticRegulator
from scipy.linalg import expm

import ortilo_drake as od

H = 0.05


def discretised(A: np.ndarray, B: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    n, m = B.shape
    whole = expm(H * np.block([[A, B], [np.zeros((m, n + m))]]))
    return whole[:n, :n], whole[:n, n:]


def cart_pole() -> tuple[np.ndarray, np.ndarray]:
    """Return Phi and Gamma of a cart of 1 kg with a pole of 0.1 kg at 0.5 m, upright: x, theta and their rates."""
    g, M, m, length = 9.81, 1.0, 0.1, 0.5
    A = np.array([[0, 0, 1, 0], [0, 0, 0, 1], [0, m * g / M, 0, 0], [0, (M + m) * g / (M * length), 0, 0]])
    return discretised(A, np.array([[0.0], [0.0], [1 / M], [1 / (M * length)]]))


MODELS: dict[str, tuple[Any, ...]] = {
    "double integrator": (
        *discretised(np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[0.0], [1.0]])),
        {"place": (np.array([[1.0, 0.0]]), np.array([[0.04]]))},
    ),
    "cart-pole": (
        *cart_pole(),
        {
            "camera": (np.array([[1.0, 0, 0, 0], [1.0, 0.5, 0, 0]]), np.array([[0.02, 0.005], [0.005, 0.03]])),
            "encoder": (np.array([[0, 1.0, 0, 0]]), np.array([[1e-4]])),
            "gyro": (np.array([[0, 0, 0, 2.0]]), np.array([[1e-3]])),
        },
    ),
}


class Played:
    """The filter, its inputs given by hand."""

    def __init__(self, model: str, P_0: np.ndarray, x_0: np.ndarray, W: np.ndarray):
        Phi, Gamma, self.sensors = MODELS[model]
        self.system: Any = od.IntermittentKalmanFilter(Phi, Gamma, W, self.sensors, H, P_0, x_0)
        self.context, self.n = self.system.CreateDefaultContext(), len(Phi)

    def belief(self) -> tuple[np.ndarray, np.ndarray]:
        said = [self.system.GetOutputPort(name).Eval(self.context).copy() for name in ("estimate", "covariance")]
        return said[0], said[1].reshape(self.n, self.n)

    def step(self, u: np.ndarray, messages: dict[str, np.ndarray]) -> None:
        for name, values in {"u": u, **messages}.items():
            self.system.GetInputPort(name).FixValue(self.context, values)
        self.context.SetDiscreteState(self.system.EvalUniquePeriodicDiscreteUpdate(self.context))


@pytest.mark.parametrize("model", MODELS)
def test_it_is_filterpys_predict_and_update_with_what_arrived(model: str) -> None:
    Phi, Gamma, sensors = MODELS[model]
    n, rng = len(Phi), np.random.default_rng(3)
    x_0, P_0, W = rng.normal(size=n), np.diag(rng.uniform(0.1, 1.0, n)), np.diag(rng.uniform(1e-4, 1e-3, n))
    ours = Played(model, P_0, x_0, W)
    theirs = KalmanFilter(dim_x=n, dim_z=1, dim_u=1)
    theirs.x, theirs.P, theirs.F, theirs.B, theirs.Q = x_0.copy(), P_0.copy(), Phi, Gamma, W
    arrivals = 0
    for _ in range(60):
        messages, u = {}, rng.normal(size=1)
        for name, (C, V) in sensors.items():
            there, y = rng.random() < 0.4, rng.normal(size=len(C))
            messages[name] = np.concatenate(([float(there)], y))
            if there:
                theirs.update(y, R=V, H=C)
                arrivals += 1
        theirs.predict(u=u)
        ours.step(u, messages)
        estimate, covariance = ours.belief()
        np.testing.assert_allclose(estimate, theirs.x, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(covariance, theirs.P, rtol=1e-9, atol=1e-12)
    assert 10 < arrivals < 60 * len(sensors)


def test_where_all_arrives_its_covariance_is_that_of_drakes_riccati_equation() -> None:
    Phi, _, sensors = MODELS["cart-pole"]
    W = np.diag([1e-4, 1e-4, 1e-3, 1e-3])
    played = Played("cart-pole", np.eye(4), np.zeros(4), W)
    for _ in range(400):
        played.step(np.zeros(1), {name: np.concatenate(([1.0], np.zeros(len(C)))) for name, (C, _) in sensors.items()})
    C = np.vstack([C for C, _ in sensors.values()])
    V = np.zeros((4, 4))
    V[:2, :2], V[2, 2], V[3, 3] = sensors["camera"][1], sensors["encoder"][1][0, 0], sensors["gyro"][1][0, 0]
    _, P = DiscreteTimeLinearQuadraticRegulator(Phi.T, C.T, W, V)  # the filter's equation is the regulator's dual
    np.testing.assert_allclose(played.belief()[1], P, rtol=1e-8, atol=1e-12)


def test_what_did_not_arrive_is_ignored() -> None:
    one, other = (Played("double integrator", np.eye(2), np.zeros(2), 1e-3 * np.eye(2)) for _ in range(2))
    one.step(np.ones(1), {"place": np.array([0.0, 5.0])})
    other.step(np.ones(1), {"place": np.array([0.0, -7.0])})
    np.testing.assert_array_equal(one.belief()[0], other.belief()[0])


def test_its_derivative_by_a_measurement_is_the_predictors_gain() -> None:
    Phi, Gamma, sensors = MODELS["double integrator"]
    C, V = sensors["place"]
    P = np.array([[0.5, 0.1], [0.1, 0.3]])
    system: Any = od.IntermittentKalmanFilter(Phi, Gamma, 1e-3 * np.eye(2), sensors, H, P).ToAutoDiffXd()
    context = system.CreateDefaultContext()
    system.GetInputPort("u").FixValue(context, InitializeAutoDiff(np.zeros(1), np.zeros((1, 1))).ravel())
    y = np.array([1.0, 0.4])
    system.GetInputPort("place").FixValue(context, InitializeAutoDiff(y, np.array([[0.0], [1.0]])).ravel())
    context.SetDiscreteState(system.EvalUniquePeriodicDiscreteUpdate(context))
    gradient = ExtractGradient(system.GetOutputPort("estimate").Eval(context))
    np.testing.assert_allclose(gradient, Phi @ P @ C.T @ np.linalg.inv(C @ P @ C.T + V), rtol=1e-12)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"Phi": np.eye(3)}, r"Phi: has the shape \(3, 3\), must have \(2, 2\)"),
        ({"W": [[1.0, 0.5], [0.0, 1.0]]}, "W: is not symmetric"),
        ({"W": -np.eye(2)}, "W: has the eigenvalue -1"),
        ({"sensors": {}}, "sensors: is empty"),
        ({"sensors": {"u": ([[1.0, 0.0]], [[1.0]])}}, "sensors: 'u' is the name of another port"),
        (
            {"sensors": {"gps": ([[1.0, 0.0]], [[0.0]])}},
            r"sensors\['gps'\]: V: has the eigenvalue 0, must be positive definite",
        ),
        ({"sensors": {"gps": ([[1.0]], [[1.0]])}}, r"sensors\['gps'\]: C: has the shape \(1, 1\), must have \(1, 2\)"),
        ({"h": 0.0}, "h: is 0.0, must be positive"),
        ({"P_0": [[np.nan, 0.0], [0.0, 1.0]]}, "P_0: must be a matrix of finite numbers"),
        ({"x_0": np.zeros(3)}, r"x_0: has the shape \(3,\)"),
    ],
)
def test_what_does_not_fit_is_refused_in_a_line(change: dict[str, Any], said: str) -> None:
    Phi, Gamma, sensors = MODELS["double integrator"]
    good = {"Phi": Phi, "Gamma": Gamma, "W": np.eye(2), "sensors": sensors, "h": H, "P_0": np.eye(2)}
    with pytest.raises(ValueError, match=f"^{said}"):
        od.IntermittentKalmanFilter(**(good | change))
