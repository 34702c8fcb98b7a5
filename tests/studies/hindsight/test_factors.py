"""The graph's factors: derivatives by finite differences, the imu by a motion, processes by covariance functions."""

from collections.abc import Callable

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from ortilo_drake.model.room import ORTILO_ROOM, load_room
from ortilo_drake.scenario.tight import InertialNoise

gtsam = pytest.importorskip("gtsam", reason="needs the extra 'smoother'")

from ortilo_drake.studies.hindsight import factors, solver  # noqa: E402
from ortilo_drake.studies.hindsight import inertial_factors as inertial  # noqa: E402

RNG = np.random.default_rng(3)
POSE, VELOCITY, BIAS, ERROR, OTHER, CLOCK = (gtsam.symbol("k", i) for i in range(6))
ROOM = load_room(ORTILO_ROOM)


def values_at(clock: float) -> "gtsam.Values":
    """Return a pose near the first landmarks, tilted, and the other variables that factors see."""
    values = gtsam.Values()
    values.insert(POSE, gtsam.Pose3(gtsam.Rot3(Rotation.from_euler("ZYX", [0.3, -0.2, 0.15]).as_matrix()), [1, 0.5, 1]))
    values.insert(VELOCITY, np.array([0.4, -0.3, 0.2]))
    values.insert(BIAS, gtsam.imuBias.ConstantBias([0.1, 0.2, -0.1], [0.01, -0.02, 0.03]))
    values.insert(ERROR, np.array([0.07]))
    values.insert(OTHER, np.array([0.3, -0.4]))
    values.insert(CLOCK, np.array([clock]))
    return values


def derivatives(factor: "gtsam.CustomFactor", values: "gtsam.Values") -> tuple[np.ndarray, np.ndarray]:
    """Return a factor's derivatives of its residual by all its variables, as it says and by finite differences."""
    linear = factor.linearize(values)
    said, _ = linear.jacobian()
    columns, step = [], 1e-6
    for key in list(factor.keys()):
        for i in range(values.dims()[key]):
            ends = []
            for sign in (1.0, -1.0):
                move = values.zeroVectors()
                one = np.zeros(values.dims()[key])
                one[i] = sign * step
                other = gtsam.VectorValues()
                for its in list(values.keys()):
                    other.insert(its, one if its == key else move.at(its))
                ends.append(factor.unwhitenedError(values.retract(other)))
            columns.append((ends[0] - ends[1]) / (2.0 * step))
    return said, np.array(columns).T


UNIT = {m: gtsam.noiseModel.Unit.Create(m) for m in (1, 2, 3)}
W = np.array([0.3, -0.2, 0.4])


LEVER, ANCHORS = np.array([0.1, -0.05, 0.2]), np.array([[3.0, -1.0, 2.0], [-4.0, 2.0, 0.5]])
RANGE, RIGHT = factors.Reach(1.0, ANCHORS[0], (ERROR,)), factors.Reach(1.0, ANCHORS[0], ())


@pytest.mark.parametrize(
    ("reach", "velocity", "clock"), [(RIGHT, None, None), (RANGE, None, None), (RANGE, VELOCITY, CLOCK)]
)
def test_a_range_is_the_antenna_s_distance_and_its_errors(
    reach: factors.Reach, velocity: int | None, clock: int | None
) -> None:
    factor, values = factors.ranges_factor(POSE, velocity, clock, (reach,), 2.5, 0.0, LEVER, UNIT[1]), values_at(0.02)
    pose = values.atPose3(POSE)
    place = pose.translation() - (0.02 * values.atVector(VELOCITY) if clock else 0.0)
    distance = np.linalg.norm(place + pose.rotation().matrix() @ LEVER - ANCHORS[0])
    expected = distance + 0.07 * len(reach.errors) - 2.5
    np.testing.assert_allclose(factor.unwhitenedError(values), [expected], rtol=0.0, atol=1e-12)
    said, found = derivatives(factor, values)
    np.testing.assert_allclose(said, found, rtol=0.0, atol=1e-8)


@pytest.mark.parametrize("clock", [None, CLOCK])
def test_a_difference_is_that_of_two_distances_at_the_packet_s_age(clock: int | None) -> None:
    values, ranges = values_at(0.02), (factors.Reach(-1.0, ANCHORS[0], (ERROR,)), factors.Reach(1.0, ANCHORS[1], ()))
    factor = factors.ranges_factor(POSE, VELOCITY, clock, ranges, 2.5, 0.03, LEVER, UNIT[1])
    pose, older = values.atPose3(POSE), 0.03 if clock is None else 0.05
    antenna = pose.translation() - older * values.atVector(VELOCITY) + pose.rotation().matrix() @ LEVER
    r_a, r_b = np.linalg.norm(antenna - ANCHORS, axis=1)
    np.testing.assert_allclose(factor.unwhitenedError(values), [r_b - r_a - 0.07 - 2.5], rtol=0.0, atol=1e-12)
    said, found = derivatives(factor, values)
    np.testing.assert_allclose(said, found, rtol=0.0, atol=1e-8)


@pytest.mark.long
@pytest.mark.parametrize("clock", [False, True])
def test_derivatives_of_a_box(clock: bool) -> None:
    """With a clock at 0, where what is left out of them is 0 as well."""
    camera = ROOM.camera.scaled_to(320).constants
    landmark = np.array([4.0, 1.2, 1.1]), ROOM.landmark_outlines[0]
    values = values_at(0.0)
    offset = gtsam.symbol("k", 9)
    values.insert(offset, np.array([0.02, -0.03, 0.01]))
    moving = factors.Moving(VELOCITY, CLOCK, W) if clock else None
    late = (OTHER, np.array([0.8, 1.1]))
    factor = factors.box_factor(POSE, offset, late, moving, np.array([150.0, 90.0]), *landmark, camera, UNIT[2])
    said, found = derivatives(factor, values)
    assert np.abs(found).max() > 10.0
    np.testing.assert_allclose(said, found, rtol=1e-6, atol=1e-5)


def test_a_box_behind_the_camera_says_nothing() -> None:
    camera = ROOM.camera.scaled_to(320).constants
    landmark = np.array([-4.0, 0.5, 1.0]), ROOM.landmark_outlines[0]
    factor = factors.box_factor(POSE, None, None, None, np.array([1.0, 2.0]), *landmark, camera, UNIT[2])
    said, _ = factor.linearize(values_at(0.0)).jacobian()
    assert not said.any()
    assert not factor.unwhitenedError(values_at(0.0)).any()


def test_derivatives_of_angles() -> None:
    values = values_at(0.0)
    values.insert(gtsam.symbol("k", 9), np.array([0.01, 0.02, 0.03]))
    for errors in (None, gtsam.symbol("k", 9)):
        factor = factors.angles_factor(POSE, errors, np.array([0.1, -0.1, 0.2]), UNIT[3])
        said, found = derivatives(factor, values)
        np.testing.assert_allclose(said, found, rtol=0.0, atol=1e-8)


def test_angles_are_compared_around_the_circle() -> None:
    values = gtsam.Values()
    values.insert(POSE, gtsam.Pose3(gtsam.Rot3.Rz(3.1), np.zeros(3)))
    factor = factors.angles_factor(POSE, None, np.array([0.0, 0.0, -3.1]), UNIT[3])
    np.testing.assert_allclose(factor.unwhitenedError(values), [0.0, 0.0, 6.2 - 2.0 * np.pi], rtol=0.0, atol=1e-12)


def test_derivatives_of_rows_of_the_twelve_states() -> None:
    C, root = RNG.normal(size=(2, 12)), np.tril(RNG.normal(size=(2, 2))) + 2.0 * np.eye(2)
    factor = factors.rows_factor(POSE, VELOCITY, BIAS, W, RNG.normal(size=2), C, root @ root.T, np.inf)
    said, found = derivatives(factor, values_at(0.0))
    np.testing.assert_allclose(said, found, rtol=0.0, atol=1e-8)


def test_the_preintegrated_imu_is_the_motion() -> None:
    """Of a body whose rates and specific force are polynomials of time; each sample is that of mid-step."""
    h, n = 1.0 / 30.0, 8

    def w(t: float) -> np.ndarray:
        return np.array([0.5 + t, -0.4 * t, 0.3 - 2.0 * t])

    def f(t: float) -> np.ndarray:
        return np.array([0.5 * t, 0.8, 9.81 + 2.0 * t])

    def derivative(t: float, x: np.ndarray) -> np.ndarray:
        R, a = x[6:].reshape(3, 3), np.array([0.0, 0.0, -9.81])
        wx, wy, wz = w(t)
        skew = np.array([[0.0, -wz, wy], [wz, 0.0, -wx], [-wy, wx, 0.0]])
        return np.concatenate((x[3:6], R @ f(t) + a, (R @ skew).ravel()))

    R_0 = Rotation.from_euler("ZYX", [0.4, 0.1, -0.1]).as_matrix()
    x_0 = np.concatenate(([1.0, 2.0, 3.0], [0.5, -0.2, 0.1], R_0.ravel()))
    end = solve_ivp(derivative, (0.0, h), x_0, rtol=1e-12, atol=1e-12).y[:, -1]
    dt = h / n
    samples = [inertial.Sample((i + 1) * dt, np.zeros(3), w((i + 0.5) * dt), f((i + 0.5) * dt)) for i in range(n)]
    _, tick = inertial.inertial_ticks(samples, 2, h, n, (1e-3, 0.05), InertialNoise())
    start = gtsam.NavState(gtsam.Rot3(R_0), x_0[:3], x_0[3:6])
    found = tick.motion.predict(start, gtsam.imuBias.ConstantBias())
    np.testing.assert_allclose(found.attitude().matrix(), end[6:].reshape(3, 3), rtol=0.0, atol=1e-6)
    np.testing.assert_allclose(found.velocity(), end[3:6], rtol=0.0, atol=1e-5)
    np.testing.assert_allclose(found.position(), end[:3], rtol=0.0, atol=1e-6)


def test_the_noise_of_a_tick_is_that_of_its_samples() -> None:
    """Of a body at rest: sums of n independent samples' effects."""
    h, n = 0.04, 8
    f = np.array([0.0, 0.0, 9.81])
    samples = [inertial.Sample((i + 1) * h / n, np.zeros(3), np.zeros(3), f) for i in range(n)]
    _, tick = inertial.inertial_ticks(samples, 2, h, n, (1e-3, 0.05), InertialNoise())
    covariance, dt = tick.motion.preintMeasCov(), h / n  # of rotation, position, velocity
    assert covariance[2, 2] == pytest.approx(n * (1e-3 * dt) ** 2)
    assert covariance[8, 8] == pytest.approx(n * (0.05 * dt) ** 2)
    left = np.array([h - (i + 0.5) * dt for i in range(n)])  # a sample's mean time to the end
    expected = np.sum((0.05 * dt * left) ** 2) + inertial.INTEGRATION_SD**2
    assert covariance[5, 5] == pytest.approx(expected, rel=1e-6)


def test_angles_are_brought_to_the_tick() -> None:
    """Of a body that yaws at a constant rate: all samples say the yaw at the tick."""
    h, n, rate = 0.04, 8, 0.7
    stamps = [(i + 1) * h / n for i in range(n)]
    w = np.array([0.0, 0.0, rate])
    samples = [inertial.Sample(s, np.array([0.0, 0.0, 3.13 + rate * s]), w, np.zeros(3)) for s in stamps]
    _, tick = inertial.inertial_ticks(samples, 2, h, n, (1e-3, 0.05), InertialNoise())
    np.testing.assert_allclose(tick.rpy, [0.0, 0.0, 3.13 + rate * h], rtol=0.0, atol=1e-12)
    assert tick.samples == n


def test_a_tick_without_its_last_sample_is_believed_less() -> None:
    f = np.array([0.0, 0.0, 9.81])
    samples = [inertial.Sample(0.01, np.zeros(3), np.zeros(3), f), inertial.Sample(0.04, np.zeros(3), np.zeros(3), f)]
    ticks = inertial.inertial_ticks(samples, 4, 0.02, 2, (1e-3, 0.05), InertialNoise())
    assert [tick.samples for tick in ticks[1:]] == [1, 1, 0]
    rest, whole, nothing = (tick.motion.preintMeasCov()[8, 8] for tick in ticks[1:])
    assert rest > whole
    assert nothing == pytest.approx((0.15 * 0.02) ** 2)
    for tick in ticks[1:]:
        assert tick.motion.deltaTij() == pytest.approx(0.02)


def gauss_markov(s: np.ndarray, t: np.ndarray) -> np.ndarray:
    return 0.3**2 * np.exp(-np.abs(s - t) / 2.0)


def random_walk(s: np.ndarray, t: np.ndarray) -> np.ndarray:
    return 0.3**2 + 0.2**2 * (np.minimum(s, t) - 0.5)


def constant(s: np.ndarray, t: np.ndarray) -> np.ndarray:
    return np.full(np.broadcast_shapes(s.shape, t.shape), 0.3**2)


@pytest.mark.parametrize(
    ("kernel", "rate", "time"), [(gauss_markov, 0.0, 2.0), (random_walk, 0.2, None), (constant, 0.0, None)]
)
def test_a_process_is_the_one_of_its_covariance_function(
    kernel: Callable[[np.ndarray, np.ndarray], np.ndarray], rate: float, time: float | None
) -> None:
    """Estimates of a linear graph are those of the dense problem, K (K + R)^-1 y, and so are their covariances."""
    t, y, r = np.array([0.5, 0.6, 1.5, 4.0, 4.1]), RNG.normal(size=5), 0.1
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    process = factors.Process(graph, values, factors.numbered(), np.array([0.3]), rate, time)
    keys = [process.at(its) for its in t]
    for key, value in zip(keys, y, strict=True):
        graph.add(gtsam.PriorFactorVector(key, np.array([value]), gtsam.noiseModel.Isotropic.Sigma(1, r)))
    found = solver.minimum(graph, values, 1e-12)
    tree = solver.eliminated(graph, found)
    K = kernel(t[:, np.newaxis], t)
    gain = K @ np.linalg.inv(K + r**2 * np.eye(5))
    np.testing.assert_allclose([found.atVector(key)[0] for key in keys], gain @ y, rtol=0.0, atol=1e-7)
    covariance = [tree.marginalCovariance(key)[0, 0] for key in keys]
    np.testing.assert_allclose(covariance, np.diag(K - gain @ K), rtol=1e-6, atol=0.0)


def test_the_method_goes_down_where_a_whole_step_would_not() -> None:
    """Rosenbrock's function, from where it is usually begun."""
    graph, values, noise = gtsam.NonlinearFactorGraph(), gtsam.Values(), gtsam.noiseModel.Unit.Create(2)

    def error(_: object, its: "gtsam.Values", H: list[np.ndarray] | None) -> np.ndarray:
        x, y = its.atVector(ERROR)
        if H is not None:
            H[0] = np.array([[-20.0 * x, 10.0], [-1.0, 0.0]])
        return np.array([10.0 * (y - x * x), 1.0 - x])

    graph.add(gtsam.CustomFactor(noise, [ERROR], error))
    values.insert(ERROR, np.array([-1.2, 1.0]))
    np.testing.assert_allclose(solver.minimum(graph, values, 1e-12).atVector(ERROR), [1.0, 1.0], rtol=0.0, atol=1e-6)
