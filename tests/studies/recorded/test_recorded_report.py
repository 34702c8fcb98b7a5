"""The report and picture of recorded motions: what they say of claims, and how far an axis of errors reaches."""

import numpy as np
import pytest

from ortilo_drake.studies.recorded.recorded_figure import error_limit
from ortilo_drake.studies.recorded.recorded_report import overconfident
from ortilo_drake.studies.recorded.scores import Scores


def test_an_outage_does_not_stretch_an_axis_of_errors() -> None:
    usable = np.arange(1000) < 800
    band = np.where(usable, 0.1, 30.0)
    error = np.where(usable, 0.02, 5.0)
    assert error_limit(usable, band, error) == pytest.approx(1.2 * 0.1)
    assert error_limit(usable, band, np.where(usable, 0.2, 5.0)) == pytest.approx(1.2 * 0.2)  # errors beyond the band
    assert error_limit(usable, band, None) == pytest.approx(1.2 * 0.1)
    assert error_limit(np.zeros(9, dtype=bool), np.full(9, 30.0), None) == pytest.approx(1.2 * 30.0)  # never usable


def test_a_smoother_that_claims_far_too_little_is_named() -> None:
    def row(nees: float | None) -> Scores:
        return Scores((0.1, 0.1, 0.1), None, None, None, nees, 1.0, 0.0, 1.0)

    rows = {"a": row(5.0), "a, smoothed": row(27.0), "a, lost": row(99.0), "b": row(99.0)}
    (said,) = overconfident(rows, "a")
    assert said.startswith("a, smoothed: NEES is 27, not 3: its errors are 3.0 times what it claims")
    assert overconfident({"a": row(None)}, "a") == []
