"""The whole closed loop on AutoDiffXd: one tick of all its states against differences, and the separation principle."""

from typing import Any

import numpy as np
import pytest
from pydrake.autodiffutils import ExtractGradient, ExtractValue, InitializeAutoDiff

from ortilo_drake.diagrams.closed_loop import ClosedLoop, make_closed_loop
from ortilo_drake.flight.flight import make_simulator
from ortilo_drake.model.signals import N_X, N_XBAR
from ortilo_drake.scenario import load_scenario
from ortilo_drake.studies.linearization.closed_forms import differentiate_closed_loop, without_noise
from ortilo_drake.studies.loop.hover_loop import hover_loop

SETTINGS = [
    (),
    ("estimator.force=measured",),
    ("multilateration.method=nearest_three", "servo.velocities=truth"),
]


def at_tick(settings: tuple[str, ...], tick: int) -> tuple[ClosedLoop, Any]:
    """Return the loop of a scenario without noise, and its context at a tick: hovering on the paper's own vehicle."""
    calm = without_noise(load_scenario("nominal_imu_uwb", settings))
    calm = calm.model_copy(update={"world": calm.world.model_copy(update={"kinematics": "small_angle"})})
    diagram = make_closed_loop(calm)
    simulator = make_simulator(diagram, calm)
    simulator.Initialize()
    simulator.AdvanceTo((tick - 0.5) * calm.h)
    context = simulator.get_mutable_context()
    context.SetTime(tick * calm.h)
    return diagram, context


def states_of(values: Any) -> list[np.ndarray]:
    return [values.get_vector(k).CopyToVector() for k in range(values.num_groups())]


def next_states(diagram: Any, context: Any, z: np.ndarray) -> np.ndarray:
    sizes = [len(state) for state in states_of(context.get_discrete_state())]
    for k, part in enumerate(np.split(z, np.cumsum(sizes)[:-1])):
        context.SetDiscreteState(k, part)
    return np.concatenate(states_of(diagram.EvalUniquePeriodicDiscreteUpdate(context)))


def directions_at(states: list[np.ndarray], count: int) -> np.ndarray:
    """Return random directions (n, count) in which to move all states; a covariance moves as one that is symmetric."""
    rng, moved = np.random.default_rng(3), []
    for state in states:
        d = 0.1 * rng.normal(size=(count, len(state)))
        order = next((n for n in range(N_XBAR, 40) if n + n * n == len(state)), None)
        if order is not None:
            S = rng.normal(size=(count, order, order))
            sd = np.sqrt(np.diag(state[order:].reshape(order, order)))
            d[:, order:] = (0.1 * np.outer(sd, sd) * (S + np.swapaxes(S, 1, 2))).reshape(count, -1)
        moved.append(d)
    return np.concatenate(moved, axis=1).T


@pytest.mark.family
@pytest.mark.parametrize("tick", [60, 61])  # with and without a fix
@pytest.mark.parametrize("settings", SETTINGS, ids=["plain", "force", "three ranges, true velocities"])
def test_a_tick_of_all_states_has_the_slopes_of_differences(settings: tuple[str, ...], tick: int) -> None:
    diagram, context = at_tick(settings, tick)
    states = states_of(context.get_discrete_state())
    z, D, small = np.concatenate(states), directions_at(states, 12), 1e-4
    diagram_ad = diagram.ToAutoDiffXd()
    context_ad = diagram_ad.CreateDefaultContext()
    context_ad.SetTimeStateAndParametersFrom(context)
    found = next_states(diagram_ad, context_ad, InitializeAutoDiff(z[:, None], D)[:, 0])[:, None]
    np.testing.assert_allclose(ExtractValue(found)[:, 0], next_states(diagram, context, z), rtol=1e-9, atol=1e-12)
    ends = [np.column_stack([next_states(diagram, context, z + s * small * d) for d in D.T]) for s in (1.0, -1.0)]
    numbers = (ends[0] - ends[1]) / (2.0 * small)
    scale = np.maximum(np.max(np.abs(numbers), axis=1, keepdims=True), 1e-3)
    np.testing.assert_allclose(ExtractGradient(found) / scale, numbers / scale, atol=1e-5)
    assert np.linalg.matrix_rank(numbers) == D.shape[1]


@pytest.mark.long
@pytest.mark.parametrize("tick", [60, 61])
def test_the_robust_loop_has_the_slopes_of_the_plain_one(tick: int) -> None:
    """What is used of the sensors, and with what weight, is a constant: all that is at hover without noise, in full."""
    rows = []
    for settings in ((), ("estimator.robust={}", "multilateration.exclude={}")):
        diagram, context = at_tick(settings, tick)
        diagram_ad = diagram.ToAutoDiffXd()
        context_ad = diagram_ad.CreateDefaultContext()
        context_ad.SetTimeStateAndParametersFrom(context)
        systems = [_of(diagram_ad, *path) for path in (("world", "plant"), ("onboard", "filter"))]
        contexts = [system.GetMyMutableContextFromRoot(context_ad) for system in systems]
        before = [its.get_discrete_state(0).CopyToVector() for its in contexts]
        z = ExtractValue(np.concatenate(before)[:, None])[:, 0]
        moved = InitializeAutoDiff(z[:, None])[:, 0]
        for its, part in zip(contexts, np.split(moved, [before[0].size]), strict=True):
            its.SetDiscreteState(0, part)
        after = [
            system.EvalUniquePeriodicDiscreteUpdate(its).get_vector(0).CopyToVector()
            for system, its in zip(systems, contexts, strict=True)
        ]
        rows.append(np.concatenate(after)[:, None])
    plain, robust = rows
    np.testing.assert_array_equal(ExtractValue(robust), ExtractValue(plain))
    np.testing.assert_allclose(ExtractGradient(robust), ExtractGradient(plain), rtol=1e-12, atol=1e-14)


def _of(diagram: Any, *names: str) -> Any:
    for name in names:
        diagram = diagram.GetSubsystemByName(name)
    return diagram


@pytest.mark.long
def test_the_loop_that_flies_obeys_the_separation_principle() -> None:
    tick = differentiate_closed_loop(load_scenario("nominal_imu_uwb"), 900)
    loop = hover_loop(without_noise(load_scenario("nominal_imu_uwb")))
    KC = tick.K @ np.diag(np.repeat(tick.delta, 3)) @ load_scenario("nominal_imu_uwb").measurement.layout.C
    # In [x; i; x - xhat] the matrix is block triangular: servo with true states, and the predictor's error.
    to_error = np.eye(N_X + N_XBAR)
    to_error[N_X : 2 * N_X, :N_X], to_error[N_X : 2 * N_X, N_X : 2 * N_X] = np.eye(N_X), -np.eye(N_X)
    A = to_error @ tick.A @ np.linalg.inv(to_error)
    error = slice(N_X, 2 * N_X)
    np.testing.assert_allclose(A[error, error], loop.Phi - KC, atol=1e-12)
    others = np.delete(np.arange(len(A)), np.arange(N_X, 2 * N_X))
    np.testing.assert_allclose(A[error][:, others], 0.0, atol=1e-12)


def test_a_loop_with_a_camera_says_what_cannot_be_differentiated() -> None:
    diagram = make_closed_loop(load_scenario("nominal_imu_uwb_yolo", ("camera.kind=projected",))).ToAutoDiffXd()
    with pytest.raises(RuntimeError, match=r"^camera: its out takes no AutoDiffXd: "):
        diagram.EvalUniquePeriodicDiscreteUpdate(diagram.CreateDefaultContext())
