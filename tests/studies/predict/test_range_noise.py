"""Drawn errors of ranges have the deviations, times and bursts that a NOISE.yaml asks for."""

import numpy as np
import pytest
from scipy.stats import t as student

from ortilo_drake.interop.recorded.range_rows import Ranges
from ortilo_drake.scenario.noise_file import FieldNoise, LastingNoise, NoiseFile, Outliers, UwbNoise
from ortilo_drake.studies.predict.predicted import as_white, draw_errors, draw_outliers, lasting_errors, numbers_of
from ortilo_drake.world.sensors.fitted_uwb import draw_day, no_day


@pytest.mark.long
def test_lasting_errors_are_gauss_markov() -> None:
    t = np.cumsum(np.random.default_rng(0).exponential(0.02, 200_000))
    g = lasting_errors(t, 1, 0.5, 0.2, np.random.default_rng(1))[:, 0]
    assert g.std() == pytest.approx(0.2, rel=0.05)
    even = np.interp(np.arange(0.0, t[-1], 0.5), t, g)
    assert np.corrcoef(even[1:], even[:-1])[0, 1] == pytest.approx(np.exp(-1.0), abs=0.05)


def test_outliers_come_in_their_share_and_bursts() -> None:
    anchor = np.tile(np.arange(4), 50_000)
    noise = UwbNoise(white=0.0, outliers=Outliers(share=0.05, sd=1.0, burst=3.0))
    for other, share in ((-1, 0.05), (7, 1.0 - 0.95**2)):  # one of a difference's two ranges is enough
        ranges = Ranges(np.arange(200_000.0), anchor, np.zeros(200_000), np.full(200_000, other), 0 * anchor)
        odd = draw_outliers(ranges, noise, np.random.default_rng(2))[anchor == 2]
        begins = (odd[1:] & ~odd[:-1]).sum()
        assert odd.mean() == pytest.approx(share, rel=0.1)
        assert odd.sum() / begins == pytest.approx(3.0, rel=0.06)
        assert not draw_outliers(ranges, UwbNoise(white=0.1), np.random.default_rng(2)).any()


@pytest.mark.parametrize("fitted_on", [False, True])
def test_noise_of_differences_is_scaled_to_ranges_and_back(fitted_on) -> None:
    rows = 40_000
    is_difference = np.arange(rows) % 2 == 1
    other = np.where(is_difference, 1, -1)
    ranges = Ranges(np.arange(rows) * 100.0, np.zeros(rows, int), np.zeros(rows), other, np.zeros(rows, int))
    noise = UwbNoise(white=0.1, differences=fitted_on)
    e = draw_errors(ranges, np.ones((rows, 3)), 0.0, noise, no_day(noise, 2), np.random.default_rng(4))
    single = 0.1 / np.sqrt(2.0) if fitted_on else 0.1
    assert e[~is_difference].std() == pytest.approx(single, rel=0.02)
    assert e[is_difference].std() == pytest.approx(single * np.sqrt(2.0), rel=0.02)
    white = as_white(NoiseFile(uwb=noise.model_copy(update={"lasting": LastingNoise(time=1.0, sd=0.2)}))).uwb
    assert white.of_single_ranges.white == pytest.approx(np.hypot(single, 0.2))


def test_a_heavy_tail_is_that_of_student_s_t_and_white_noise_has_its_size() -> None:
    rows = 100_000
    ranges = Ranges(np.arange(rows) * 1.0, np.zeros(rows, int), np.zeros(rows), np.full(rows, -1), np.zeros(rows, int))
    noise = UwbNoise(white=0.1, freedom=2.0)
    e = draw_errors(ranges, np.ones((rows, 3)), 0.0, noise, no_day(noise, 2), np.random.default_rng(4))
    for share in (0.3, 0.5, 0.8):  # six normals err by less far out
        assert np.quantile(np.abs(e), share) == pytest.approx(0.1 * student.ppf(0.5 + 0.5 * share, 2.0), rel=0.05)
    white = as_white(NoiseFile(uwb=noise)).uwb
    assert white.freedom is None
    assert white.white == pytest.approx(e.std(), rel=0.03)


def test_a_difference_has_the_errors_of_two_anchors_and_a_day_keeps_its_own() -> None:
    rows = 40_000
    ranges = Ranges(
        np.arange(rows) * 100.0, np.zeros(rows, int), np.zeros(rows), np.ones(rows, int), np.zeros(rows, int)
    )
    noise = UwbNoise(white=0.1, lasting=LastingNoise(time=1.0, sd=0.2), differences=True)
    day = no_day(noise, 2)._replace(constants=np.array([0.5, 0.2]))
    place = np.tile([0.0, 0.0, 2.0], (rows, 1))
    e = draw_errors(ranges, place, 0.0, noise, day, np.random.default_rng(3))
    assert e.mean() == pytest.approx(0.3, abs=0.01)
    assert e.std() == pytest.approx(np.sqrt(0.01 + 2 * 0.04), rel=0.02)
    near = draw_errors(ranges, place, 0.0, noise.model_copy(update={"near_floor": 2.0}), day, np.random.default_rng(3))
    np.testing.assert_allclose(near - 0.3, 2.0 * (e - 0.3))  # at that height the floor doubles errors
    field = UwbNoise(white=0.1, field=FieldNoise(length=1.0, sd=0.2), constants_sd=0.1)
    one, same, other = (draw_day(field, 2, numbers_of(np.random.default_rng(seed))) for seed in (7, 7, 8))
    assert (one.fields_at(place[:1]) == same.fields_at(place[:1])).all()
    assert (one.constants != other.constants).all()
    assert len(np.unique(one.fields_at(place[:1]))) == 2
