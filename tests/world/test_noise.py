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

from ortilo_drake.scenario import Disturbance
from ortilo_drake.world.noise import normals, philox_words, stream_id, uniforms
from ortilo_drake.world.vehicle.disturbance import disturbance_box

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
