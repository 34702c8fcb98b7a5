"""Sweeps: their points, and what is refused."""

from pathlib import Path

import numpy as np
import pytest
from scipy.stats import qmc

from ortilo_drake.model.typed_yaml import InputError, validate
from ortilo_drake.studies.maps.sweep import Sweep, load_sweep, points_of, scenario_at

RANGES = {"uwb.link.rate": {"start": 1, "stop": 10}, "uwb.link.loss": {"start": 0.0, "stop": 0.8}}


def sweep(**fields: object) -> Sweep:
    return validate(Sweep, {"scenario": "nominal_imu_uwb"} | fields, "sweep")


def test_a_grid_has_every_combination_in_order() -> None:
    axes = {"uwb.link.rate": {"start": 1, "stop": 100, "count": 3, "scale": "log"}, "uwb.link.delay": [0, 2]}
    points = points_of(sweep(axes=axes))
    assert [p["uwb.link.delay"] for p in points] == [0, 2] * 3
    np.testing.assert_allclose([p["uwb.link.rate"] for p in points], [1, 1, 10, 10, 100, 100])


def test_whole_numbers_stay_whole() -> None:
    axes = {"uwb.link.delay": {"start": 0, "stop": 5, "count": 6, "whole": True}}
    points = points_of(sweep(axes=axes))
    assert [p["uwb.link.delay"] for p in points] == list(range(6))
    assert all(type(p["uwb.link.delay"]) is int for p in points)


@pytest.mark.parametrize("kind", ["latin_hypercube", "sobol"])
def test_scattered_points_are_even_on_every_axis_and_the_same_for_a_seed(kind: str) -> None:
    of = sweep(axes=RANGES, design={"kind": kind, "points": 16, "seed": 3})
    points = points_of(of)
    assert points == points_of(of)
    for key, axis in of.axes.items():
        share = (np.array([p[key] for p in points]) - axis.start) / (axis.stop - axis.start)
        assert sorted(np.floor(16 * share)) == list(range(16))  # one in each sixteenth


def test_saltellis_points_exchange_one_column_at_a_time() -> None:
    points = points_of(sweep(axes=RANGES, design={"kind": "sensitivity", "points": 8}))
    values = np.array([list(p.values()) for p in points])
    A, B, first, second = (values[8 * k : 8 * (k + 1)] for k in range(4))
    np.testing.assert_array_equal(first, np.column_stack([B[:, 0], A[:, 1]]))
    np.testing.assert_array_equal(second, np.column_stack([A[:, 0], B[:, 1]]))
    both = qmc.Sobol(4, rng=0).random(8)
    np.testing.assert_allclose(np.column_stack([A, B]), np.array([1, 0, 1, 0]) + both * np.array([9, 0.8, 9, 0.8]))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("axes: {}", "axes"),
        ("axes: {uwb.link.rate: []}", "axes.uwb.link.rate: []: must have at least 1 item"),
        (
            "axes: {uwb.link.loss: [{kind: bursts}]}",
            "loss.0: {'kind': 'bursts'}: must be a number, a word, true or false",
        ),
        ("axes: {uwb.link.loss: [null]}", "axes.uwb.link.loss.0: None: must be a number, a word, true or false"),
        ("axes: {UWB-loss: [0.1]}", "axes.UWB-loss: 'UWB-loss': must match pattern"),
        ("axes: {uwb.link.rate: 5}", "axes.uwb.link.rate: 5: must be a list"),
        (
            "axes: {uwb.link.rate: {start: 5, stop: 6, cuont: 3}}",
            "rate.cuont: unknown key (value 3), did you mean 'count'",
        ),
        ("axes: {uwb.link.rate: [1]}\nflights: 0", "flights: 0: must be at least 1"),
        ("axes: {uwb.link.rate: {start: 5, stop: 5}}", "must be above the start"),
        ("axes: {uwb.link.rate: {start: 0, stop: 5, scale: log}}", "must be above 0 on a logarithmic scale"),
        ("axes: {uwb.link.rate: [1]}\ndesign: {kind: sobol, points: 8}", "must be a range"),
        ("axes: {uwb.link.rate: {start: 1, stop: 2}}\ndesign: {kind: sobol, points: 7}", "power of 2"),
        (
            "axes: {seed: {start: 1, stop: 2, count: 1000}, a: {start: 1, stop: 2, count: 1000}}",
            "at most 100000",
        ),
        ("axes: {uwb.link.rate: [1]}\nflight: 10", "flight: unknown key"),
    ],
)
def test_a_bad_sweep_is_one_line_that_names_file_and_field(text: str, said: str, tmp_path: Path) -> None:
    file = tmp_path / "sweep.yaml"
    file.write_text(text)
    with pytest.raises(InputError) as error:
        load_sweep(file)
    assert str(error.value).startswith(str(file))
    assert said in str(error.value)
    assert "\n" not in str(error.value)


def test_an_unknown_or_wrong_setting_is_refused_by_name() -> None:
    of = sweep(axes={"uwb.link.lose": [0.1]})
    with pytest.raises(InputError, match=r"here: nominal_imu_uwb: uwb\.link\.lose"):
        scenario_at(of, points_of(of)[0], "here")
    of = sweep(axes={"uwb.link.loss": [0.1, 1.5]})
    with pytest.raises(InputError, match=r"uwb\.link\.loss"):
        scenario_at(of, points_of(of)[1], "here")


def test_a_scenarios_file_is_meant_from_where_the_sweep_lies(tmp_path: Path) -> None:
    (tmp_path / "mine.yaml").write_text("base: nominal_imu_uwb\nuwb: {link: {rate: 7.5}}\n")
    (tmp_path / "sweep.yaml").write_text("scenario: mine.yaml\naxes: {uwb.link.loss: [0.2]}\n")
    of = load_sweep(tmp_path / "sweep.yaml")
    scenario = scenario_at(of, points_of(of)[0], "sweep")
    assert scenario.uwb.link.rate == 7.5
    assert scenario.uwb.link.loss.probability == 0.2
