"""The study of mismatches: its ladder, its settings, and a small one flown."""

import json
from pathlib import Path

import pytest

from ortilo_drake.model.as_data import as_data
from ortilo_drake.scenario import Scenario, load_scenario
from ortilo_drake.studies.sensitivity.mismatches import MISMATCHES, Settings, all_together, mismatches_of
from ortilo_drake.studies.sensitivity.sensitivity_flights import Limit, Row, Sensitivity, climb, sensitivity
from ortilo_drake.studies.sensitivity.sensitivity_report import sensitivity_figure, sensitivity_text

SHORT = ("planner={kind: hover, point: [9.0, 0.5, 1.5], duration: 1.0}", "settle=0.0")


@pytest.mark.parametrize("threshold", [0.02, 0.7, 1.0, 3.3, 40.0, 1e9])
def test_the_ladder_brackets_the_limit(threshold: float) -> None:
    flown: dict[float, int] = {}

    def lost_at(value: float) -> int:
        flown[value] = 0 if value <= threshold else 20
        return flown[value]

    climb(lost_at, 1.0, 64.0, 20)
    below, above = [v for v, lost in flown.items() if not lost], [v for v, lost in flown.items() if lost]
    if threshold > 64.0:
        assert not above
        assert max(below) == 64.0
    elif threshold < 1.0 / 32.0:
        assert not below
        assert min(above) == 1.0 / 32.0
    else:
        assert min(above) <= 2.0 * max(below)  # at most a step between, and its middle was flown
        assert len(flown) <= 9


@pytest.mark.parametrize("mismatch", MISMATCHES, ids=lambda m: m.name)
def test_a_mismatch_changes_the_world_or_its_shapes_and_nothing_else(mismatch) -> None:  # type: ignore[no-untyped-def]
    name = "nominal_imu_uwb_yolo" if mismatch.sensor == "camera" else "nominal_imu_uwb"
    plain = load_scenario(name)
    for value in (*mismatch.given, mismatch.careful, *([mismatch.largest] if mismatch.largest else [])):
        other = load_scenario(name, mismatch.settings(value))
        changed = {key for key in type(plain).model_fields if getattr(plain, key) != getattr(other, key)}
        assert changed == ({"landmark_fix"} if "shapes" in mismatch.name else {"truth"})
    assert value <= (mismatch.largest or value)


def test_without_a_camera_nothing_is_asked_about_it() -> None:
    without, with_camera = (mismatches_of(load_scenario(name)) for name in ("nominal_imu_uwb", "nominal_imu_uwb_yolo"))
    assert {m.sensor for m in without} == {None, "uwb"}
    assert with_camera == MISMATCHES
    settings = dict(all_together(without).settings(2.0))
    assert settings["truth.vehicle.mass_factor"] == pytest.approx(1.06)
    assert len(settings) == len(without)


@pytest.mark.long
def test_a_study_flies_each_mismatch_and_goes_on_where_it_stopped(tmp_path: Path) -> None:
    came: list[int] = []

    def vary(settings: Settings) -> Scenario:
        return load_scenario("nominal_imu_uwb", (*SHORT, *settings))

    found = sensitivity(vary, range(2), tmp_path, progress=came.append)
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
    files = {file: file.stat().st_mtime_ns for file in tmp_path.rglob("*.jsonl")}
    assert sum(came) >= 2 * len(files)
    assert sensitivity(vary, range(2), tmp_path) == found
    assert {file: file.stat().st_mtime_ns for file in tmp_path.rglob("*.jsonl")} == files


def test_the_report_says_what_is_known(tmp_path: Path) -> None:
    mass, force = MISMATCHES[0].name, "force in y [N]"
    found = Sensitivity(
        "nominal_imu_uwb",
        [Row("none", 0.0, 20, 0, {"x": 0.01, "y": 0.02, "z": 0.03}, 3.1), Row(mass, 10.0, 20, 20, None, None)],
        [Limit(mass, 4.2, (3.0, 6.1)), Limit(force, None, (5.0, None)), Limit("yaw of the IMU [deg]", 0.0, (0.0, 0.1))],
    )
    text = sensitivity_text(found)
    assert f"| {mass} | 10 | 20 of 20 | - | - | - | - |" in text
    assert f"| {mass} | 4.2 | 3 to 6.1 | 3 |" in text
    assert f"| {force} | beyond what was flown | 5 to ? | 0.1 |" in text
    assert sensitivity_figure(found, tmp_path / "limits.png").stat().st_size > 5000
    assert set(json.loads(json.dumps(as_data(found)))) == {"scenario", "rows", "limits"}
