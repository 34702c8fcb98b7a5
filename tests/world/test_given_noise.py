"""Noise that is given: the numbers that a seed would draw make that seed's flight, whatever draws them."""

from itertools import product

import numpy as np
import pytest
from numba import njit
from scipy.stats import kstest, norm

from ortilo_drake.flight.engine import Engine
from ortilo_drake.model.input_error import InputError
from ortilo_drake.scenario import load_scenario
from ortilo_drake.world.given_noise import MOST, GivenNoise
from ortilo_drake.world.noise import four_normals, four_uniforms, normals, put_normals, stream_id, uniforms

HOVER = "planner={kind: hover, duration: 3.0, point: [8.0, 1.0, 1.0]}"
SPREAD = "truth.vehicle.mass_factor_sd=0.1", "truth.survey.anchors_sd=0.05"
UNIFORM = {
    int(stream_id(name).astype(np.int64)) for name in ("link/uwb", "link/imu", "link/command", "camera false boxes")
}


def rows_of_seed(noise: GivenNoise, seed: int, ticks: int, tick_at: dict[int, int]) -> np.ndarray:
    """Return rows of the numbers that a seed draws; tick_at: by stream how much later the stream's tick is than k."""
    rows = np.zeros((ticks, noise.width), np.float32)
    for (stream, first, n, several), k in product(noise.streams, range(ticks)):
        for tick in range(k * several, (k + 1) * several):
            its = np.uint64(stream & (2**64 - 1))
            at = slice(first + n * (tick % several), first + n * (tick % several + 1))
            tick += tick_at.get(stream, 0)
            rows[k, at] = norm.ppf(uniforms(seed, its, tick, n)) if stream in UNIFORM else normals(seed, its, tick, n)
    return rows


def later(name: str) -> dict[int, int]:
    return {int(stream_id(name).astype(np.int64)): 1}


@pytest.mark.family
@pytest.mark.parametrize(
    ("name", "settings", "tick_at"),
    [
        ("nominal_imu_uwb", (), {}),
        ("nominal_imu_uwb", ("uwb.link.loss=0.3", "uwb.link.delay=1", "uwb.link.random_delay=2"), {}),
        ("nominal_imu_uwb", ("uwb.link.loss={kind: bursts, loss: 0.2, mean_length: 0.2}",), {}),
        ("nominal_imu_uwb", ("command_link.loss=0.2",), {}),
        ("nominal_imu_uwb", (*SPREAD, "truth.uwb.slow_sd=0.05"), later("slow error/uwb_slow_error")),
        ("imu_uwb", ("imu.link.rate=120", "estimator.kind=tight"), {}),
    ],
)
def test_the_numbers_of_a_seed_make_its_flight(name: str, settings: tuple[str, ...], tick_at: dict[int, int]) -> None:
    """But for rounding: given numbers are float32."""
    engine = Engine(load_scenario(name, (HOVER, *settings)))
    rows = rows_of_seed(engine.noise, 5, engine.ticks, tick_at)
    start = np.concatenate([np.zeros(0), *(normals(5, stream_id(its), 0, n) for its, n in engine.drawn.items())])
    given = engine.distances_given(np.concatenate((rows.ravel(), start))[np.newaxis])
    drawn = engine.distances(np.full((1, engine.ticks), 5))
    np.testing.assert_allclose(given, drawn, atol=2e-5)
    assert np.max(np.abs(drawn - engine.distances(np.full((1, engine.ticks), 6)))) > 1e-2


A, B = stream_id("a"), stream_id("b")


@njit
def draws(seeds: np.ndarray, found: np.ndarray) -> None:
    """Draw in every tick: four normal numbers, six and two uniform ones of which a stream counts two to the tick."""
    values = np.empty(6)
    for k in range(seeds.size):
        found[k, :4] = four_normals(seeds[k], A, k)
        put_normals(values, seeds[k], B, k)
        found[k, 4:10] = values
        for i in range(2):
            found[k, 10 + i] = uniforms(seeds[k], A + B, 2 * k + i, 1)[0]
        found[k, 12:16] = four_uniforms(seeds[k], A - B, k)
        found[k, 16] = normals(seeds[k], A * A, k, 1 + (seeds.size - k) // seeds.size)[0]


def given(ticks: int = 400) -> tuple[GivenNoise, np.ndarray]:
    found = np.zeros((ticks, 17))
    return GivenNoise(ticks, lambda seeds: draws(seeds, found), 2), found


@pytest.mark.long
def test_a_row_has_every_number_once_and_each_call_gets_its_own() -> None:
    noise, found = given()
    assert noise.width == 4 + 6 + 2 + 4 + 2  # the first tick draws two of the last stream, all others one
    rows = np.random.default_rng(1).standard_normal((400, noise.width), dtype=np.float32)
    draws(noise.seeds(rows), found)
    as_normal = np.hstack((found[:, :10], norm.ppf(found[:, 10:16]), found[:, 16:]))
    for k in range(1, 400):
        its = np.sort(rows[k, :-1])
        np.testing.assert_allclose(np.sort(as_normal[k]), its, atol=1e-6)


@pytest.mark.long
def test_what_was_not_learned_is_drawn_and_has_its_law() -> None:
    noise, _ = given()
    rows = np.random.default_rng(2).standard_normal((400, noise.width), dtype=np.float32)

    @njit
    def beyond(seeds: np.ndarray) -> np.ndarray:
        found = np.empty((seeds.size, 6))
        for k in range(seeds.size):
            found[k, :3] = normals(seeds[k], B, 0, 9)[6:]
            found[k, 3:] = normals(seeds[k], B * A, 0, 3)
        return found

    found = beyond(noise.seeds(rows))
    assert len(np.unique(found)) > 0.99 * found.size
    assert kstest(found.ravel(), "norm").pvalue > 1e-3
    assert np.array_equal(found, beyond(noise.seeds(rows.copy())))  # of the row alone


def test_rows_of_another_shape_are_refused() -> None:
    noise, _ = given()
    with pytest.raises(ValueError, match=r"rows: \(400, 3\) of float32"):
        noise.seeds(np.zeros((400, 3), np.float32))


def test_more_streams_than_a_directory_holds_are_refused() -> None:
    @njit
    def draws_of(seeds: np.ndarray, streams: int) -> None:
        for i in range(streams):
            normals(seeds[0], A + np.uint64(i), 0, 1)

    assert len(GivenNoise(1, lambda seeds: draws_of(seeds, MOST), 1).streams) == MOST
    with pytest.raises(InputError, match=f"^room.landmarks: too many: .* {MOST} streams"):
        GivenNoise(1, lambda seeds: draws_of(seeds, MOST + 1), 1)
