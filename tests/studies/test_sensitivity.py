"""The study of mismatches: its searches, its settings, its report, and a small one flown."""

import json
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from pathlib import Path

import pytest

from ortilo_drake.model.as_data import as_data
from ortilo_drake.scenario import Scenario, load_scenario
from ortilo_drake.studies.sensitivity import sensitivity_flights
from ortilo_drake.studies.sensitivity.loss_level import NO_LEVEL, Flown
from ortilo_drake.studies.sensitivity.mismatches import (
    TOGETHER,
    Settings,
    all_together,
    known_mismatches,
    mismatches_of,
)
from ortilo_drake.studies.sensitivity.sensitivity_flights import (
    Limit,
    MismatchRow,
    Outcome,
    Sensitivity,
    _row,
    search,
    sensitivity,
)
from ortilo_drake.studies.sensitivity.sensitivity_report import sensitivity_figure, sensitivity_text

MISMATCHES = known_mismatches()
SHORT = ("planner={kind: hover, point: [9.0, 0.5, 1.5], duration: 1.0}", "settle=0.0")


def row_of(mismatch: str, value: float, flights: int, lost: int) -> MismatchRow:
    """Return a row of made-up flights, whose errors are 0.0090, 0.0091, 0.0092 and so on."""
    outcomes = [Outcome(k, k >= flights - lost, dict.fromkeys("xyz", 0.009 + 0.0001 * k), 3.1) for k in range(flights)]
    return _row(mismatch, value, [replace(one, nees=9.0) if one.lost else one for one in outcomes])


def made_up(
    thresholds: dict[str, float], asked: list[list[tuple[Settings, list[int]]]]
) -> Callable[[Sequence[tuple[Settings, Iterable[int]]]], list[list[Outcome]]]:
    """Return a stand-in for flights that are lost above a threshold of the setting, and note what was asked."""

    def fly(wanted: Sequence[tuple[Settings, Iterable[int]]]) -> list[list[Outcome]]:
        known = [(settings, list(seeds)) for settings, seeds in wanted]
        asked.append(known)
        return [
            [Outcome(seed, settings[0][1] > thresholds[settings[0][0]], {}, 3.0) for seed in seeds]
            for settings, seeds in known
        ]

    return fly


@pytest.mark.long
def test_all_searches_share_rounds_and_fly_each_seed_at_one_level() -> None:
    mismatches = [m for m in MISMATCHES if m.name.startswith(("gusts", "range biases"))]
    thresholds = {"truth.force.gust_sd": 0.4, "truth.uwb.bias_sd": 0.1}
    asked: list[list[tuple[Settings, list[int]]]] = []
    given = {m.name: [Flown(m.given[0], 10, 0)] for m in mismatches}
    fly = made_up(thresholds, asked)
    found = search(fly, mismatches, Flown(0.0, 70, 0), given, range(10, 60), lambda _: None)
    for level, threshold in zip(found.values(), (0.4, 10.0), strict=True):
        low, high = level.interval
        assert low is not None
        assert high is not None
        assert 0.5 * threshold < low < 1.01 * threshold < 1.3 * high
        assert high <= 2.0 * low
    for key in thresholds:
        seeds = [seed for batch in asked for settings, flown in batch if settings[0][0] == key for seed in flown]
        assert seeds == sorted(set(seeds))
    assert len(asked[0]) == 2  # both in one round
    assert len(asked) <= 8


@pytest.mark.long
def test_what_is_searched_depends_on_what_was_lost_alone() -> None:
    mismatches = [MISMATCHES[0]]
    asked: list[list[list[tuple[Settings, list[int]]]]] = [[], []]
    given = {mismatches[0].name: [Flown(0.5, 10, 0)]}
    for rounds in asked:
        fly = made_up({"truth.vehicle.mass_factor": 1.1}, rounds)
        search(fly, mismatches, Flown(0.0, 70, 0), given, range(40), lambda _: None)
    assert asked[0] == asked[1]


@pytest.mark.parametrize("mismatch", MISMATCHES, ids=lambda m: m.name)
def test_a_mismatch_changes_the_world_or_its_shapes_and_nothing_else(mismatch) -> None:  # type: ignore[no-untyped-def]
    name = "nominal_imu_uwb_yolo"
    plain = load_scenario(name)
    for value in (*mismatch.given, mismatch.careful, *([mismatch.largest] if mismatch.largest else [])):
        other = load_scenario(name, mismatch.settings(value))
        changed = {key for key in type(plain).model_fields if getattr(plain, key) != getattr(other, key)}
        assert changed == ({"landmark_fix"} if "shapes" in mismatch.name else {"truth"})
    assert value <= (mismatch.largest or value)


def test_without_a_camera_or_a_gyroscope_nothing_is_asked_about_it() -> None:
    without, with_camera = (mismatches_of(load_scenario(name)) for name in ("nominal_imu_uwb", "imu_uwb_yolo"))
    assert {*with_camera} == {*MISMATCHES} == {*mismatches_of(load_scenario("tight_imu_uwb_yolo"))}
    assert {m.name.split()[0] for m in {*with_camera} - {*without}} == {"gyroscope", "landmarks", "only", "camera"}
    settings = dict(all_together(without).settings(2.0))
    assert settings["truth.vehicle.mass_factor"] == pytest.approx(1.06)
    assert len(settings) == len(without)


@pytest.mark.long
def test_a_study_flies_each_mismatch_and_goes_on_where_it_stopped(tmp_path: Path) -> None:
    came: list[int] = []

    def vary(settings: Settings) -> Scenario:
        return load_scenario("nominal_imu_uwb", (*SHORT, *settings))

    found = sensitivity(vary, 2, tmp_path, progress=came.append)
    mismatches = mismatches_of(vary(()))
    assert [row.mismatch for row in found.rows[:1]] == ["none"]
    assert {row.mismatch for row in found.rows[1:]} == {m.name for m in (*mismatches, all_together(mismatches))}
    assert [limit.mismatch for limit in found.limits] == [m.name for m in (*mismatches, all_together(mismatches))]
    assert all(row.flights == 2 for row in found.rows)
    plain = next(row for row in found.rows if row.mismatch == "none")
    heavy = next(row for row in found.rows if row.mismatch.startswith("mass") and row.value == 10.0)
    assert plain.nees is not None
    assert heavy.nees is not None
    assert heavy.nees > plain.nees  # 1 m/s^2 that the filter does not know of
    files = {file: file.stat().st_mtime_ns for file in tmp_path.rglob("*.kept")}
    assert sum(came) >= 2 * len(found.rows)
    assert sensitivity(vary, 2, tmp_path, workers=2) == found
    assert {file: file.stat().st_mtime_ns for file in tmp_path.rglob("*.kept")} == files


def test_the_report_says_what_is_known(tmp_path: Path) -> None:
    mass, force = MISMATCHES[0].name, "force in y [N]"
    found = Sensitivity(
        "nominal_imu_uwb",
        [row_of("none", 0.0, 20, 0), row_of(mass, 10.0, 20, 20), row_of(mass, 2.0, 20, 4)],
        [Limit(mass, 4.2, (3.0, 6.1)), Limit(force, None, (5.0, None)), Limit("yaw of the IMU [deg]", 0.0, (0.0, 0.1))],
        "engine",
    )
    text = sensitivity_text(found)
    assert "| none | 0 | 0 of 20 [0, 16 %] | 0.0099 [0.0095, 0.0104] |" in text
    assert f"| {mass} | 10 | 20 of 20 [84, 100 %] | lost | lost | lost | - | 9.0 |" in text
    # The 6th and the 15th of 20, of which the worst four are lost; the 4th and the 13th of 16.
    assert f"| {mass} | 2 | 4 of 20 [8.1, 42 %] | 0.0099 [0.0095, 0.0104]; kept 0.0097 [0.0093, 0.0102] |" in text
    assert "| 3.100 [3.100, 3.100] | 4.3 |" in text  # (16 3.1 + 4 9) / 20
    assert f"| {mass} | 4.2 | 3 to 6.1 | 3 |" in text
    assert f"| {force} | beyond what was flown | above 5 | 0.1 |" in text
    assert sensitivity_figure(found, tmp_path / "limits.png").stat().st_size > 5000
    assert "No mismatch" not in text
    assert set(json.loads(json.dumps(as_data(found)))) == {"scenario", "rows", "limits", "flown_by"}


def test_the_report_begins_with_what_leaves_the_least_room() -> None:
    named = {m.name.split()[0]: m for m in MISMATCHES}
    mass, force, gusts, yaw = (named[first] for first in ("mass", "force", "gusts", "yaw"))
    found = Sensitivity(
        "nominal_imu_uwb",
        [row_of("none", 0.0, 20, 1), row_of(mass.name, 10.0, 20, 20)],
        [
            Limit(mass.name, 4.2, (3.0, 6.1)),  # 1.4 times a careful team's 3 %
            Limit(force.name, 0.12, (0.1, 0.2)),  # 1.2 times its 0.1 N, though the larger number is the mass's
            Limit(gusts.name, None, (5.0, None)),
            Limit(yaw.name, 0.0, (0.0, 0.1)),
            Limit(TOGETHER, 0.7, (0.5, 0.9)),  # less than any alone, and no single mismatch
        ],
        "engine",
    )
    title, heading, *lines = (line for line in sensitivity_text(found).splitlines() if line)
    assert (title[:2], heading) == ("# ", "## In short")
    assert lines[0] == "- Without any mismatch 1 of 20 [0.89, 24 %] flights are lost."
    assert lines[1] == f"- 5% are lost at less than was flown of: {yaw.name}."
    assert lines[2].startswith(f"- Least room is left by '{force.name}': 5% are lost at 0.12, 1.2 times")
    assert lines[3] == "- 1 of 4 mismatches were not found to lose that many at any value flown."
    assert lines[4] == "- All together lose 5% at 0.7 times what a careful team leaves of each."
    assert not lines[5].startswith("- ")


@pytest.mark.parametrize(
    ("value", "said"),
    [(None, "were not found to lose 5% at any value flown"), (0.0, "lose 5% at less than was flown")],
)
def test_the_summary_says_when_no_limit_of_all_together_is_known(value: float | None, said: str) -> None:
    limits = [Limit(MISMATCHES[0].name, 4.2, (3.0, 6.1)), Limit(TOGETHER, value, (None, None))]
    text = sensitivity_text(Sensitivity("nominal_imu_uwb", [row_of("none", 0.0, 20, 0)], limits, "engine"))
    assert f"- All together {said}." in text


def test_the_report_says_in_a_sentence_that_all_is_lost_without_mismatch(tmp_path: Path) -> None:
    found = Sensitivity(
        "nominal_imu_uwb",
        [row_of("none", 0.0, 10, 10), row_of(MISMATCHES[0].name, 10.0, 10, 10)],
        [Limit(m.name, *NO_LEVEL) for m in MISMATCHES if m.largest],
        "engine",
    )
    text = sensitivity_text(found)
    assert text.count("More than 5% of the flights are lost without any mismatch") == 1
    assert text.index("More than 5%") < text.index("| none |")
    assert "| 95 % interval |" not in text
    assert sensitivity_figure(found, tmp_path / "limits.png").stat().st_size > 5000


def test_the_report_says_in_a_sentence_that_nothing_in_range_loses_flights(tmp_path: Path) -> None:
    limits = [Limit(m.name, None, (m.largest / 1.2, None)) for m in MISMATCHES if m.largest]
    found = Sensitivity("nominal_imu_uwb", [row_of("none", 0.0, 10, 0)], limits, "engine")
    text = sensitivity_text(found)
    assert "No mismatch was found to lose 5% of the flights at any value up to the largest flown." in text
    assert text.count("beyond what was flown") == len(limits)
    assert sensitivity_figure(found, tmp_path / "limits.png").stat().st_size > 5000


def lost_flights(wanted: Sequence[tuple[Scenario, Iterable[int]]], *_: object, **__: object) -> list[list[Outcome]]:
    """Stand in for fly_outcomes: every flight is lost."""
    return [[Outcome(seed, True, {"x": 1.0, "y": 1.0, "z": 1.0}, 9.0) for seed in seeds] for _, seeds in wanted]


def test_a_filter_that_loses_everything_has_no_limits(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sensitivity_flights, "fly_outcomes", lost_flights)
    said: list[str] = []
    found = sensitivity(lambda settings: load_scenario("nominal_imu_uwb", settings), 10, tmp_path, say=said.append)
    assert all(row.lost == 10 and row.mse["x"].median == float("inf") for row in found.rows)
    assert all(limit.value == 0.0 for limit in found.limits)
    assert not any("search" in part for part in said)
