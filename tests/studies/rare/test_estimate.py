"""The intervals of rare events against the law of a Gauss-Markov process; announced flights against flown ones."""

from pathlib import Path

import numpy as np
import pytest
from gauss_markov import TICKS, answer, goal_of, highest
from scipy.stats import binom, binomtest, norm, t

from ortilo_drake.scenario import load_scenario
from ortilo_drake.studies.rare import rare_flights as study
from ortilo_drake.studies.rare.estimate import OF_COUNT, OF_REPETITIONS, log_interval
from ortilo_drake.studies.rare.rare_report import rare_text, verdict
from ortilo_drake.studies.rare.subset import Climb, Plan, climb, plan_climb

SCENARIO = load_scenario("nominal_imu_uwb")


def test_the_law_is_what_counting_finds() -> None:
    z = np.random.default_rng(0).standard_normal((40_000, TICKS))
    events = int(np.sum(highest(z) >= goal_of(0.05)))
    assert binomtest(events, len(z), 0.05).pvalue > 1e-3


def held(probability: float, paths: int, repetitions: int, intervals: int, counted: int = 0) -> int:
    """In how many of so many studies the interval holds the probability."""
    count, goal = 0, goal_of(probability)
    for seed in range(intervals):
        plan = plan_climb(highest, TICKS, goal, paths, seed)
        found = [climb(highest, TICKS, goal, plan, paths, seed, i) for i in range(repetitions if plan.reached else 0)]
        z = np.random.default_rng((seed, 10**6)).standard_normal((counted, TICKS))
        it = answer(plan, found, paths, counted, int(np.sum(highest(z) >= goal)))
        count += it.low <= probability <= it.high
    return count


@pytest.mark.long
@pytest.mark.parametrize("repetitions", [3, 10])
@pytest.mark.parametrize("counted", [0, 1000])
@pytest.mark.parametrize("probability", [0.5, 0.1, 0.03, 1e-3])
def test_the_interval_holds_the_probability_as_often_as_it_says(
    probability: float, counted: int, repetitions: int
) -> None:
    """100 intervals; were they to hold it in 0.93, one in a thousand such counts would be below."""
    assert held(probability, 100, repetitions, 100, counted) >= binom.ppf(1e-3 / 16, 100, 0.93)


@pytest.mark.family
@pytest.mark.parametrize("repetitions", [3, 10])
@pytest.mark.parametrize("probability", [0.5, 0.02])
def test_few_intervals_hold_the_probability(probability: float, repetitions: int) -> None:
    assert held(probability, 50, repetitions, 12) >= binom.ppf(1e-3, 12, 0.93)


@pytest.mark.parametrize("shares", [(0.49, 0.50, 0.50), (0.50, 0.50, 0.50)])
def test_an_event_without_levels_is_counted_however_alike_repetitions_are(shares: tuple[float, ...]) -> None:
    """Three shares that agree by chance say no more than their 300 flights: Wilson's interval."""
    plan = Plan((), (), 100, 40, True)
    found = [Climb(share, (share,), (), 100, round(100 * share)) for share in shares]
    events = round(100 * sum(shares))
    it = answer(plan, found, 100)
    assert it.probability == pytest.approx(events / 300)
    assert (ends := (it.low, it.high)) == pytest.approx(tuple(binomtest(events, 300).proportion_ci(method="wilson")))
    assert ends[1] - ends[0] > 0.1
    it = answer(plan, found, 100, 200, 106)
    assert it.probability == pytest.approx((events + 106) / 500)
    assert (it.low, it.high) == pytest.approx(tuple(binomtest(events + 106, 500).proportion_ci(method="wilson")))


def test_repetitions_that_agree_by_chance_are_as_uncertain_as_their_flights() -> None:
    """Two of 100 paths through shares of 0.1, 0.1 and 0.2: not +-15 %, as two alike estimates have."""
    plan = Plan((1.0, 2.0), ((0.5, 0.5), (0.5, 0.5)), 280, 0, True)
    found = [Climb(p, (0.1, 0.1, 0.2), (0.4, 0.4), 280, 0) for p in (1.99e-3, 2.01e-3)]
    it = answer(plan, found, 100)
    assert it.joined is not None
    low, high = it.joined.by_repetitions
    sd = np.sqrt((9.0 + 9.0 + 4.0) / 100 / 2)
    assert it.probability == pytest.approx(2e-3)
    assert np.log(high / 2e-3) == pytest.approx(np.log(2e-3 / low))
    assert np.log(high / 2e-3) >= 1.95 * sd


LEVELS = Plan((1.0, 2.0), ((0.5, 0.5), (0.5, 0.5)), 280, 0, True)
APART = [Climb(p, (0.1, 0.1, 100.0 * p), (0.4, 0.4), 280, 0) for p in (5e-4, 2e-4, 2e-3)]


@pytest.mark.parametrize(("counted", "events"), [(0, 0), (2000, 0), (2000, 3), (30_000, 20), (100_000, 1), (500, 200)])
def test_the_answer_is_what_the_repetitions_and_a_count_both_allow(counted: int, events: int) -> None:
    """Their confidences, less 1, add up to the answer's: Clopper and Pearson's 99 %, and 96 % of the repetitions'."""
    assert pytest.approx(0.05) == (1.0 - OF_COUNT) + (1.0 - OF_REPETITIONS)
    it = answer(LEVELS, APART, 100, counted, events)
    assert it.joined is not None
    assert it.joined.mean == pytest.approx(9e-4)
    exact = binomtest(events, 400 + counted).proportion_ci(0.99, method="exact")
    assert it.joined.by_count == pytest.approx((exact.low, exact.high))
    lows, highs = zip(it.joined.by_repetitions, it.joined.by_count, strict=True)
    assert it.joined.agree == (max(lows) <= min(highs))
    assert (it.low, it.high) == ((max(lows), min(highs)) if it.joined.agree else it.joined.by_count)
    assert it.probability is not None
    assert it.low <= it.probability <= it.high
    assert it.joined.agree == (events < 200)


def test_the_figure_is_of_what_says_more() -> None:
    """Twenty of 30,000 flights say more than three repetitions apart by ten; none of 2,000 says less."""
    assert answer(LEVELS, APART, 100, 30_000, 20).probability == pytest.approx(20 / 30_400)
    assert answer(LEVELS, APART, 100, 2000, 0).probability == pytest.approx(9e-4)


def test_repetitions_that_a_count_without_an_event_contradicts_are_not_used() -> None:
    alike = [Climb(p, (0.1, 0.1, 0.5), (0.4, 0.4), 280, 0) for p in (4.9e-3, 5e-3, 5.1e-3)]
    it = answer(LEVELS, alike, 100, 1_000_000, 0)
    assert it.joined is not None
    assert not it.joined.agree
    assert (it.probability, it.low) == (None, 0.0)
    assert it.high == pytest.approx(1.0 - 0.005 ** (1 / 1_000_400))


def flown(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, goal: float, repetitions: int = 3, **more: int
) -> tuple[study.Rare, list[tuple[int, int | None]]]:
    """A study of the process in place of flights, and what it told of its progress."""

    class Process:
        numbers, ticks, drawn = TICKS, TICKS, dict[str, int]()

        def distances_given(self, z: np.ndarray, from_path: bool) -> np.ndarray:
            return highest(z)[:, np.newaxis]

        def distances(self, seeds: np.ndarray, from_path: bool) -> np.ndarray:
            return highest(np.random.default_rng(int(seeds[0, 0])).standard_normal((len(seeds), TICKS)))[:, np.newaxis]

    process, told = Process(), list[tuple[int, int | None]]()
    monkeypatch.setattr(study, "_engine_of", lambda text: process)
    found = study.rare_flights(
        SCENARIO, study.Event(goal), 100, repetitions, tmp_path, 1, progress=lambda *now: told.append(now), **more
    )
    return found, told


@pytest.mark.parametrize(
    ("probability", "more"), [(0.5, {}), (0.5, {"count": 40}), (1e-2, {}), (1e-12, {"least": 1e-3})]
)
def test_the_flights_announced_last_are_those_that_flew(
    probability: float, more: dict[str, int], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    found, told = flown(monkeypatch, tmp_path, goal_of(probability) if probability > 1e-9 else 8.0, **more)
    assert told[-1] == (found.flights + more.get("count", 0),) * 2
    assert all(total is None or done <= total for done, total in told)


def test_repetitions_that_end_early_lower_the_flights_announced(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Levels of a plan that the repetitions do not reach: each flies its first 100 alone."""
    plan = Plan((7.0, 7.5), ((0.5, 0.5), (0.5, 0.5)), 280, 0, True)
    monkeypatch.setattr(study, "plan_climb", lambda *rest: plan)
    found, told = flown(monkeypatch, tmp_path, 8.0)
    assert found.flights == 280 + 3 * 100
    assert told[0] == (280, 280 + 3 * 280)
    assert told[-1] == (580, 580)
    again, told = flown(monkeypatch, tmp_path, 8.0)  # of what is kept
    assert (again, told[-1]) == (found, (580, 580))


def test_where_the_first_repetitions_find_nothing_no_more_fly(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """None of 400 independent flights: their Wilson interval is the answer. Only then it is known how many fly."""
    plan = Plan((7.0, 7.5), ((0.5, 0.5), (0.5, 0.5)), 280, 0, True)
    monkeypatch.setattr(study, "plan_climb", lambda *rest: plan)
    found, told = flown(monkeypatch, tmp_path, 8.0, repetitions=10)
    assert [total for _, total in told] == [None] * 4 + [580]
    assert (found.flights, told[-1]) == (280 + study.TRIED * 100, (580, 580))
    assert found.high == pytest.approx(binomtest(0, 400).proportion_ci(method="wilson").high)
    assert "fewer than 0.0095 (95 %), none in 400 flights" in verdict(SCENARIO, found)


def test_a_frequent_event_is_reported_as_counted(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    found, _ = flown(monkeypatch, tmp_path, goal_of(0.5))
    assert found.probability is not None
    low, high = binomtest(round(300 * found.probability), 300).proportion_ci(method="wilson")
    assert (found.low, found.high) == pytest.approx((low, high))
    assert verdict(SCENARIO, found).endswith(f"of flights (95 %: {low:.0%} to {high:.0%})")
    assert "by counting" in rare_text(SCENARIO, found)
    assert "repetitions of subset simulation" not in rare_text(SCENARIO, found)


@pytest.mark.family
@pytest.mark.parametrize("spread", [0.3, 1.0, 1.5])
@pytest.mark.parametrize("n", [10, 30])
def test_of_lognormal_numbers_it_holds_the_mean_as_often_as_it_says(spread: float, n: int) -> None:
    """2000 intervals; one in a thousand of such counts would be below that of 0.92 or above that of 0.98."""
    random, exact, held = np.random.default_rng(1), np.exp(spread**2 / 2.0), 0
    for _ in range(2000):
        low, high = log_interval(1e-3 * np.exp(spread * random.standard_normal(n)), 0.95) or (0.0, 0.0)
        held += low <= 1e-3 * exact <= high
    assert binom.ppf(1e-3, 2000, 0.92) <= held <= binom.ppf(0.999, 2000, 0.98)


def test_of_numbers_that_scatter_little_it_is_students() -> None:
    estimates = 1e-3 * (1.0 + 1e-3 * norm.ppf(np.linspace(0.1, 0.9, 9)))
    low, high = log_interval(estimates, 0.95) or (0.0, 0.0)
    half = t.ppf(0.975, 8) * estimates.std(ddof=1) / 3.0
    assert (low, high) == pytest.approx((estimates.mean() - half, estimates.mean() + half), rel=1e-5)


def test_it_lies_about_the_mean_in_any_unit_and_widens_with_zeros() -> None:
    estimates = np.array([1.0, 3.0, 0.5, 2.0, 1.5])
    low, high = log_interval(1e-3 * estimates, 0.95) or (0.0, 0.0)
    assert np.sqrt(low * high) == pytest.approx(1.6e-3)
    tiny = log_interval(1e-9 * estimates, 0.95) or (0.0, 0.0)
    assert np.array(tiny) == pytest.approx(1e-6 * np.array([low, high]))
    with_zeros = log_interval(1e-3 * np.append(estimates, [0.0, 0.0]), 0.95) or (1.0, 1.0)
    assert with_zeros[1] / with_zeros[0] > high / low


def test_without_two_above_zero_there_is_none_and_none_goes_beyond_one() -> None:
    assert log_interval(np.array([0.0, 1e-6, 0.0]), 0.95) is None
    assert log_interval(np.zeros(3), 0.95) is None
    _, high = log_interval(np.array([0.5, 1.0]), 0.95) or (0.0, 0.0)
    assert high == 1.0
