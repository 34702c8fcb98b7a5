"""The counter-based noise against NumPy's Philox, its statistics, and the disturbance drawn from it."""

import numpy as np
import pytest
from drake_box import PlayedBox
from hypothesis import given, settings
from hypothesis import strategies as st
from numba import njit
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import LogVectorOutput, ZeroOrderHold
from scipy import stats

from ortilo_drake.diagrams.wiring.truth import first_slow
from ortilo_drake.loop.element import Values
from ortilo_drake.scenario import Disturbance
from ortilo_drake.world.drawn_truth import of_seed
from ortilo_drake.world.noise import SlowNoise, gauss_markov, normals, philox_words, random_walk, stream_id, uniforms
from ortilo_drake.world.vehicle.disturbance import disturbance_box, lasting_force_box

settings.register_profile("compiled", deadline=None)  # the first example may wait for numba
settings.load_profile("compiled")

H = 1.0 / 30.0
compiled_words = njit(philox_words)


def numpy_words(seed: int, stream: int, tick: int, block: int) -> np.ndarray:
    """Four words of NumPy's Philox, which raises its 256-bit counter by 1 before it draws."""
    before = (block + (tick << 64) - 1) % 2**256
    counter = np.array([(before >> (64 * i)) % 2**64 for i in range(4)], dtype=np.uint64)
    key = np.array([seed, stream], dtype=np.uint64)
    return np.random.Philox(key=key, counter=counter).random_raw(4)


@given(
    seed=st.integers(0, 2**63 - 1),
    stream=st.integers(0, 2**64 - 1),
    tick=st.integers(0, 2**63 - 1),
    block=st.integers(0, 2**63 - 1),
)
def test_words_are_numpys(seed: int, stream: int, tick: int, block: int) -> None:
    assert [*compiled_words(seed, np.uint64(stream), block, tick)] == numpy_words(seed, stream, tick, block).tolist()


@pytest.mark.parametrize("tick", [0, 1, 12345])
def test_first_block_needs_no_wraparound(tick: int) -> None:
    assert [*compiled_words(7, np.uint64(3), 0, tick)] == numpy_words(7, 3, tick, 0).tolist()


@given(seed=st.integers(0, 2**63 - 1), tick=st.integers(0, 10**9), n=st.integers(0, 30))
def test_uniforms_and_normals_follow_from_the_words(seed: int, tick: int, n: int) -> None:
    stream = stream_id("imu")
    blocks = [numpy_words(seed, int(stream), tick, block) for block in range(n // 4 + 1)]
    u = (np.concatenate(blocks) >> np.uint64(11)) * 2.0**-53
    np.testing.assert_array_equal(uniforms(seed, stream, tick, n), u[:n])
    radius, angle = np.sqrt(-2 * np.log(1 - u[0::2])), 2 * np.pi * u[1::2]
    z = np.column_stack([radius * np.cos(angle), radius * np.sin(angle)]).ravel()
    np.testing.assert_allclose(normals(seed, stream, tick, n), z[:n], rtol=1e-13, atol=1e-14)


@given(n=st.integers(1, 12), more=st.integers(0, 12))
def test_asking_for_more_changes_nothing_before(n: int, more: int) -> None:
    stream = stream_id("uwb")
    np.testing.assert_array_equal(normals(5, stream, 17, n + more)[:n], normals(5, stream, 17, n))


def test_normals_are_standard_normal() -> None:
    stream = stream_id("uwb")
    v = np.concatenate([normals(1, stream, k, 9) for k in range(5_000)])
    n = len(v)
    assert abs(v.mean()) < 4 / np.sqrt(n)
    assert abs(v.var() - 1) < 4 * np.sqrt(2 / n)
    assert abs(np.mean(v**3)) < 4 * np.sqrt(15 / n)
    assert abs(np.mean(v**4) - 3) < 4 * np.sqrt(96 / n)
    assert stats.kstest(v, "norm").pvalue > 1e-3


@pytest.mark.parametrize(
    ("a", "b"),
    [
        ((1, "uwb", 0), (1, "imu", 0)),
        ((1, "uwb", 0), (2, "uwb", 0)),
        ((1, "uwb", 0), (1, "uwb", 1)),
        ((1, "link/uwb", 0), (1, "link/camera", 0)),
    ],
    ids=["streams", "seeds", "ticks", "links"],
)
def test_noise_of_two_sources_is_uncorrelated(a: tuple[int, str, int], b: tuple[int, str, int]) -> None:
    n, ticks = 6, 4_000
    v = np.array([normals(a[0], stream_id(a[1]), a[2] + k, n) for k in range(ticks)])
    w = np.array([normals(b[0], stream_id(b[1]), b[2] + k, n) for k in range(ticks)])
    correlation = v.T @ w / ticks  # each element has standard deviation 1 / sqrt(ticks)
    assert np.abs(correlation).max() < 4.5 / np.sqrt(ticks)
    assert np.abs(np.corrcoef(v.T) - np.eye(n)).max() < 4.5 / np.sqrt(ticks)


def test_stream_numbers_differ_and_stay() -> None:
    names = ["imu", "uwb", "camera", "disturbance", "link/uwb", "link/imu", "link/camera"]
    assert len({int(stream_id(name)) for name in names}) == len(names)
    assert int(stream_id("uwb")) == int(stream_id("uwb"))


def held_disturbance(settings: Disturbance, seed: int, duration: float, period: float) -> np.ndarray:
    """Samples (n, 6) of a disturbance held over ticks of 1/30 s."""
    builder = DiagramBuilder()
    source = builder.AddSystem(PlayedBox(disturbance_box(settings, H), H).system)
    hold = builder.AddSystem(ZeroOrderHold(H, 6))
    builder.Connect(source.GetOutputPort("disturbance"), hold.get_input_port())
    log = LogVectorOutput(hold.get_output_port(), builder, period)
    simulator = Simulator(builder.Build())
    source.set_seed_in(source.GetMyMutableContextFromRoot(simulator.get_mutable_context()), seed)
    simulator.AdvanceTo(duration)
    return log.FindLog(simulator.get_context()).data().T


def test_disturbance_has_the_standard_deviations_of_its_settings() -> None:
    d = held_disturbance(Disturbance(force_density=0.27 * np.sqrt(H), torque_density=0.005 * np.sqrt(H)), 3, 200.0, H)[
        1:
    ]
    unit = d / np.array([0.27] * 3 + [0.005] * 3)
    n = len(unit)
    assert n >= 5_999
    assert np.all(np.abs(unit.mean(axis=0)) < 4 / np.sqrt(n))
    assert np.all(np.abs(unit.var(axis=0) - 1) < 4 * np.sqrt(2 / n))
    assert np.abs(np.corrcoef(unit.T) - np.eye(6)).max() < 4.5 / np.sqrt(n)
    assert len(np.unique(unit[:, 0])) == n  # a new draw every tick


def test_disturbance_is_held_over_each_tick() -> None:
    d = held_disturbance(Disturbance(), 3, 10.0, H / 4)
    # A sample at t_k still shows the former tick's draw: it is taken before the hold's update.
    for tick in range(1, 290):
        assert len(np.unique(d[4 * tick + 1 : 4 * tick + 4, 0])) == 1
    assert len(np.unique(d[:, 0])) >= 299


def test_same_seed_same_disturbance_other_seed_another() -> None:
    settings = Disturbance()
    first = held_disturbance(settings, 3, 5.0, H)
    np.testing.assert_array_equal(first, held_disturbance(settings, 3, 5.0, H))
    assert np.all(first[2:] != held_disturbance(settings, 4, 5.0, H)[2:])


def source_of(noise: SlowNoise, seed: int, bias: np.ndarray) -> PlayedBox:
    """Return what adds such an error to nothing, begun as in the world of a seed."""
    source = PlayedBox(lasting_force_box(noise, H), H, seed, disturbance=np.zeros(len(noise.a)))
    drawn = first_slow("lasting_force", noise.start, of_seed(seed))
    source.system.give(source.context, {"lasting_force": drawn.updated(Values(tables={"bias": bias}))})
    return source


def series(noise: SlowNoise, ticks: int, seed: int = 3, bias: float = 0.0) -> np.ndarray:
    """Return e_0 .. e_ticks (ticks + 1, n) as a simulator's monitor sees them, before each tick's update."""
    source = source_of(noise, seed, np.full(len(noise.a), bias))
    found = [source.say(0)]
    for k in range(ticks):
        source.step()
        found.append(source.say(k + 1))
    return np.array(found)


def test_gauss_markov_noise_is_stationary_and_forgets_exponentially() -> None:
    n, ticks, T, sd = 400, 150, 0.5, 0.3
    x = series(gauss_markov(np.full(n, sd), T, H), ticks)
    # n independent paths: the variance of each tick from x_0 on, and the correlation at each lag.
    for k in (0, 1, 30, ticks):
        assert abs(np.std(x[k]) / sd - 1.0) < 4.0 / np.sqrt(2.0 * n), k
    for lag in (1, 5, 15, 45):
        products = (x[lag:] * x[:-lag]).mean() / sd**2
        # Paths are independent; along one, ticks a correlation time T apart nearly are.
        error = 5.0 / np.sqrt(n * (ticks - lag) * H / (2.0 * T))
        assert products == pytest.approx(np.exp(-lag * H / T), abs=error), lag
    assert abs(x.mean()) < 5.0 * sd / np.sqrt(n * ticks * H / (2.0 * T))


def test_a_random_walk_grows_with_the_root_of_time_and_keeps_its_mean() -> None:
    n, after_1_s = 500, 0.02
    x = series(random_walk(np.full(n, after_1_s), H), 120, bias=0.7) - 0.7
    assert not x[0].any()
    for k in (30, 120):
        assert np.std(x[k]) == pytest.approx(after_1_s * np.sqrt(k * H), rel=4.0 / np.sqrt(2.0 * n))
    steps = np.diff(x, axis=0)
    assert np.abs(np.corrcoef(steps[0], steps[1])[0, 1]) < 4.0 / np.sqrt(n)


def test_it_is_the_seeds() -> None:
    noise = gauss_markov(np.full(3, 0.1), 2.0, H)
    one = series(noise, 20)
    np.testing.assert_array_equal(series(noise, 20), one)
    assert not np.isclose(series(noise, 20, seed=4), one).any()
    np.testing.assert_allclose(series(noise, 20, bias=0.5) - 0.5, one, rtol=0.0, atol=1e-12)


def test_it_runs_on_autodiff() -> None:
    source = source_of(gauss_markov(np.full(3, 0.1), 2.0, H), 7, np.array([0.1, 0.2, 0.3]))
    other = source.on_autodiff(7)
    other.context.SetTimeStateAndParametersFrom(source.context)
    for one, its in ((source.say(), other.say()), (source.step(), other.step()), (source.say(1), other.say(1))):
        assert [float(v.value()) for v in its] == one.tolist()
        assert one.all()
