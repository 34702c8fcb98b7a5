"""Rare events of flights: the engine's branches, plain counting, what is kept, the command."""

import json
import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from command_line import run
from gauss_markov import TICKS, answer, goal_of, highest
from scipy.spatial import cKDTree
from scipy.stats import binom, binomtest, chi
from scipy.stats.contingency import relative_risk

from ortilo_drake.flight.engine import Engine
from ortilo_drake.flight.figures import REFERENCE, TRUE
from ortilo_drake.flight.flight import fly
from ortilo_drake.flight.metrics import path_distance
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import load_scenario, with_seed
from ortilo_drake.studies.rare.estimate import Joined, counted_of
from ortilo_drake.studies.rare.rare_flights import Event, Rare, doubted_corridor, rare_flights
from ortilo_drake.studies.rare.rare_report import APART, MORE, doubt_of, level_apart, rare_text, verdict
from ortilo_drake.studies.rare.subset import AT_ONCE, Climb, Plan, climb, flights_of, plan_climb
from ortilo_drake.studies.rare.under_faults import faults_of, faults_verdict, times_as_often
from ortilo_drake.world.noise import seeds_of_nodes

SHORT = ("world.disturbance.force_density=0.0365",)
SCENARIO = load_scenario("nominal_imu_uwb", SHORT)


@pytest.mark.long
def test_distances_are_those_of_drakes_flight() -> None:
    engine, flight = Engine(SCENARIO), fly(with_seed(SCENARIO, 5))
    found = engine.distances(np.full((1, engine.ticks), 5))[0]
    away = flight["truth"].values[:, :3] - flight["reference"].values[:, :3]
    np.testing.assert_allclose(found[: len(away)], np.linalg.norm(away, axis=1), atol=1e-9)
    from_path = engine.distances(np.full((1, engine.ticks), 5), from_path=True)[0]
    np.testing.assert_allclose(from_path[: len(away)], path_distance(flight), atol=1e-9)


def test_distances_from_the_path_are_those_of_the_nearest_point_at_any_time() -> None:
    """Against SciPy's k-d tree. A vehicle that lags its reference is nearer to the path than to the reference."""
    engine = Engine(SCENARIO)
    rows, _ = engine.trace(5)
    nearest, _ = cKDTree(rows[:, REFERENCE]).query(rows[:, TRUE])
    seeds = np.full((1, engine.ticks), 5)
    from_path = engine.distances(seeds, from_path=True)[0]
    np.testing.assert_allclose(from_path[: len(rows) - 1], nearest[:-1], atol=1e-12)
    off = engine.distances(seeds)[0]
    assert np.all(from_path <= off)
    assert np.max(from_path[np.isfinite(off)]) < np.max(off[np.isfinite(off)])


def test_a_branch_is_the_same_flight_until_it_leaves_and_another_after() -> None:
    engine = Engine(SCENARIO)
    seeds = np.full((2, engine.ticks), 5)
    seeds[1, 100:] = 6
    one, other = engine.distances(seeds)
    assert np.array_equal(one[:101], other[:101])  # what stands at a tick is of the noise before it
    assert not np.any(one[101:] == other[101:])


@pytest.mark.long
def test_subsets_agree_with_counting_and_goes_on_where_it_stopped(tmp_path: Path) -> None:
    corridor = 1.5
    found = rare_flights(SCENARIO, Event(corridor), 100, 4, tmp_path, 1, count=300)
    assert found.counted is not None
    assert found.probability is not None
    assert 0.0 < found.probability < 1.0
    assert (found.independent.flights, found.counted.flights) == (5 * 100 + 300, 300)
    assert found.independent.events >= found.counted.events
    assert found.low < found.counted.high
    assert found.counted.low < found.high
    files = sorted(tmp_path.rglob("*.json"))
    assert len(files) == 6  # with the plan and what was counted
    plan, first, second, *_, counted = files
    assert plan.stem.endswith("plan_0")
    assert first.stem.endswith("repetition_0")
    assert "counted" in counted.stem
    before = counted.stat().st_mtime_ns
    first.write_text("{", encoding="utf-8")  # damaged: flown again
    second.unlink()
    plan.write_text("[1]", encoding="utf-8")
    calls: list[tuple[int, int | None]] = []
    assert rare_flights(SCENARIO, Event(corridor), 100, 4, tmp_path, 2, 300, lambda *c: calls.append(c)) == found
    each = flights_of(len(found.plan.levels), 100)
    assert calls[0] == (AT_ONCE // Engine(SCENARIO).numbers, None)  # how many levels there will be is not known yet
    total = 5 * each + 300
    kept = calls.index((3 * each, None))  # the plan and the two repetitions that are kept of four
    assert calls[kept + 1 :] == [(4 * each, None), *((n, total) for n in (4 * each, 5 * each, total))]  # three decide
    assert counted.stat().st_mtime_ns == before


@pytest.mark.long
def test_what_is_drawn_at_the_start_decides_a_flight() -> None:
    """That the numbers of a seed make its flight is in tests/world/test_given_noise.py."""
    spread = ("truth.vehicle.mass_factor_sd=0.1", "truth.survey.anchors_sd=0.05", "truth.uwb.slow_sd=0.05")
    engine = Engine(load_scenario("nominal_imu_uwb", (*SHORT, *spread)))
    assert engine.drawn["truth/vehicle.mass_factor"] == 1
    numbers = np.random.default_rng(7).standard_normal((2, engine.numbers), dtype=np.float32)
    numbers[1] = numbers[0]
    names, first = list(engine.drawn), engine.numbers - sum(engine.drawn.values())
    before = sum(engine.drawn[name] for name in names[: names.index("truth/vehicle.mass_factor")])
    numbers[1, first + before] += 1.0
    one, heavier = engine.distances_given(numbers)
    assert not np.array_equal(one, heavier)


def test_a_node_of_the_cameras_slow_errors_is_of_its_ticks_seed_in_every_tick_about_it() -> None:
    slow, seeds = np.array([[0.5, 4.0], [0.5, 3.0]]), np.arange(100, 110)
    assert seeds_of_nodes(slow, seeds, 5).tolist() == [[104, 108], [103, 106]]
    assert seeds_of_nodes(slow, seeds, 7).tolist() == [[104, 108], [106, 109]]
    assert seeds_of_nodes(slow, seeds, 9).tolist() == [[108, 109], [109, 109]]  # the flight ends before the node


@pytest.mark.long
def test_a_start_whose_law_is_known(tmp_path: Path) -> None:
    """In a tenth of a second a vehicle that starts off its reference comes no nearer: its distance has a chi law.

    Low in the middle of the room: at the authors' start a fix may be the mirror image above the anchors, of which 2 in
    60,000 such vehicles tumble.
    """
    settings = ("planner={kind: hover, duration: 0.1, point: [8.0, 1.0, 1.0]}", "truth.start.position_sd=0.1")
    goal = 0.1 * float(chi(3).isf(1e-5))
    found = rare_flights(load_scenario("nominal_imu_uwb", settings), Event(goal), 800, 8, tmp_path, 1)
    assert sum(found.drawn.values()) > 0
    assert found.low < 1e-5 < found.high
    assert found.high < 3e-5
    assert found.probability is not None
    assert "What is drawn at the start is moved with the noise" in rare_text(SCENARIO, found)
    assert "start.position (3)" in rare_text(SCENARIO, found)


def test_what_is_not_compiled_is_refused_before_anything_is_kept(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"camera\.kind: rendered"):
        rare_flights(load_scenario("imu_uwb_yolo", ("camera.kind=rendered",)), Event(None), 20, 2, tmp_path, 1)
    assert not list(tmp_path.iterdir())


@pytest.mark.long
def test_the_command_says_how_often(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out, file = tmp_path / "out", tmp_path / "rare.json"
    options = ("--corridor", "0.8", "--paths", "20", "--repetitions", "2", "--count", "20", "--workers", "1")
    assert run("rare", "nominal_imu_uwb", "--set", SHORT[0], *options, "--out", str(out), "--json", str(file)) == 0
    found = json.loads(file.read_text(encoding="utf-8"))
    assert found["corridor"] == 0.8
    assert found["scenario"] == "nominal_imu_uwb"
    assert run("report", str(file)) == run("report", str(out)) == 0
    assert found["verdict"] in file.with_suffix(".html").read_text(encoding="utf-8")
    assert found["verdict"] in (out / "report.html").read_text(encoding="utf-8")
    assert len(found["repetitions"]) == 2
    assert found["counted"]["flights"] == 20
    printed = capsys.readouterr().out
    assert "strays 0.8 m or more from its reference" in printed
    assert "strays 0.8 m" in (out / "rare.md").read_text(encoding="utf-8")


def made(repetitions: list[Climb], probability: float | None = None, events: int = 0) -> Rare:
    plan, counted = Plan((1.0, 2.0), ((0.5, 0.2), (0.2, 0.1)), 40, 0, bool(repetitions)), counted_of(500, events)
    joined = None if probability is None else Joined(probability, (1e-9, 1.0), (0.0, 0.013))
    return Rare(
        Event(None), probability, counted.low, counted.high, joined, 1e-2, plan, repetitions, 80, 160, {}, counted, None
    )


NEVER = [Climb(0.0, (0.1, 0.0), (0.3,), 40, 0)] * 2


@pytest.mark.parametrize("repetitions", [[], NEVER], ids=["stopped early", "repeated"])
def test_what_never_happened_is_bounded_by_counting_in_the_first_line(repetitions: list[Climb]) -> None:
    text = rare_text(SCENARIO, made(repetitions))
    first, *rest = text.splitlines()
    assert first == "# nominal_imu_uwb loses its vehicle: fewer than 0.0076 (95 %), none in 500 flights"
    assert "probability 0" not in text
    assert not re.search(r"\| \d+ \| 0 \|", text)  # of a repetition
    assert any("came to the event" in line or "came to no such flight" in line for line in rest)


def test_what_no_flight_counted_and_few_repetitions_found_is_bounded_in_the_first_line() -> None:
    """The interval's ends are orders of magnitude apart: only the upper one says something."""
    joined = Joined(1.1e-5, (2.8e-19, 1.0), (0.0, 4.8e-4))
    found = replace(made(NEVER, 1.1e-5), low=2.8e-19, high=4.8e-4, joined=joined)
    assert "fewer than one flight in 2,100 loses its vehicle (95 %)" in verdict(SCENARIO, found)


@pytest.mark.parametrize("flights", [20, 500, 10_000])
def test_the_bound_of_what_never_happened_is_above_what_is_exact(flights: int) -> None:
    """Clopper and Pearson's: at that probability none in so many flights has a chance of 5 %."""
    exact = binomtest(0, flights, alternative="less").proportion_ci(0.95, method="exact").high
    assert (1.0 - exact) ** flights == pytest.approx(0.05)
    bound = counted_of(flights, 0)
    assert (bound.events, bound.low) == (0, 0.0)
    assert exact < bound.high < 1.3 * exact
    assert bound.high == pytest.approx(binomtest(0, flights).proportion_ci(0.95, method="wilson").high)


def test_what_counting_alone_found_is_said_as_a_count() -> None:
    text = rare_text(SCENARIO, made([*NEVER, Climb(1e-3, (0.1, 0.1, 0.1), (0.3, 0.3), 40, 0)], events=2))
    first, _, answer, *_ = text.splitlines()
    counted = "by counting: 2 of 500 (95 %: one in 69 to 910)"
    assert first == f"# nominal_imu_uwb: about one flight in 250 loses its vehicle, {counted}"
    assert "a count of the 500 flights whose noise is independent: it happened in 2 of them" in answer
    assert "Of 3 repetitions of subset simulation 1 came to the event, and an estimate of its own needs two" in answer


def test_the_report_says_whose_each_end_is_and_where_a_count_contradicts() -> None:
    found = replace(made(NEVER, 1e-3, events=1), low=1e-4, high=0.013, joined=Joined(1e-3, (1e-4, 0.1), (0.0, 0.013)))
    text = rare_text(SCENARIO, found)
    assert "its lower end is of the repetitions, its upper end of the count" in text
    assert "| a count: 1 of 500 flights | 0.002 | 0 to 0.013 (99 %) |" in text
    assert "hardly agree" not in text
    assert "hardly agree" in rare_text(SCENARIO, replace(found, probability=3e-3))
    apart = replace(found, low=0.02, high=0.03, joined=Joined(1e-3, (1e-4, 0.01), (0.02, 0.03)))
    assert "no probability is in both intervals" in rare_text(SCENARIO, apart)
    unused = replace(apart, probability=None)
    assert "the count contradicts it" in rare_text(SCENARIO, unused)


@pytest.mark.family
@pytest.mark.parametrize(
    ("options", "flown"),
    [(("--paths", "50"), 50), (("--paths", "20", "--count", "40", "--corridor", "5", "--least", "1e-4"), 60)],
)
def test_where_nothing_happens_it_stops_after_one_climb(
    options: tuple[str, ...], flown: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    hover = ("--set", "planner={kind: hover, duration: 0.2}", "--workers", "1")
    file = tmp_path / "rare.json"
    assert run("rare", "nominal_imu_uwb", *hover, *options, "--out", str(tmp_path), "--json", str(file)) == 0
    found, said = json.loads(file.read_text(encoding="utf-8")), capsys.readouterr().out
    assert (found["probability"], found["repetitions"]) == (None, [])
    assert found["high"] == pytest.approx(binomtest(0, flown).proportion_ci(0.95, method="wilson").high)
    assert f"fewer than {found['high']:.2g} (95 %), none in {flown} flights" in said.splitlines()[0]


def test_the_first_line_has_the_interval_and_says_where_there_is_none() -> None:
    found = replace(made([Climb(2e-4, (0.1, 0.1), (0.3,), 40, 0)] * 2, 2.04e-4), low=1.1e-4, high=3.9e-4)
    first = rare_text(SCENARIO, found).splitlines()[0]
    assert first == "# nominal_imu_uwb: about one flight in 4,900 loses its vehicle (95 %: one in 2,600 to 9,100)"
    often = rare_text(SCENARIO, replace(found, probability=0.7, low=0.63, high=0.78)).splitlines()[0]
    assert often == "# nominal_imu_uwb loses its vehicle in about 70% of flights (95 %: 63% to 78%)"
    assert "Of 2 repetitions of subset simulation none came to the event" in rare_text(SCENARIO, made(NEVER))


def test_the_report_names_what_the_distance_is_from() -> None:
    found = replace(made([]), event=Event(0.3, True))
    assert rare_text(SCENARIO, found).startswith("# nominal_imu_uwb strays 0.3 m or more from its path: fewer than")
    assert (found.event.goal, Event(None).goal) == (0.3, np.inf)
    assert len({event.file for event in (Event(0.3), Event(0.3, True), Event(None), Event(None, True))}) == 4


def test_repetitions_that_go_different_ways_are_told() -> None:
    """As a flight that one wrong fix of a single tick throws off: nearly every step of it is taken."""
    one, other = Climb(1e-6, (0.1, 0.1, 0.1), (0.3, 0.3), 40, 0), Climb(1e-4, (0.1, 0.1, 0.1), (0.3, 0.8), 40, 0)
    assert level_apart(made([one, one])) is None
    assert level_apart(made([one, other])) == 2.0
    _, _, doubt, *_ = rare_text(SCENARIO, made([one, other], 1e-4)).splitlines()
    assert "from 2 m on the repetitions go different ways (1e-06 to 0.0001)" in doubt
    assert doubt.endswith("Fly again with --paths 640 and --count 100000.")
    assert doubt_of(made([one, other], 1e-4, events=5)) is None  # a count confirms


def test_acceptances_as_far_apart_as_chance_makes_them_are_no_doubt() -> None:
    """Ten repetitions of 100 paths of one hovering flight, whose answer a count of others confirmed."""
    first = (0.29, 0.48, 0.38, 0.33, 0.36, 0.5, 0.41, 0.32, 0.42, 0.41)
    second = (0.4, 0.47, 0.32, 0.59, 0.41, 0.49, 0.4, 0.4, 0.5, 0.52)
    found = made([Climb(1e-3, (0.1, 0.1, 0.1), both, 40, 0) for both in zip(first, second, strict=True)], 1e-3)
    assert max(second) - min(second) > APART
    assert level_apart(replace(found, paths=100)) is None
    assert level_apart(replace(found, paths=1000)) == 2.0


def test_of_a_wide_interval_the_first_line_has_the_known_bound() -> None:
    found = replace(made([Climb(1.7e-7, (0.1, 0.1), (0.3,), 40, 0)] * 2, 1.7e-7), low=4.5e-10, high=6.2e-5)
    bound = "# nominal_imu_uwb: fewer than one flight in 16,000 loses its vehicle (95 %)"
    assert rare_text(SCENARIO, found).splitlines()[0] == bound + MORE
    often = rare_text(SCENARIO, replace(found, high=0.4)).splitlines()[0]
    assert often == "# nominal_imu_uwb loses its vehicle in fewer than 40% of flights (95 %)" + MORE
    near = replace(found, low=1.7e-8, high=1.6e-6)
    assert "about one flight in 5,900,000 loses its vehicle (95 %: one in 620,000" in verdict(SCENARIO, near)


def test_a_corridor_that_walls_forbid_is_doubted_before_a_flight() -> None:
    """The room is 31 m by 8.9 m by 3 m."""
    (doubt,) = doubted_corridor(SCENARIO, Event(15.0))
    assert doubt.startswith("--corridor: 15 m: in cm? The room is 31 m by 8.9 m by 3 m")
    assert doubted_corridor(SCENARIO, Event(4.0)) == doubted_corridor(SCENARIO, Event(None)) == []


def test_paths_that_make_no_whole_chains_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="paths: 25: must be a multiple of 10"):
        rare_flights(SCENARIO, Event(None), 25, 2, tmp_path, 1)


GUST = "{kind: gust, start: 5.0, end: 10.0, force: [0.0, 2.0, 0.0]}"


def counted(events: int, flights: int) -> Any:
    it = counted_of(flights, events)
    return SimpleNamespace(probability=events / flights or None, low=it.low, high=it.high, independent=it)


@pytest.mark.parametrize(("events", "without"), [(400, 100), (5000, 200), (150, 150)])
def test_of_many_events_the_ratio_has_the_interval_of_a_relative_risk(events: int, without: int) -> None:
    """Of Katz's, which SciPy has, Wilson's ends differ little where events are many."""
    found = times_as_often(counted(events, 10_000), counted(without, 10_000))
    risk = relative_risk(events, 10_000, without, 10_000)
    ends = risk.confidence_interval(0.95)
    assert found.times == pytest.approx(risk.relative_risk)
    assert (found.low, found.high) == pytest.approx((ends.low, ends.high), rel=0.02)


def test_of_what_never_happened_the_ratio_has_a_bound() -> None:
    seen, never = counted(20, 100), counted(0, 400)
    more, less, unknown = times_as_often(seen, never), times_as_often(never, seen), times_as_often(never, never)
    assert (more.times, more.high) == (None, None)
    assert more.low == pytest.approx(seen.low / never.high)
    assert (less.times, less.low) == (None, 0.0)
    assert less.high == pytest.approx(never.high / seen.low)
    assert (unknown.times, unknown.low, unknown.high) == (None, 0.0, None)


def test_of_a_wide_ratio_only_its_known_end_is_told() -> None:
    event = Event(0.15)
    rare: Any = SimpleNamespace(event=event, probability=1.7e-7, low=4.5e-10, high=6.2e-5)
    often: Any = SimpleNamespace(event=event, probability=0.39, low=0.34, high=0.45)
    rare.independent = often.independent = counted_of(400, 0)
    line, own = faults_verdict(load_scenario("imu_uwb"), rare, {"gust": often}), "imu_uwb: fewer than one flight in "
    assert line.startswith(own + "16,000 strays 0.15 m or more from its reference (95 %); with gust 39% of flights, at")
    assert line.endswith(" times as often; more --paths and --repetitions are needed to say more")
    assert line.split("at least ")[1].startswith("6,300 ")
    same = faults_verdict(load_scenario("imu_uwb"), rare, {"gust": rare})
    assert "with gust fewer than one flight in 16,000 (95 %), how much more often is not known; more" in same


def studied(probability: float, seed: int, repetitions: int) -> Any:
    """A study of the Gauss-Markov process by 100 paths."""
    goal = goal_of(probability)
    plan = plan_climb(highest, TICKS, goal, 100, seed)
    found = [climb(highest, TICKS, goal, plan, 100, seed, i) for i in range(repetitions if plan.reached else 0)]
    it = answer(plan, found, 100)
    met = plan.met + sum(one.met for one in found)
    count = counted_of(100 * (1 + len(found)), met)
    return SimpleNamespace(probability=it.probability, low=it.low, high=it.high, independent=count)


@pytest.mark.long
@pytest.mark.parametrize("apart", [0, 1000], ids=["same noise", "noise of their own"])
@pytest.mark.parametrize(("probability", "without"), [(0.3, 1e-2), (2e-2, 1e-3)])
def test_the_ratio_is_in_its_interval_as_often_as_it_says(probability: float, without: float, apart: int) -> None:
    """100 intervals; were they to hold it in 0.93, one in a thousand such counts would be below."""
    held = 0
    for seed in range(100):
        found = times_as_often(studied(probability, seed, 3), studied(without, seed + apart, 3))
        held += found.low <= probability / without <= (np.inf if found.high is None else found.high)
    assert held >= binom.ppf(1e-3 / 4, 100, 0.93)


def test_faults_are_given_in_yaml_by_name_and_as_the_scenarios_own() -> None:
    own = load_scenario("imu_uwb", (("faults", [{"kind": "clock_jump", "start": 3.0, "by": 0.5}]),))
    found = faults_of([GUST, "uwb_stuck", "own"], own)
    assert list(found) == ["gust", "uwb_stuck", "own faults"]
    assert found["gust"][0]["force"] == [0.0, 2.0, 0.0]
    assert (found["uwb_stuck"][0]["sensor"], found["uwb_stuck"][0]["start"]) == ("uwb", 22.0)
    assert found["own faults"][0]["by"] == 0.5
    other = GUST.replace("2.0", "1.0")
    assert list(faults_of([GUST, other], own)) == [GUST, other]
    assert list(faults_of(["own", "{kind: clock_jump, start: 1.0, by: 0.1}"], own)) == ["own faults", "clock_jump"]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("gast", "must be a fault such as .*gust"),
        ("own", "has no faults of its own"),
        ("{start: 5.0}", "must be a fault such as"),
        ("camera_stuck", "concerns a sensor that imu_uwb does not fly"),
        ("{kind: gust", "--fault"),
    ],
)
def test_what_is_no_fault_is_refused(text: str, said: str) -> None:
    with pytest.raises(InputError, match=said):
        faults_of([text], load_scenario("imu_uwb"))


@pytest.mark.long
def test_the_command_sets_flights_with_and_without_a_fault_side_by_side(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    hover = ("nominal_imu_uwb", "--set", "planner={kind: hover, duration: 0.3}", "--workers", "1", "--paths", "20")
    file, fault = tmp_path / "rare.json", "{kind: gust, start: 0.05, force: [0.0, 9.0, 0.0]}"
    options = ("--repetitions", "2", "--corridor", "0.04", "--out", str(tmp_path), "--json", str(file))
    assert run("rare", *hover, *options, "--fault", fault) == 0
    said, found = capsys.readouterr().out, json.loads(file.read_text(encoding="utf-8"))
    (row,) = found["under_faults"]
    assert (row["fault"], found["event"]["corridor"]) == ("gust", 0.04)
    assert row["probability"] > 0.9
    ratio, low, high = (row["times_as_often"][key] for key in ("times", "low", "high"))
    assert ratio == pytest.approx(row["probability"] / found["probability"])
    assert f"{ratio:.2g} times as often ({low:.2g} to {high:.2g}" in said.splitlines()[0]
    assert "| gust | 1" in said
    assert "## no fault" in said
    assert run("report", str(tmp_path)) == run("report", str(file)) == 0
    assert run("rare", *hover, *options, "--fault", "gust") == 2
    assert (
        "begins at 22 s, must be before the flight's end at 2.3 s (its plan and 2 s to settle)"
        in capsys.readouterr().err
    )
    assert run("rare", *hover, *options, "--fault", "{kind: stuck, sensor: camera, start: 0.1}") == 2
    assert "--fault stuck: nominal_imu_uwb: faults.0: stuck: concerns camera" in capsys.readouterr().err
