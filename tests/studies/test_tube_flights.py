"""Flights against the tube: what is compared, and that it is compared with what was flown."""

from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest
from matplotlib.colors import same_color
from matplotlib.figure import Figure
from scipy.stats import binom

from ortilo_drake.flight.flight import fly
from ortilo_drake.scenario import Scenario, load_scenario, with_seed
from ortilo_drake.studies.tube.corridor import Corridor, corridor
from ortilo_drake.studies.tube.tube import NominalFlight, nominal_flight, predict_tube
from ortilo_drake.studies.tube.tube_figures import (
    INSIDE,
    OUTSIDE,
    draw_deviations,
    draw_tube,
    fill_margins,
    plan_figure,
)
from ortilo_drake.studies.tube.tube_flights import (
    Flown,
    PointResult,
    at_burst,
    fly_point,
    interval,
    judge_point,
    within,
    worst_stretch,
)
from ortilo_drake.studies.tube.tube_map import MarginMap, arrivals_of_seed, with_rates

PAIR = (0.3, 0.5)


@lru_cache(maxsize=1)
def short() -> tuple[Scenario, NominalFlight]:
    scenario = load_scenario(
        "nominal_imu_uwb_yolo",
        (
            "camera.kind=projected",
            "settle=0.5",
            "uwb.link.blackouts=[]",
            "planner={kind: waypoints, points: [[0.0, 0.0, 1.5], [0.8, 0.5, 1.5]]}",
        ),
    )
    return scenario, nominal_flight(scenario)


def straying(share: float, lost: float | None = None) -> list[Flown]:
    """Two flights that stray to that share of the tube's radius, to the north."""
    scenario, nominal = short()
    tube = predict_tube(with_rates(scenario, *PAIR), nominal)
    deviation = np.zeros((len(tube.radius), 3))
    deviation[:, 1] = share * tube.radius
    return [Flown(1, deviation, None), Flown(2, deviation, lost)]


def judge(flights: list[Flown]) -> PointResult:
    return judge_point(with_rates(short()[0], *PAIR), PAIR, flights, short()[1], others=range(50, 54))


@pytest.mark.long
def test_flights_inside_the_tube_hold() -> None:
    result = judge(straying(0.99))
    assert (result.contained, result.contained_low, result.contained_worst) == (1.0, 1.0, 1.0)
    assert result.holds
    assert result.breakdown == ""
    assert result.margin > 0.0


@pytest.mark.long
def test_flights_outside_the_tube_are_a_breakdown() -> None:
    result = judge(straying(1.01))
    assert result.contained == 0.0
    assert not result.holds
    assert result.breakdown


@pytest.mark.long
def test_a_flight_lost_though_the_tube_is_inside_is_a_breakdown() -> None:
    result = judge(straying(0.5, lost=3.0))
    assert (result.contained, result.lost, result.holds) == (1.0, 1, False)
    assert "1 lost" in result.breakdown


@pytest.mark.long
def test_flights_are_those_of_the_diagram_and_their_arrivals_the_expected_ones(tmp_path: Path) -> None:
    scenario, nominal = short()
    lossy = at_burst(scenario, (0.5, 0.3))
    flights = fly_point(lossy, [4, 7], tmp_path)
    flight = fly(with_seed(lossy, 7))
    expected = flight["truth"].values[:, :3] - flight["reference"].values
    np.testing.assert_allclose(flights[1].deviation, expected, rtol=0.0, atol=1e-9)
    assert [one.seed for one in flights] == [4, 7]
    np.testing.assert_array_equal(arrivals_of_seed(lossy, nominal, 7), flight["arrival"].values)


@pytest.mark.long
def test_what_the_engine_does_not_fly_drake_does_and_keeps(tmp_path: Path) -> None:
    scenario, _ = short()
    lossy = load_scenario(at_burst(scenario, (0.5, 0.3)), ("imu.link.rate=60",))
    flights = fly_point(lossy, [4], tmp_path)
    (file,) = tmp_path.rglob("*.nc")
    before = file.stat().st_mtime_ns
    (again,) = fly_point(lossy, [4], tmp_path)  # read, not flown
    assert file.stat().st_mtime_ns == before
    np.testing.assert_array_equal(flights[0].deviation, again.deviation)


@pytest.mark.long
def test_flown_deviations_are_of_the_predicted_size() -> None:
    # Over six flights the mean squared deviation differs from the predicted one by chance alone: a factor of two.
    scenario, nominal = short()
    lossy = with_rates(scenario, *PAIR)
    tube = predict_tube(lossy, nominal)
    flights = [fly(with_seed(lossy, seed)) for seed in range(11, 17)]
    flown = [flight["truth"].values[:, :3] - flight["reference"].values for flight in flights]
    predicted = np.trace(tube.covariance, axis1=1, axis2=2) + np.sum(tube.mean**2, axis=1)
    late = slice(30, None)
    ratio = np.mean([np.sum(d[late] ** 2, axis=1) for d in flown]) / np.mean(predicted[late])
    assert 0.5 < ratio < 2.0
    inside = np.concatenate([within(Flown(0, d, None), tube.radius) for d in flown])
    assert inside.mean() >= 0.99


def test_interval_of_independent_ticks_is_the_binomial_one() -> None:
    ok = np.random.default_rng(3).random(400) < 0.9
    low, high = interval([np.array([tick]) for tick in ok])
    expected = binom.ppf([0.025, 0.975], 400, ok.mean()) / 400
    np.testing.assert_allclose([low, high], expected, atol=0.006)


def test_worst_stretch_of_lost_flights_is_what_they_flew() -> None:
    whole, lost = np.ones(80, dtype=bool), np.ones(15, dtype=bool)
    lost[10:] = False
    assert worst_stretch([whole, lost], 80) == pytest.approx(10.0 / 15.0)


@pytest.mark.long
def test_the_tube_on_a_plan_is_orange_where_it_leaves_the_corridor() -> None:
    scenario, nominal = short()
    tube = predict_tube(with_rates(scenario, *PAIR), nominal)
    wide = tube.radius > np.median(tube.radius)
    about = Corridor(np.full(len(wide), np.median(tube.radius)), np.ones(len(wide)), np.zeros(len(wide), dtype=int))
    axes = Figure().subplots()
    draw_tube(axes, tube, about)
    for discs, part, color in zip(axes.collections, (~wide, wide), (INSIDE, OUTSIDE), strict=True):
        np.testing.assert_allclose(discs.get_offsets(), tube.r[part][::3, :2])
        np.testing.assert_allclose(discs.get_widths(), 2.0 * tube.radius[part][::3])
        assert same_color(discs.get_facecolor(), color)
    np.testing.assert_array_equal(axes.get_lines()[0].get_xydata(), tube.r[:, :2])
    assert axes.get_legend_handles_labels()[1] == ["planned", "tube in the corridor", "tube beyond it"]


@pytest.mark.long
def test_deviations_are_the_flights_horizontal_ones_and_a_lost_one_ends_in_a_cross() -> None:
    scenario, nominal = short()
    tube = predict_tube(with_rates(scenario, *PAIR), nominal)
    about = corridor(scenario.load_room(), scenario.vehicle, nominal.r)
    axes = Figure().subplots()
    draw_deviations(axes, tube, about, straying(0.9, lost=2.0))
    room, first, second, cross = axes.get_lines()
    np.testing.assert_array_equal(room.get_ydata(), about.radius)
    for line in (first, second):
        np.testing.assert_allclose(line.get_ydata(), 0.9 * tube.radius)
        np.testing.assert_array_equal(line.get_xdata(), tube.time)
    np.testing.assert_allclose(cross.get_ydata(), 0.9 * tube.radius[-1])
    assert axes.get_legend_handles_labels()[1] == ["tube", "corridor", "a flight", "lost"]
    assert axes.get_ylabel() == "deviation [m]"


def test_margins_are_filled_over_their_axes_and_0_is_drawn_for_both_paths() -> None:
    a = np.linspace(0.1, 1.0, 4)
    axes = Figure().subplots()
    fill_margins(axes, MarginMap(a, a, np.add.outer(a, 0.0 * a) - 0.5, np.add.outer(a, 0.0 * a) - 0.7))
    _, whole, guided = axes.collections
    for line, at in ((whole, 0.5), (guided, 0.7)):
        np.testing.assert_allclose(np.vstack([path.vertices for path in line.get_paths()])[:, 0], at)


@pytest.mark.long
def test_what_a_plan_shows_is_named(tmp_path: Path) -> None:
    plan = plan_figure(*short(), {PAIR: straying(0.9, lost=2.0)}, tmp_path / "plan.svg").read_text()
    for named in ("anchor", "landmark", "planned", "3-sigma tube", "a flight", "a lost flight"):
        assert f">{named}</text>" in plan, named
