"""Braking on a flight's own path, and the way on from there."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydrake.trajectories import PiecewisePolynomial
from scipy.integrate import quad
from scipy.spatial import cKDTree

from ortilo_drake.model.room import ORTILO_ROOM, load_room
from ortilo_drake.model.vehicle import M100
from ortilo_drake.onboard.planner.free_cells import free_space
from ortilo_drake.onboard.planner.goal_path import LEAST, brake, join_paths, knots, through
from ortilo_drake.onboard.planner.planner import plan, refuse_contact
from ortilo_drake.scenario import GcsPlanner

SPEED, ACCELERATION = 0.35, 0.2
ROOM = load_room(ORTILO_ROOM)
FLIGHT = plan(GcsPlanner(), ROOM, M100)
END = FLIGHT.end_time()
CURVE = cKDTree(FLIGHT.vector_values(np.linspace(0.0, END, 100_001)).T)

ANY_TIME = st.floats(0.0, END + 5.0)


def reference(trajectory: PiecewisePolynomial, t: float) -> np.ndarray:
    """Return r, r_dot, r_ddot (3, 3) as the planner's system gives them: at rest after the end."""
    if t > trajectory.end_time():
        return np.column_stack([trajectory.value(t), np.zeros((3, 2))])
    return np.column_stack([trajectory.EvalDerivative(t, order) for order in range(3)])


def samples(trajectory: PiecewisePolynomial, order: int) -> np.ndarray:
    times = np.linspace(trajectory.start_time(), trajectory.end_time(), 2001)
    return (trajectory.MakeDerivative(order) if order else trajectory).vector_values(times)


@settings(max_examples=60, deadline=None)
@given(ANY_TIME)
def test_braking_goes_on_from_the_flight_and_ends_at_rest(t: float) -> None:
    stop = brake(FLIGHT, t, ACCELERATION)
    assert stop.start_time() == t
    before, after = reference(FLIGHT, t), reference(stop, t)
    np.testing.assert_allclose(after[:, :2], before[:, :2], rtol=0, atol=1e-8)
    np.testing.assert_allclose(after[:, 2], before[:, 2], rtol=0, atol=0.01 * ACCELERATION)
    last = reference(stop, stop.end_time())
    np.testing.assert_allclose(last[:, 1], 0.0, atol=1e-12)
    np.testing.assert_allclose(last[:, 2], 0.0, atol=0.01 * ACCELERATION)


@pytest.mark.long
@settings(max_examples=60, deadline=None)
@given(ANY_TIME)
def test_braking_keeps_its_limits_and_its_curve(t: float) -> None:
    stop = brake(FLIGHT, t, ACCELERATION)
    assert np.linalg.norm(samples(stop, 1), axis=0).max() <= 1.005 * SPEED
    assert np.linalg.norm(samples(stop, 2), axis=0).max() <= 1.3 * ACCELERATION
    assert CURVE.query(samples(stop, 0).T)[0].max() < 1.3e-4  # half the way between two points of the curve
    refuse_contact("r", samples(stop, 0).T, free_space(ROOM, 1.5, M100.radius, 0.0, 0.6), M100)


def test_at_constant_speed_braking_takes_no_more_than_the_flights_own_acceleration() -> None:
    radius = SPEED**2 / ACCELERATION  # a circle on which the flight is at both of its limits
    t = np.linspace(0.0, 40.0, 2001)
    angle = SPEED / radius * t
    r = radius * np.array([np.cos(angle), np.sin(angle), 0 * t])
    r_dot = SPEED * np.array([-np.sin(angle), np.cos(angle), 0 * t])
    stop = brake(PiecewisePolynomial.CubicHermite(t, r, r_dot), 3.0, ACCELERATION)
    assert np.linalg.norm(samples(stop, 2), axis=0).max() <= 1.002 * ACCELERATION
    np.testing.assert_allclose(np.linalg.norm(samples(stop, 0), axis=0), radius, rtol=1e-6)


def test_the_way_of_braking_on_a_straight_line_is_the_integral_of_its_speed() -> None:
    line = PiecewisePolynomial.FirstOrderHold([0.0, 100.0], np.array([[0.0, 35.0], [1.0, 1.0], [1.5, 1.5]]))
    stop = brake(line, 10.0, ACCELERATION)
    T = 2.0 * SPEED / ACCELERATION
    assert stop.end_time() == pytest.approx(10.0 + T)
    way = quad(lambda t: SPEED * (1.0 - 3.0 * (t / T) ** 2 + 2.0 * (t / T) ** 3), 0.0, T)[0]
    np.testing.assert_allclose(stop.value(stop.end_time())[:, 0], [3.5 + way, 1.0, 1.5], atol=1e-9)
    assert np.linalg.norm(samples(stop, 2), axis=0).max() == pytest.approx(1.5 * SPEED / T, rel=1e-3)


def test_who_is_at_rest_has_nothing_to_brake() -> None:
    stop = brake(FLIGHT, END + 3.0, ACCELERATION)
    assert stop.end_time() - stop.start_time() == pytest.approx(LEAST)
    np.testing.assert_array_equal(samples(stop, 0), np.repeat(FLIGHT.value(END), 2001, axis=1))


@pytest.mark.long
@settings(max_examples=30, deadline=None)
@given(ANY_TIME, st.floats(0.0, 8.0))
def test_the_way_on_begins_at_rest_where_braking_ended(t: float, wait: float) -> None:
    stop = brake(FLIGHT, t, ACCELERATION)
    rest = stop.value(stop.end_time())
    # Any curve will do that starts there; a solver puts the start a little off.
    way = through(knots(FLIGHT) + np.vstack([[[7.0]], rest - FLIGHT.value(0.0) + 1e-8, np.zeros((3, 1))]))
    flight = join_paths(stop, way, t + wait)
    begin = max(stop.end_time(), t + wait)
    assert flight.start_time() == t
    assert flight.end_time() == pytest.approx(begin + END)
    for time in np.linspace(t, stop.end_time(), 50):
        np.testing.assert_allclose(flight.value(time), stop.value(time), rtol=0, atol=1e-12)
    for time in np.linspace(stop.end_time(), begin, 20):
        np.testing.assert_allclose(reference(flight, time)[:, :2], np.column_stack([rest, np.zeros(3)]), atol=1e-12)
    for time in np.linspace(1.0, END, 50):
        np.testing.assert_allclose(flight.value(begin + time), way.value(7.0 + time), rtol=0, atol=1e-9)
    breaks = np.array(flight.get_segment_times()[1:-1])
    for order in (0, 1):
        derivative = flight.MakeDerivative(order) if order else flight
        apart = derivative.vector_values(breaks - 1e-9) - derivative.vector_values(breaks + 1e-9)
        assert np.abs(apart).max() < 1e-8


def test_knots_determine_a_flight() -> None:
    again = through(knots(FLIGHT))
    times = np.linspace(0.0, END, 5001)
    np.testing.assert_allclose(again.vector_values(times), FLIGHT.vector_values(times), rtol=0, atol=1e-12)
    np.testing.assert_allclose(knots(through(knots(again))), knots(again), rtol=0, atol=1e-15)
