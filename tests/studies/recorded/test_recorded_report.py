"""The report and picture of recorded motions: what they say of claims, and how far an axis of errors reaches."""

from dataclasses import replace

import numpy as np
import pytest

from ortilo_drake.studies.recorded.filtered import Estimate
from ortilo_drake.studies.recorded.reacquired import Innovations, Lost
from ortilo_drake.studies.recorded.recorded_figure import error_limit, motion_figure
from ortilo_drake.studies.recorded.recorded_report import lost_line, overconfident, replay_summary, report_text
from ortilo_drake.studies.recorded.replayed import CV, CV_RAW, RAW, SMOOTH, WITH_IMU, Replayed
from ortilo_drake.studies.recorded.scores import Scores, score


def test_an_outage_does_not_stretch_an_axis_of_errors() -> None:
    usable = np.arange(1000) < 800
    band = np.where(usable, 0.1, 30.0)
    error = np.where(usable, 0.02, 5.0)
    assert error_limit(usable, band, error) == pytest.approx(1.2 * 0.1)
    assert error_limit(usable, band, np.where(usable, 0.2, 5.0)) == pytest.approx(1.2 * 0.2)  # errors beyond the band
    never = np.zeros(9, dtype=bool)
    assert error_limit(never, np.full(9, 30.0), np.zeros(9)) == pytest.approx(1.2 * 30.0)


def row(nees: float | None, **others) -> Scores:
    return Scores((0.1, 0.1, 0.1), 0.1, None, None, nees, 1.0, 0.0, 1.0, **others)


def test_every_row_that_claims_far_too_little_is_named() -> None:
    rows = {WITH_IMU: row(5.0), SMOOTH: row(27.0), RAW: row(33.5), CV: row(12.1)}
    smoother, raw, cv = overconfident(rows)
    assert smoother.startswith("with IMU, smoothed: NEES is 27, not 3: its errors are 3.0 times what it claims")
    assert raw.startswith(f"{RAW}: NEES is 34, not 3: its errors are 3.3 times")
    assert "what nobody calibrated" in raw
    assert "baseline_range" in cv
    assert overconfident({"a": row(None)}) == []


def test_a_loss_without_ranges_is_told_from_one_with_them() -> None:
    lost = (Lost(6.5, 17.9), Lost(20.0, 30.0), Lost(40.0, 42.0), Lost(50.0, None))
    said = lost_line(row(3.0, lost=lost, silent=(11.4, 7.0, 0.1, 0.2))).split("; ")
    assert said[:4] == [
        "lost from 6.5 s, found again at 17.9 s (the recording has no ranges in between)",
        "lost from 20.0 s, found again at 30.0 s (no ranges for 7.0 s of it)",
        "lost from 40.0 s, found again at 42.0 s",
        "lost from 50.0 s, not found again",
    ]


def test_rows_lost_at_the_same_times_share_a_line_and_equal_errors_are_said_once() -> None:
    lost = {"lost": (Lost(6.6, 19.0),), "silent": (12.4,)}
    same, other = row(3.0, rmse_found=(0.1, 0.1, 0.1), **lost), row(3.0, rmse_found=(0.1, 0.1, 0.05), **lost)
    rows = {CV: other, WITH_IMU: same, SMOOTH: same, RAW: row(3.0, lost=(Lost(50.0, None),), silent=(0.2,))}
    found = Replayed(name="log", rows=rows, anchors=(), judged_from=0.0, rejected={}, notes=[])
    text = report_text([found], 0.3)
    when = "lost from 6.6 s, found again at 19.0 s (the recording has no ranges in between)"
    together = "constant velocity (at other times 0.100, 0.100, 0.050 m); with IMU; with IMU, smoothed."
    assert f"- {when}: {together}" in text
    assert "- lost from 50.0 s, not found again: with IMU, not calibrated (biases online)." in text
    assert f"- log: {when} (with IMU)." in text
    assert text.count(when) == 2


def test_columns_that_no_row_has_are_left_out() -> None:
    rows = {RAW: Scores(*[None] * 5, 1.0, 0.0, 1.0)}
    found = Replayed(name="log", rows=rows, anchors=(), judged_from=0.0, rejected={}, notes=[])
    assert "\n|  | NIS | rejected | available |\n" in report_text([found], 0.3)


@pytest.mark.parametrize(("truth", "panels"), [(True, 7), (False, 4)])
def test_the_picture_has_errors_and_a_grey_part_only_with_truth(tmp_path, drawn_figures, truth, panels) -> None:
    """Seven panels: two of the path, three of errors, NIS, deviations."""
    t = np.arange(0.0, 20.0, 0.1)
    run = Innovations(np.ones(len(t)), np.ones(len(t)), np.ones(len(t), dtype=bool))
    one = Estimate(t, np.zeros((len(t), 3)), np.tile(0.01 * np.eye(3), (len(t), 1, 1)), np.zeros((0, 3, 3)), run, t, [])
    found = Replayed(
        name="log",
        rows={RAW: row(None)},
        anchors=((0.0, 0.0, 0.0), (1.0, 1.0, 1.0)),
        judged_from=np.float64(6.0),  # as a replay has it
        rejected={},
        notes=[],
        offset=0.0 if truth else None,
    )
    motion_figure(found, {RAW: (one, one.p if truth else None)}, 0.3, tmp_path / "log.png")
    axes = drawn_figures[0].axes
    assert len(axes) == panels
    assert sum(one.get_ylabel().startswith("error") for one in axes) == 3 * truth
    assert ("grey" in drawn_figures[0].get_suptitle()) == truth


def test_the_summary_tells_the_largest_error_and_what_losses_did() -> None:
    rows = {
        WITH_IMU: row(3.0, largest=(0.62, 62.4, 6.1)),
        CV: row(3.0),
        f"{WITH_IMU}, 50% of the ranges lost": row(3.0),
    }
    rows[f"{WITH_IMU}, 50% of the ranges lost"] = replace(rows[CV], ate=0.097)
    found = Replayed(name="log", rows=rows, anchors=(), judged_from=0.0, rejected={}, notes=[])
    said = "\n".join(replay_summary([found], 0.3))
    assert "log: largest error 0.62 m at 62.4 s, 6.1 s after the last range (with IMU, after the first 30%)." in said
    assert "log: 3% less error, by chance: these are one draw of losses" in said


def test_a_score_tells_ranges_that_did_not_come() -> None:
    t, stamps = np.arange(0.0, 60.0, 0.5), np.concatenate([np.arange(0.0, 10.1, 0.5), np.arange(20.0, 60.0, 0.5)])
    p = np.zeros((len(t), 3))
    truth = p + 0.01 * np.sin(t)[:, None]
    truth[t == 19.5] += 3.0
    ones = np.ones(len(stamps))
    run = Innovations(0.0 * ones, ones, ones > 0.0)
    P, R = np.tile(np.eye(3), (2, len(t), 1, 1))
    lost = [Lost(10.0, 20.0), Lost(30.0, 32.0)]
    found = score(Estimate(t, p, P, R, run, stamps, lost), t > 5.0, truth, 0.3)
    assert found.silent == (10.0, 0.5)
    assert found.largest == pytest.approx((np.sqrt(3.0) * (3.0 + 0.01 * np.sin(19.5)), 19.5, 9.5))


def test_without_a_truth_the_filter_with_imu_is_summed_up() -> None:
    rows = {CV_RAW: replace(row(None), rmse=None, nis=0.64), RAW: replace(row(None), rmse=None, nis=1.02)}
    said = "\n".join(
        replay_summary([Replayed(name="log", rows=rows, anchors=(), judged_from=0.0, rejected={}, notes=[])], 0.3)
    )
    assert "log: no truth; NIS 1.02" in said
    assert "the noise under `filter`" not in said
    rows = {CV_RAW: replace(rows[CV_RAW], innovation=0.05), RAW: replace(rows[RAW], nis=1.9, innovation=0.05)}
    found = Replayed(name="log", rows=rows, anchors=(), judged_from=0.0, rejected={}, notes=[])
    assert "NIS is 1.9, not 1: the noise under `filter` is too small" in "\n".join(replay_summary([found], 0.3))
