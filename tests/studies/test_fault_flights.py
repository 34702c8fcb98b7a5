"""The study of faults: its catalogue, its phases and recovery, its report, and a small one flown by the command."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
from command_line import run
from scipy.stats import binomtest, chi2

from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import load_scenario
from ortilo_drake.studies.faults.catalogue import NAMES, Case, catalogue, chosen_names
from ortilo_drake.studies.faults.fault_flights import (
    BIN,
    WITHIN_3_SIGMA,
    Course,
    FaultStudy,
    check_length,
    recovery_time,
    row_of,
)
from ortilo_drake.studies.faults.fault_report import fault_figure, fault_text

PASSING = Case("gust", {}, 10.0, 15.0)
LASTING = Case("clock_jump", {}, 10.0, None)


def made_up(
    seed: int, error: float, bad: dict[range, float], lost: float | None = None, sd: dict[range, float] | None = None
) -> Course:
    """Return a course of 60 s with an error [m] and others in some half seconds, and an sd [m] of 0.01 and others."""
    square = np.full(120, error**2)
    for bins, its in bad.items():
        square[bins] = its**2
    claimed = np.full(120, 0.01**2)
    for bins, its in (sd or {}).items():
        claimed[bins] = its**2
    end = 120 if lost is None else int(lost / BIN)
    return Course(seed, lost, square[:end].tolist(), (square / claimed)[:end].tolist())


def test_phases_are_before_during_and_after() -> None:
    without = [made_up(seed, 0.01, {}) for seed in range(2)]
    flown = [made_up(seed, 0.01, {range(20, 30): 0.05, range(30, 34): 0.03, range(34, 36): 0.02}) for seed in range(2)]
    row = row_of("mine", PASSING, flown, without)
    assert row.before is not None
    assert row.during is not None
    assert row.after is not None
    assert (row.before.ratio, row.during.ratio) == (pytest.approx(1.0), pytest.approx(5.0))
    assert row.during.error == pytest.approx(0.05)
    assert row.during.nees == pytest.approx(25.0)
    assert row.after.error == pytest.approx(0.01 * np.sqrt((84 + 2 * 4) / 86))  # from 17 s on
    assert (row.passed_during, row.passed_after, row.passed) == (False, True, False)  # 5 times, NEES 25
    later = row_of("mine", LASTING, flown, without)
    assert later.during is not None
    assert later.after is not None
    assert later.during.ratio == pytest.approx(np.sqrt((10 * 25 + 4 * 9 + 2 * 4 + 4) / 20))  # 10 s to 20 s
    assert later.after.ratio == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("error", "sd", "passes"),
    [
        (0.3, 0.3 / np.sqrt(1171.0), "no: during"),  # a fault that was passed for what came after it
        (0.3, 0.1, "yes"),  # as far off, and the filter says so: a NEES of 9
        (0.0149, 0.001, "yes"),  # the filter claims too much, but is as good as without the fault
        (0.0151, 0.001, "no: during"),
        (0.0376, 0.01, "yes"),  # sqrt(14.16) = 3.763 standard deviations
        (0.0377, 0.01, "no: during"),
    ],
)
def test_a_fault_is_judged_while_it_lasts_too(error: float, sd: float, passes: str) -> None:
    without, part = [made_up(0, 0.01, {})], range(20, 30)
    row = row_of("mine", PASSING, [made_up(0, 0.01, {part: error}, sd={part: sd})], without)
    assert row.passed_after
    assert row.passed == (passes == "yes")
    text = fault_text(FaultStudy(["mine"], 1, 10.0, 5.0, [0], [row], "engine"))
    assert f" | {passes} |\n" in text
    assert "a mean NEES of at most 14.2" in text


def test_the_edge_of_3_sigma_is_that_of_three_axes() -> None:
    """P(|x| < 3 sigma) of one axis is 0.9973; a chi-square of three degrees of freedom is below 14.16 as often."""
    assert chi2.cdf(WITHIN_3_SIGMA, 3) == pytest.approx(0.9973002039)


def test_lost_flights_fail_and_are_left_out_of_the_errors_with_their_seeds() -> None:
    without = [made_up(0, 0.01, {}), made_up(1, 5.0, {})]
    flown = [made_up(0, 0.01, {}), made_up(1, 9.0, {}, lost=12.0)]
    row = row_of("mine", PASSING, flown, without)
    assert (row.lost, row.passed) == (1, False)
    assert row.during is not None
    assert row.during.ratio == pytest.approx(1.0)
    nothing = row_of("mine", PASSING, flown[1:], without[1:])
    assert (nothing.during, nothing.recovery, nothing.passed) == (None, None, False)


@pytest.mark.parametrize(("error", "shown"), [(0.0149, "1.49"), (0.01502, "1.502"), (0.015, "1.50"), (0.0201, "2.01")])
def test_a_ratio_beside_the_limit_has_the_digits_that_tell_on_which_side_it_is(error: float, shown: str) -> None:
    without, flown = [made_up(0, 0.01, {})], [made_up(0, 0.01, {range(20, 30): error})]
    text = fault_text(FaultStudy(["mine"], 1, 10.0, 5.0, [0], [row_of("mine", PASSING, flown, without)], "engine"))
    assert f"| {shown} | 1.00 |" in text


def test_the_report_says_each_faults_strength_and_what_a_recovery_is_worth() -> None:
    """After 15 s the error is as without the fault until 25 s, then four times as large; NEES is never below 0."""
    case = Case("gust", {"kind": "gust", "force": [0.0, 2.0, 0.0], "start": 10.0}, 10.0, 15.0)
    without = [made_up(seed, 0.01, {}) for seed in range(2)]
    flown = [made_up(seed, 0.01, {range(50, 120): 0.04 * (1 + 9 * seed)}) for seed in range(2)]
    row = row_of("mine", case, flown, without)
    text = fault_text(FaultStudy(["mine"], 2, 10.0, 5.0, [0], [row], "engine"))
    assert "| 0.0, then worse |" in text
    assert "- `gust`: force [0.0, 2.0, 0.0], start 10.0.\n" in text
    assert row.after is not None
    assert row.after.nees_interval is not None
    assert row.after.nees_interval[0] == 0.0


def test_medians_count_lost_flights_as_worst() -> None:
    without = [made_up(seed, 0.01, {}) for seed in range(9)]
    errors = [0.01 * (2 + seed) for seed in range(9)]  # 2 to 10 times
    flown = [made_up(seed, 0.01, {range(20, 30): e}, lost=40.0 if seed < 2 else None) for seed, e in enumerate(errors)]
    row = row_of("mine", PASSING, flown, without)
    share = binomtest(2, 9).proportion_ci(0.95, method="wilson")
    assert row.lost_share == pytest.approx((share.low, share.high))
    assert row.during is not None
    ratios = row.during.ratios
    assert (ratios.kept, ratios.median) == (pytest.approx(7.0), pytest.approx(8.0))  # 4 to 10; two more at the end
    assert ratios.interval == (pytest.approx(5.0), np.inf)  # the second and the eighth of nine
    assert row.during.errors.kept == pytest.approx(0.07)
    assert "| gust | mine | 80 [50, lost]; kept 70 [40, 100] |" in fault_text(
        FaultStudy(["mine"], 9, 10.0, 5.0, [0], [row], "engine")
    )


def test_recovery_is_the_first_five_seconds_that_are_good() -> None:
    calm = np.ones((2, 60))
    flown = calm.copy()
    flown[:, 20:26] = 100.0
    assert recovery_time(flown, calm, 20) == 3.0
    assert recovery_time(calm, calm, 20) == 0.0
    flown[:, 20:] = 100.0
    assert recovery_time(flown, calm, 20) is None


@pytest.mark.family
@pytest.mark.parametrize("name", ["nominal_imu_uwb_yolo", "imu_uwb_yolo", "robust_imu_uwb_yolo", "tight_imu_uwb_yolo"])
def test_the_catalogue_can_be_flown(name: str) -> None:
    plain = load_scenario(name, ("camera.kind=projected",))
    cases = catalogue(plain)
    assert tuple(case.name for case in cases) == NAMES
    for case in cases:
        flown = load_scenario(name, ("camera.kind=projected", ("faults", [case.fault])))
        assert flown.model_copy(update={"faults": ()}) == plain
        assert (flown.faults[0].start, getattr(flown.faults[0], "end", None)) == (case.start, case.end)


def test_without_a_camera_there_are_no_faults_of_it() -> None:
    names = {case.name for case in catalogue(load_scenario("imu_uwb"))}
    assert set(NAMES) - names == {"camera_stuck", "camera_blinded", "landmark_moved", "landmark_gone"}


def test_names_are_chosen_by_a_list_with_commas() -> None:
    assert chosen_names(None) == NAMES
    assert chosen_names("gust, uwb_stuck,gust") == ("gust", "uwb_stuck")
    with pytest.raises(InputError, match=r"--faults 'gusts': is unknown.*gust"):
        chosen_names("gusts")


def test_a_flight_must_be_long_enough_and_faults_begin_at_half_seconds() -> None:
    short = load_scenario("imu_uwb", ("planner={kind: hover, point: [9.0, 0.5, 1.5], duration: 5.0}",))
    with pytest.raises(InputError, match=r"imu_uwb: ends at 7.0 s: with faults from 2 s on it must fly to 12.5 s"):
        check_length(short, 2.0, 5.0)
    with pytest.raises(InputError, match=r"--start 2.2: must be a multiple of 0.5 s"):
        check_length(short, 2.2, 5.0)


@pytest.mark.long
def test_the_report_has_a_row_for_each_fault_and_scenario(tmp_path: Path) -> None:
    without = [made_up(0, 0.01, {})]
    rows = [
        row_of(name, case, flown, without)
        for case, flown in ((PASSING, [made_up(0, 0.02, {})]), (LASTING, [made_up(0, 0.01, {}, lost=11.0)]))
        for name in ("mine", "yours")
    ]
    found = FaultStudy(["mine", "yours"], 1, 10.0, 5.0, [0, 0], rows, "engine")
    text = fault_text(found)
    assert text.startswith(
        "# Faults in flight: mine yours\n\n## In short\n\n- `mine` passes 0 of 2 faults and loses 1 of 2 [9.5, 91 %] "
        "flights, 0 of 1 [0, 79 %] without a fault."
    )
    assert (
        "| gust | mine | 0 of 1 [0, 79 %] | 20 | 20 | 20 | 2.00 | 2.00 | never | 4.0 [?] | 4.0 [?] | no: after |"
        in text
    )
    assert "| gust | mine | 20 [?] | 20 [?] | 2.0 [?] | 2.0 [?] |" in text
    assert "| clock_jump | yours | lost | lost | lost | lost |" in text
    assert "| clock_jump | yours | 1 of 1 [21, 100 %] | - | - | - | - | - | - | - | - | no: lost |" in text
    said = re.findall(r"<text[^>]*>([^<]+)</text>", fault_figure(found, tmp_path / "faults.svg").read_text())
    assert {"gust", "clock_jump", "mine", "yours", "during the fault", "all lost ✗", "2.0 ✓", "2.0 ✗"} <= set(said)
    assert any(line.startswith("Error of the estimated position") for line in said)


@pytest.mark.long
def test_the_command_flies_two_faults_and_goes_on_where_it_stopped(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["faults", "imu_uwb", "--flights", "1", "--faults", "gust,anchor_moved", "--start", "2", "--length", "1"]
    words += ["--set", "planner={kind: hover, point: [9.0, 0.5, 1.5], duration: 12.0}", "--workers", "1"]
    words += ["--out", str(tmp_path), "--json", str(tmp_path / "faults.json")]
    assert run(*words) == 0
    said = capsys.readouterr().out
    found = json.loads((tmp_path / "faults.json").read_text())
    assert [(row["fault"], row["scenario"]) for row in found["rows"]] == [
        ("gust", "imu_uwb"),
        ("anchor_moved", "imu_uwb"),
    ]
    assert all(row["before"]["ratio"] == 1.0 and row["during"]["ratio"] > 1.0 for row in found["rows"])
    assert "| gust | imu_uwb | 0 of 1 [0, 79 %] |" in said
    assert "Made by `ortilo faults imu_uwb" in (tmp_path / "faults.md").read_text()
    files = {file: file.stat().st_mtime_ns for file in tmp_path.rglob("*.kept")}
    assert len(files) == 3
    assert run(*words) == 0
    assert {file: file.stat().st_mtime_ns for file in tmp_path.rglob("*.kept")} == files
    assert run("report", str(tmp_path), "--out", str(tmp_path / "page.html")) == 0
    assert "ortilo faults" in (tmp_path / "page.html").read_text()


def test_the_command_refuses_what_is_wrong_in_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    assert run("faults", "imu_uwb", "imu_uwb") == 2
    assert "must differ by name" in capsys.readouterr().err
    assert run("faults", "--faults", "earthquake") == 2
    assert capsys.readouterr().err.count("\n") == 1
