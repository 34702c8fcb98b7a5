"""A part of one's own that gives a compiled share flies in the engine as in the Drake diagram; another is told so."""

from typing import Literal, NamedTuple

import numpy as np
import pytest
from numba import njit
from pydrake.systems.framework import BasicVector, Context, DiscreteValues, LeafSystem

import ortilo_drake as od
from ortilo_drake.diagrams.wiring.whole import why_not
from ortilo_drake.flight.engine import Engine
from ortilo_drake.flight.flight import fly
from ortilo_drake.flight.sameness import apart
from ortilo_drake.model import parts
from ortilo_drake.model.equations import euler_rates, rotation
from ortilo_drake.scenario import load_scenario, with_seed

SHORT = "planner={kind: waypoints, points: [[0, 0, 1.5], [1.2, 0.6, 1.5]]}"


@pytest.fixture(autouse=True)
def own_register(monkeypatch: pytest.MonkeyPatch) -> None:
    """Give each test a register of its own."""
    parts.known_sensors()  # loads what is installed
    monkeypatch.setattr(parts, "_PARTS", dict(parts._PARTS))
    monkeypatch.setattr(parts, "_FILES", list(parts._FILES))


class Follower(od.Frozen):
    """Settings of an estimator that follows the ranges."""

    kind: Literal["follower"]
    gain: float = 0.3


class Numbers(NamedTuple):
    """What its functions know."""

    gain: float
    h: float
    anchors: np.ndarray
    x_0: np.ndarray


def numbers(belief: od.Belief, xbar_0: np.ndarray) -> Numbers:
    return Numbers(belief.estimator.gain, belief.h, belief.load_room().anchor_positions, xbar_0[:12])


@njit
def known(its: Numbers, state: np.ndarray) -> np.ndarray:
    return np.concatenate((state, 0.01 * np.eye(12).ravel()))


@njit
def step(
    its: Numbers,
    state: np.ndarray,
    uwb: np.ndarray,
    detections: np.ndarray,
    imu: np.ndarray,
    u: np.ndarray,
    r: np.ndarray,
) -> np.ndarray:
    """Return the next state: p towards what each range says, v by the accelerometer, attitude as the imu says."""
    x, n = state.copy(), its.anchors.shape[0]
    if uwb[0] != 0.0:
        for i in range(n):
            if uwb[2 + n + i] > 0.0:
                line = x[:3] - its.anchors[i]
                d = np.sqrt(line[0] ** 2 + line[1] ** 2 + line[2] ** 2)
                correction = its.gain / n * (uwb[2 + i] - d) / d * line
                x[:3] += correction
                x[6:9] += 0.3 * correction
    R_WB = rotation(imu[2:5])
    for i in range(3):
        a = R_WB[i, 0] * imu[8] + R_WB[i, 1] * imu[9] + R_WB[i, 2] * imu[10] - (9.81 if i == 2 else 0.0)
        x[i] += its.h * x[6 + i]
        x[6 + i] += its.h * a
    x[3:6] = imu[2:5]
    w = euler_rates(imu[2:5], imu[5:8])
    for i in range(3):
        x[9 + i] = w[i]
    return x


class FollowerSystem(LeafSystem):
    """The same estimator for Drake."""

    def __init__(self, belief: od.Belief, xbar_0: np.ndarray):
        super().__init__()
        self._its = numbers(belief, xbar_0)
        sizes = {"uwb": 2 + 2 * len(self._its.anchors), "imu": 11, "control": 4, "reference": 9}
        self._ports = [self.DeclareVectorInputPort(name, size) for name, size in sizes.items()]
        self.DeclareStateOutputPort("estimate", self.DeclareDiscreteState(self._its.x_0))
        self.DeclareVectorOutputPort("covariance", 144, self._calc_covariance, {self.nothing_ticket()})
        self.DeclarePeriodicDiscreteUpdateEvent(belief.h, 0.0, self._update)

    def _calc_covariance(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(known(self._its, np.zeros(12))[12:])

    def _update(self, context: Context, values: DiscreteValues) -> None:
        uwb, imu, u, r = (port.Eval(context) for port in self._ports)
        state = context.get_discrete_state_vector().CopyToVector()
        values.set_value(step(self._its, state, uwb, np.zeros(2), imu, u, r))


COMPILED = od.CompiledEstimator(numbers, lambda its: its.x_0.copy(), known, step)


def scenario_of() -> od.Scenario:
    return load_scenario(
        "imu_uwb", (SHORT, "estimator={kind: follower, gain: 2.0}", "uwb.link={rate: 10, random_delay: 1}")
    )


@pytest.mark.long
def test_an_own_estimator_that_gives_a_compiled_step_flies_drakes_flight() -> None:
    od.register_estimator("follower", Follower, FollowerSystem, COMPILED)
    scenario = scenario_of()
    assert why_not(scenario) is None
    engine = Engine(scenario)
    for seed in (1, 2):
        flight = engine.fly(seed)
        found = apart(fly(with_seed(scenario, seed)), flight)
        assert found.same, found
        e = flight["estimate"].values[:, :3] - flight["truth"].values[:, :3]
        assert 0.0 < np.sqrt(np.mean(e**2)) < 0.5


def test_one_that_gives_none_is_told_in_a_line() -> None:
    od.register_estimator("follower", Follower, FollowerSystem)
    reason = why_not(scenario_of())
    assert reason == "estimator.kind: follower: has no compiled form"
    with pytest.raises(od.InputError, match="Drake flies it"):
        Engine(scenario_of())
