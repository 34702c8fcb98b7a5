"""Stamps as dates and times of day, as other programs write them."""

from datetime import UTC, datetime, timedelta

import numpy as np
import pytest

from ortilo_drake.interop.recorded.csv_columns import read_csv
from ortilo_drake.interop.recorded.rejected import Rejections
from ortilo_drake.interop.recorded.sources import Source
from ortilo_drake.interop.recorded.stamps import stamp
from ortilo_drake.interop.recorded.tables import number

MOMENT = datetime(2024, 5, 3, 22, 7, 9, 250_000, UTC)


@pytest.mark.parametrize(
    "form",
    [
        "%Y-%m-%d %H:%M:%S.%f",
        "%Y-%m-%dT%H:%M:%S.%f123Z",
        "%Y-%m-%dT%H:%M:%S.%f+00:00",
        "%Y-%m-%d %H:%M:%S,%f UTC",
        "%Y/%m/%d %H:%M:%S.%f",
        "%Y%m%dT%H%M%S.%f",
        "%Y%m%d_%H%M%S.%f",
        "%d.%m.%Y %H:%M:%S.%f",
        "%m/%d/%Y %I:%M:%S.%f %p",
        "%d-%b-%Y %H:%M:%S.%f",
    ],
)
def test_a_date_is_its_seconds_by_utc(form) -> None:
    assert stamp(MOMENT.strftime(form)) == pytest.approx(MOMENT.timestamp(), abs=1e-6)


@pytest.mark.parametrize(
    ("text", "seconds"),
    [
        ("9:05:07.5", 32707.5),
        ("12:00:00 AM", 0.0),
        ("20:15:02:123", 72902.123),
        ("02:03.4", 123.4),
        ("2024-05-03 10:00:00 +0230", datetime(2024, 5, 3, 7, 30, tzinfo=UTC).timestamp()),
        ("25/12/2024 00:00:01", datetime(2024, 12, 25, 0, 0, 1, tzinfo=UTC).timestamp()),
        ("31/31/2024 10:00:00", None),
        ("10:7", None),
        ("12:75:09", None),
        ("10:75.5", None),
        ("soon", None),
    ],
)
def test_times_of_day_and_what_is_none(text, seconds) -> None:
    assert stamp(text) == (seconds if seconds is None else pytest.approx(seconds, abs=1e-6))


def test_an_underline_makes_no_number() -> None:
    assert number("1_000") is None


@pytest.mark.parametrize(("form", "begin"), [("%H:%M:%S.%f", "23:59:50"), ("%M:%S.%f", "10:59:50")])
def test_a_clock_that_begins_anew_goes_on(tmp_path, form, begin) -> None:
    t = np.arange(0.0, 20.0, 0.5)
    first = datetime.fromisoformat(f"2024-05-03T{begin}")
    rows = [f"{(first + timedelta(seconds=s)).strftime(form)},{k}" for k, s in enumerate(t)]
    (tmp_path / "r.csv").write_text("\n".join(["t,r", *rows]))
    table = read_csv(tmp_path / "r.csv", Source(file="r.csv", time="t"), ("r",), Rejections("r.csv"))
    np.testing.assert_allclose(table.t - table.t[0], t, atol=1e-6)
