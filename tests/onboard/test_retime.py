import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydrake.trajectories import PiecewisePolynomial
from scipy.integrate import cumulative_trapezoid
from scipy.spatial import cKDTree

from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.onboard.planner.retime import WINDOW, integral, retime


def line(length: float) -> PiecewisePolynomial:
    return PiecewisePolynomial.FirstOrderHold([0.0, 1.0], np.array([[0.0, length], [0.0, 0.0], [1.0, 1.0]]))


def circle(radius: float) -> PiecewisePolynomial:
    angle = np.linspace(0.0, 2 * np.pi, 200)
    points = radius * np.array([np.cos(angle), np.sin(angle), 0 * angle])
    ends = [np.array([0.0, radius, 0.0])] * 2
    return PiecewisePolynomial.CubicWithContinuousSecondDerivatives(angle, points, *ends)


def norms(flight: PiecewisePolynomial, order: int) -> np.ndarray:
    times = np.linspace(flight.start_time(), flight.end_time(), 20001)
    return np.linalg.norm(flight.MakeDerivative(order).vector_values(times), axis=0)


@pytest.mark.parametrize(("length", "speed", "acceleration"), [(20.0, 0.35, 0.2), (3.0, 1.0, 0.5), (5.0, 0.2, 2.0)])
def test_a_long_straight_line_takes_the_time_of_a_trapezoid_and_a_window(
    length: float, speed: float, acceleration: float
) -> None:
    flight = retime(line(length), speed, acceleration)
    # Planned within the limits, the motion may only be slower than the ideal, and by little.
    assert 0.999 < flight.end_time() / (length / speed + speed / acceleration + WINDOW) < 1.01
    assert norms(flight, 1).max() == pytest.approx(speed, rel=0.006)


def test_a_short_straight_line_takes_the_time_of_a_triangle_and_a_window() -> None:
    flight = retime(line(0.1), 1.0, 0.5)
    assert flight.end_time() == pytest.approx(2 * np.sqrt(0.1 / 0.5) + WINDOW, rel=1e-2)


def test_a_small_circle_is_flown_at_the_speed_of_its_centripetal_limit() -> None:
    flight = retime(circle(0.5), speed=2.0, acceleration=0.2)
    middle = np.linspace(0.4, 0.6, 101) * flight.end_time()
    speed = np.linalg.norm(flight.MakeDerivative(1).vector_values(middle), axis=0)
    np.testing.assert_allclose(speed, np.sqrt(0.2 * 0.5), rtol=0.01)


@settings(max_examples=15, deadline=None)
@given(
    st.lists(st.tuples(*[st.floats(-1.0, 1.0)] * 3), min_size=2, max_size=6),
    st.floats(0.1, 1.5),
    st.floats(0.1, 1.0),
)
def test_limits_rest_and_path_hold_on_any_curve(
    turns: list[tuple[float, float, float]], speed: float, acceleration: float
) -> None:
    # Steps that always go forward along x make no cusps.
    points = np.cumsum([[0.0, 0.0, 0.0]] + [[1.5, y, z] for _, y, z in turns], axis=0)
    u = np.arange(len(points), dtype=float)
    chords = np.diff(points, axis=0)
    path = PiecewisePolynomial.CubicWithContinuousSecondDerivatives(u, points.T, chords[0], chords[-1])
    flight = retime(path, speed, acceleration)
    v, a = norms(flight, 1), norms(flight, 2)
    assert v.max() <= 1.01 * speed
    assert a.max() <= 1.01 * acceleration
    assert max(v[0], v[-1]) < 1e-9
    assert max(a[0], a[-1]) < 0.05 * acceleration
    assert flight.start_time() == 0.0
    np.testing.assert_allclose(flight.value(0.0)[:, 0], points[0], atol=1e-9)
    np.testing.assert_allclose(flight.value(flight.end_time())[:, 0], points[-1], atol=1e-6)
    dense = cKDTree(path.vector_values(np.linspace(0.0, u[-1], 20001)).T)
    flown = flight.vector_values(np.linspace(0.0, flight.end_time(), 500)).T
    assert dense.query(flown)[0].max() < 5e-3


def test_acceleration_is_continuous() -> None:
    flight = retime(circle(2.0), 0.35, 0.2)
    ddr = flight.MakeDerivative(2)
    knots = np.array(flight.get_segment_times()[1:-1])
    before, after = ddr.vector_values(knots - 1e-7), ddr.vector_values(knots + 1e-7)
    np.testing.assert_allclose(before, after, atol=1e-6)


def test_a_path_that_turns_back_on_itself_is_refused() -> None:
    points = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 0.0], [1.0, 1.0, 1.0]])
    zero = np.zeros(3)
    path = PiecewisePolynomial.CubicWithContinuousSecondDerivatives([0.0, 1.0, 2.0], points, zero, zero)
    with pytest.raises(InputError, match="turns too sharply"):
        retime(path, 0.35, 0.2)


@given(st.lists(st.tuples(st.floats(-1e3, 1e3), st.floats(0.0, 1.0)), min_size=1, max_size=50))
def test_the_integral_is_scipys_bit_for_bit(points: list[tuple[float, float]]) -> None:
    y, steps = np.array(points).T
    x = np.cumsum(steps)
    np.testing.assert_array_equal(integral(y, x), cumulative_trapezoid(y, x, initial=0.0))
