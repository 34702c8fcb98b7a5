"""Tuned noise judged where it was not fitted: intervals beside SciPy's, verdicts on noise that is known."""

from types import SimpleNamespace

import numpy as np
import pytest
from made_up_motion import TABLE_MAP, as_map, made_up, write_tables
from scipy.stats import ttest_1samp

from ortilo_drake.interop.log.logged_map import LEAST
from ortilo_drake.interop.recorded.map_file import FilterSettings
from ortilo_drake.interop.recorded.recording import read_recording
from ortilo_drake.studies.recorded import held_out
from ortilo_drake.studies.recorded.fit_noise import LIMITS, Fitted, fitted_lines, verdict_line
from ortilo_drake.studies.recorded.held_out import Gain, HeldOut, gain_of, judge, parts_of


@pytest.mark.parametrize("level", [0.95, 1.0 - 0.05 / 3.0])
def test_a_gains_interval_is_students(level) -> None:
    rng = np.random.default_rng(1)
    before, after = rng.normal(size=(2, 20)) + [[0.0], [0.5]]
    gain = gain_of([before[:8], before[8:]], [after[:8], after[8:]], level)
    interval = ttest_1samp(after - before, 0.0).confidence_interval(level)
    middle = gain.after - gain.before
    np.testing.assert_allclose([middle - gain.half, middle + gain.half], 20.0 * np.array(interval), rtol=1e-12)
    assert gain.sign == int(interval.low > 0.0) - int(interval.high < 0.0)


@pytest.mark.parametrize(
    ("gains", "verdict", "said"),
    [
        ([(0.0, 5.0, 6.0), (0.0, -1.0, 2.0)], "the same", "no better there, the same within its uncertainty: keep"),
        ([(0.0, 5.0, 3.0), (0.0, -1.0, 2.0)], "better", "is better there (likelihood of the ranges): use it"),
        ([(0.0, 2.0, 3.0), (0.0, -3.0, 2.0)], "worse", "is worse there (position error): keep the map that you had"),
        ([(0.0, 5.0, 3.0), (0.0, -3.0, 2.0)], "mixed", "worse there in one respect (position error), better in anoth"),
    ],
)
def test_a_gain_within_its_interval_is_none(gains, verdict, said) -> None:
    held = dict(zip(("innovations", "accuracy"), (Gain(*gain) for gain in gains), strict=True))
    judged = HeldOut(10.0, held, (1.0, 1.0), None, None)
    assert judged.verdict == verdict
    assert said in verdict_line(SimpleNamespace(judged=judged, verdict=verdict))


def _better(judged: HeldOut) -> SimpleNamespace:
    return SimpleNamespace(judged=judged, verdict="better")


def test_noise_that_is_better_and_claims_too_much_is_told() -> None:
    """NEES of 12 is that of errors twice as large as claimed."""
    gains = {"innovations": Gain(0.0, 5.0, 3.0)}
    said = verdict_line(_better(HeldOut(10.0, gains, (0.9, 1.0), (3.0, 12.0), ((0.1,) * 3,) * 2)))
    assert said.endswith("use it; but NEES rises to 12.0: errors are 2.0 times what its standard deviations claim")
    said = verdict_line(_better(HeldOut(10.0, gains, (0.9, 1.0), (12.0, 4.0), ((0.1,) * 3,) * 2)))
    assert said.endswith("use it")


def test_what_makes_a_fit_doubtful_is_said() -> None:
    """The 95 % point of chi-squared with 4 degrees of freedom is 9.488 in every table."""
    judged = HeldOut(52.0, {"innovations": Gain(11100.0, 11140.0, 94.0)}, (0.84, 0.96), None, None)
    limits = {"acceleration": (5e-4, 10.0), "range_white": (5e-4, 1.0)}
    settings = FilterSettings(acceleration=5e-4, range_white=1.0)
    fitted = Fitted(settings, 2052.4, 2057.1, 339, "innovations", ("log",), limits, 1320, 22.3, 11.4, judged)
    said = fitted_lines(fitted)
    assert "4 numbers gain 4.7 by chance" in said[0]
    assert "acceleration: 0.0005 is at the edge of its search, 0.0005 to 10" in said[1]
    assert "range_white: 1 is at the edge of its search, 0.0005 to 1: the recording hardly tells it" in said[2]
    assert "no ranges in 11.4 of the 22.3 s fitted" in said[3]
    assert "a gain of 4.7 is no more than chance" in said[4]
    assert any("11100.0 -> 11140.0: +40.0 ± 94.0" in line for line in said)
    assert said[-1] == verdict_line(fitted)
    gains = {
        "innovations": Gain(11100.0, 11140.0, 9.0)
    }  # better on the rest, but nothing was gained where it was fitted
    lucky = fitted._replace(judged=judged._replace(gains=gains))
    assert (lucky.judged.verdict, lucky.verdict) == ("better", "the same")
    assert "gains no more than by chance" in verdict_line(lucky)
    doubted = lucky._replace(after=2100.0)
    assert doubted.verdict == "better"
    doubted = doubted._replace(doubts=("log: anchors: entry 3 ...",))
    assert doubted.verdict == "mend first"
    assert verdict_line(doubted).startswith("mend these first")
    assert verdict_line(doubted).endswith("\n  log: anchors: entry 3 ...")


def test_the_search_includes_all_noise_that_a_logs_map_may_have() -> None:
    assert all(LIMITS[name][0] < LEAST[name] for name in LIMITS.keys() & LEAST.keys())


@pytest.mark.long
def test_the_ranges_own_noise_is_better_than_another_and_itself_is_the_same(tmp_path, monkeypatch) -> None:
    """Made-up ranges err by 3 cm, and rates and force by what `others` says: noise of 9 cm must lose."""
    recording = read_recording(write_tables(tmp_path / "walk", made_up(duration=40.0)), as_map(TABLE_MAP))
    others = "acceleration: 0.002, rotation: 0.0001, acceleration_bias: 0.0005, rotation_bias: 0.00005"
    right, wrong = (
        as_map(TABLE_MAP + f"filter: {{{others}, range_white: {white}, range_correlated: 0.002}}\n")
        for white in (0.03, 0.09)
    )
    motion, right, wrong = parts_of(recording, right), right.filter, wrong.filter
    levels: list[float] = []
    with monkeypatch.context() as patch:
        patch.setattr(held_out, "gain_of", lambda *its: levels.append(its[-1]) or gain_of(*its))
        assert judge([motion], wrong, right).verdict == "better"
    assert levels == pytest.approx([1.0 - 0.05 / 3.0] * 3)  # so that all three hold in 0.95
    assert judge([motion], right, wrong).verdict == "worse"
    held = judge([motion], right, right)
    assert held.verdict == "the same"
    assert held.gains["innovations"].half == 0.0
    assert held.nis[0] == pytest.approx(1.0, abs=0.1)
    assert held.duration == pytest.approx(28.0, abs=1.0)
    without = judge([parts_of(recording._replace(truth=None), as_map(TABLE_MAP))], wrong, right)
    assert without.nees is None
    assert without.gains["innovations"].sign == 1
