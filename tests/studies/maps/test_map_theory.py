"""Theory's lines over maps: against SciPy's Riccati equation, losses of a known law, and axes it cannot judge."""

import dataclasses
import math
from collections.abc import Callable
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.colors import same_color
from scipy.linalg import block_diag, solve_discrete_are
from scipy.stats import qmc

from ortilo_drake.flight.flyable import flight_ticks
from ortilo_drake.model.hover import disturbance_W
from ortilo_drake.model.typed_yaml import InputError, validate
from ortilo_drake.scenario import load_scenario
from ortilo_drake.studies.command_link.command_flights import hover_V
from ortilo_drake.studies.loop.hover_loop import hover_loop
from ortilo_drake.studies.maps.map_figure import map_figure
from ortilo_drake.studies.maps.map_flights import Map, MapPoint
from ortilo_drake.studies.maps.map_report import MapTheory, expected_rms, lost_in_bursts, map_text, theory_of
from ortilo_drake.studies.maps.sweep import Sweep, load_sweep, points_of, scenario_at

BURSTS = {"uwb.link.blackouts": [], "uwb.link.loss": {"kind": "bursts", "loss": 0.5, "mean_length": 1.0}}
LOSS, LENGTH = "uwb.link.loss.loss", "uwb.link.loss.mean_length"


def made(axes: dict, lost: Callable[[dict], int], **fields: object) -> Map:
    """A map in which so many flights of a thousand were lost at each point."""
    base = {"scenario": "nominal_imu_uwb", "settings": BURSTS, "axes": axes, "flights": 1000}
    of = validate(Sweep, base | fields, "sweep")
    rows = [
        MapPoint(p, 1000, lost(p), 0.0, 1.0, *[0.05 + 0.1 * i, None] * 2, 0.04, 0.2, 1.0, None, 3.0, None, {})
        for i, p in enumerate(points_of(of))
    ]
    return Map(of, rows, "engine")


def test_the_error_where_every_range_arrives_is_the_riccati_equations() -> None:
    scenario = load_scenario("nominal_imu_uwb", ("uwb.link={}",))
    loop, V = hover_loop(scenario), hover_V(scenario)
    W = disturbance_W(scenario.vehicle, scenario.h, 0.27, 0.005)
    seen = loop.C[[0, 1, 2, 6, 7, 8]]
    noise = block_diag(V[:3, :3], V[-3:, -3:])
    P = solve_discrete_are(loop.Phi.T, seen.T, W, noise)
    assert math.isclose(expected_rms(scenario), float(np.sqrt(np.trace(P[:3, :3]))), rel_tol=1e-6)


def test_the_filter_is_told_what_its_bank_learns() -> None:
    told = "multilateration={{bias_sd: {0}, bias_bank: null}}"
    exact = load_scenario("imu_uwb", (told.format(0.0), "estimator.biases.uwb_sd=[0.0, 0.0, 0.0]"))
    careful = load_scenario("imu_uwb", (told.format(0.05),))
    assert math.isclose(expected_rms(load_scenario("imu_uwb")), expected_rms(exact), rel_tol=0.01)
    assert expected_rms(careful) > 2.0 * expected_rms(exact)


def test_an_estimator_without_linear_theory_is_named() -> None:
    with pytest.raises(InputError, match=r"estimator\.kind: tight"):
        expected_rms(load_scenario("tight_differences"))


def test_the_error_grows_with_losses_and_bursts_and_is_unbounded_without_ranges() -> None:
    def rms(*settings: str) -> float:
        return expected_rms(load_scenario("nominal_imu_uwb", settings))

    losses = [rms(f"uwb.link.loss={p}") for p in (0.0, 0.5, 0.9)]
    bursts = [rms(f"uwb.link.loss={{kind: bursts, loss: 0.5, mean_length: {L}}}") for L in (0.2, 1.0, 4.0)]
    assert losses == sorted(losses)
    assert bursts == sorted(bursts)
    assert bursts[-1] > losses[1]
    assert rms("uwb.link.loss=1.0") == np.inf
    assert math.isnan(rms("uwb.link.rate=0.1"))  # a chain of 300 modes


@pytest.mark.long
def test_the_longest_burst_of_a_map_is_found_in_its_losses() -> None:
    axes = {LOSS: [0.2, 0.5, 0.8], LENGTH: [1.0, 2.0, 4.0, 8.0]}
    duration = flight_ticks(load_scenario("nominal_imu_uwb")) / 30.0

    def lost(p: dict) -> int:
        return round(1000 * float(lost_in_bursts(p[LOSS], p[LENGTH], duration, 7.0)))

    theory = theory_of(made(axes, lost))
    assert theory.longest is not None
    assert abs(theory.longest - 7.0) < 0.2
    assert theory.silence is None
    assert np.all(np.isfinite(theory.rms))
    for same in (0, 1000):  # nothing lost, or all: as likely for any T beyond some bound, so there is none to name
        assert theory_of(made(axes, lambda p, lost=same: lost))[1:3] == (None, None)


def test_the_chance_of_a_long_burst_is_that_of_bursts_drawn() -> None:
    """A bad state that is left at the rate 1 / L, entered so that a share p of the time is bad; many flights of it."""
    random, p, L, D, T, flights = np.random.default_rng(0), 0.2, 2.0, 60.0, 6.0, 20_000
    hits = 0
    for _ in range(flights):
        bursts = random.poisson(p * D / L)
        hits += bool(np.any(random.exponential(L, bursts) > T))
    expected = float(lost_in_bursts(np.array(p), np.array(L), D, T))
    assert abs(hits / flights - expected) < 4.0 * np.sqrt(expected * (1.0 - expected) / flights)


@pytest.mark.long
def test_what_is_drawn_by_theory_is_in_report_and_figure(tmp_path: Path) -> None:
    found = made({LOSS: [0.2, 0.5, 0.8], LENGTH: [0.5, 2.0, 8.0]}, lambda p: int(100 * p[LENGTH]))
    theory = theory_of(found)
    assert "Dashed in the figure, by theory" in map_text(found, theory)
    plain, with_lines = map_figure(found, tmp_path / "a.png"), map_figure(found, tmp_path / "b.png", theory)
    assert plain is not None
    assert with_lines is not None
    assert plain.read_bytes() != with_lines.read_bytes()


def test_a_heat_map_rises_along_named_axes_with_round_lines_and_no_fragment(drawn_figures: list[Any]) -> None:
    """Errors of 0.3 m Hz / rate along one axis, and one corner where most is lost, which gives no line."""
    axes = {"uwb.link.rate": [5.0, 4.0, 2.0, 1.0], "uwb.link.delay": [0, 1, 2]}
    found = made(axes, lambda p: 900 * (p["uwb.link.rate"] == 1.0 and p["uwb.link.delay"] == 0))
    rows = [dataclasses.replace(row, kept_rms=0.3 / row.point["uwb.link.rate"]) for row in found.rows]
    map_figure(dataclasses.replace(found, rows=rows), Path())
    lost, errors = drawn_figures[0].axes[:2]
    assert (errors.get_xlabel(), errors.get_ylabel()) == ("UWB delay [ticks]", "UWB rate [Hz]")
    assert [text.get_text() for text in errors.get_yticklabels()] == ["1", "2", "4", "5"]
    np.testing.assert_allclose(errors.images[0].get_array()[:, 0], [0.3, 0.15, 0.075, 0.06])
    assert {text.get_text() for text in errors.texts} == {"0.1 m", "0.2 m"}
    assert not lost.texts


def test_theory_far_from_what_was_flown_has_lines_at_values_of_its_own(drawn_figures: list[Any]) -> None:
    found = made({"uwb.link.rate": [1.0, 2.0, 4.0], LOSS: [0.0, 0.3, 0.6, 0.9]}, lambda _: 0)
    rms = np.array([0.01 * row.kept_rms for row in found.rows if row.kept_rms])
    map_figure(found, Path(), MapTheory(rms, None, None, None))
    errors, _ = drawn_figures[0].axes
    drawn = {text.get_text() for text in errors.texts if same_color(text.get_color(), "magenta")}
    assert "0.005 m" in drawn
    assert errors.get_legend_handles_labels()[1][-1].startswith("theory")


def test_labels_of_a_level_that_flights_and_theory_share_lie_apart(drawn_figures: list[Any]) -> None:
    found = made({"uwb.link.rate": [1.0, 2.0, 4.0], LOSS: [0.0, 0.3, 0.6, 0.9]}, lambda _: 0)
    rows = [
        dataclasses.replace(r, kept_rms=rms) for r, rms in zip(found.rows, np.geomspace(0.015, 0.09, 12), strict=True)
    ]
    theory = MapTheory(0.98 * np.geomspace(0.015, 0.09, 12), None, None, None)
    map_figure(dataclasses.replace(found, rows=rows), Path(), theory)
    (figure,) = drawn_figures
    figure.draw_without_rendering()
    labels = [(text.get_text(), text.get_window_extent()) for text in figure.axes[0].texts]
    assert [text for text, _ in labels].count("0.02 m") == 2
    assert not any(a.overlaps(b) for (_, a), (_, b) in combinations(labels, 2))


def test_one_lost_flight_of_twenty_is_no_catastrophe_and_lines_stand_out(drawn_figures: list[Any]) -> None:
    """The colours' scale has at least half of the flights; a halo makes the lines readable on dark cells."""
    axes = {LOSS: [0.2, 0.5, 0.8], "uwb.noise.fraction": [0.01, 0.02, 0.1]}
    found = made(axes, lambda p: 100 * (p[LOSS] > 0.6))
    of = found.sweep.model_copy(update={"scenario": "rooms/mine.yaml"})
    rows = [dataclasses.replace(row, kept_rms=10.0 * row.point["uwb.noise.fraction"]) for row in found.rows]
    map_figure(dataclasses.replace(found, sweep=of, rows=rows), Path())
    (figure,) = drawn_figures
    lost, errors, bar, _ = figure.axes
    assert lost.images[0].get_clim() == (0.0, 0.5)
    assert bar.get_ylabel() == "flights lost [%]"
    assert figure.get_suptitle().startswith("mine: ")
    for axes in (lost, errors):
        assert axes.get_xlabel() == "UWB noise fraction [-]"
        assert all(drawn.get_path_effects() for drawn in (*axes.texts, *axes.collections))
    assert errors.texts


@pytest.mark.parametrize(
    ("axes", "why"),
    [
        ({"uwb.link.delay": [0, 1]}, "theory has lines for rates and losses of links, not for uwb.link.delay"),
        ({"uwb.link.rate": [0.1, 0.125]}, "no common period"),
    ],
)
def test_where_theory_says_nothing_a_line_says_so(axes: dict, why: str) -> None:
    found = made(axes, lambda p: 0, settings={"uwb.link.blackouts": []})
    theory = theory_of(found)
    assert np.isnan(theory.rms).all()
    line = next(line for line in map_text(found, theory).splitlines() if "No lines of theory" in line)
    assert why in line


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
