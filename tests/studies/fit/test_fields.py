"""Errors of places: the drawn field has Matérn's covariance, and the fit tells places from times."""

import numpy as np
import pytest

from ortilo_drake.interop.recorded.range_rows import single_ranges
from ortilo_drake.scenario.noise_file import FieldNoise, LastingNoise, UwbNoise
from ortilo_drake.studies.fit.fit import fit_fields, matern
from ortilo_drake.studies.fit.sensor_errors import RangeErrors
from ortilo_drake.studies.predict.predicted import draw_errors, numbers_of
from ortilo_drake.world.sensors.fitted_uwb import draw_day, field_of


def test_a_field_has_the_covariance_of_matern() -> None:
    rng, places = np.random.default_rng(5), np.array([[0.0, 0, 0], [0.3, 0, 0], [0, 1.0, 0], [0, 0, 3.0]])
    drawn = np.array([field_of(rng.standard_normal(400), 0.8, 0.2).at(places) for _ in range(8000)])
    r = np.sqrt(3.0) * np.linalg.norm(places - places[0], axis=1) / 0.8
    np.testing.assert_allclose(drawn.T @ drawn[:, 0] / 8000, 0.04 * (1 + r) * np.exp(-r), atol=0.002)
    np.testing.assert_allclose(matern(np.linalg.norm(places, axis=1), 0.8), (1 + r) * np.exp(-r))


@pytest.mark.long
def test_what_comes_back_with_the_place_is_told_from_what_lasts() -> None:
    rng, rows, noise = (
        np.random.default_rng(3),
        4000,
        UwbNoise(white=0.05, lasting=LastingNoise(time=0.5, sd=0.1), field=FieldNoise(length=0.6, sd=0.2)),
    )
    t, b = np.sort(rng.uniform(0.0, 60.0, rows)), rng.integers(0, 4, rows)
    place = np.column_stack([1.5 * np.cos(t), 1.5 * np.sin(t), 1.0 + 0.5 * np.sin(0.37 * t)])
    ranges = single_ranges(t, b, np.zeros(rows))
    e = draw_errors(ranges, place, 0.0, noise, draw_day(noise, 4, numbers_of(rng)), rng)
    found = fit_fields([RangeErrors(t, b, ranges.other, e, place)], [np.zeros(rows)], 4, (0.5, 0.2, 0.05), rows=500)
    for number, true in zip(found, (0.6, 0.2, 0.5, 0.1, 0.05), strict=True):
        assert number.low < true < number.high
