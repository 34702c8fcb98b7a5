"""Stamps as text: a number of seconds, a date with a time, a time of day, or minutes and seconds."""

import re
from datetime import UTC, datetime

import numpy as np

from ortilo_drake.interop.recorded.tables import number

MONTHS = ("jan", "feb", "mar", "apr", "may", "jun", "jul", "aug", "sep", "oct", "nov", "dec")
DAY, HOUR = 86400.0, 3600.0  # periods of clocks that show a time of day, or minutes and seconds [s]
_DAYS = (
    re.compile(r"(?P<y>\d{4})[-/.](?P<m>\d\d?)[-/.](?P<d>\d\d?)"),
    re.compile(r"(?P<y>\d{4})(?P<m>\d\d)(?P<d>\d\d)(?=[T_ -])"),
    re.compile(r"(?P<d>\d\d?)\.(?P<m>\d\d?)\.(?P<y>\d{4})"),
    re.compile(r"(?P<m>\d\d?)/(?P<d>\d\d?)/(?P<y>\d{4})"),
    re.compile(r"(?P<d>\d\d?)[- ](?P<m>[A-Za-z]{3})[- ](?P<y>\d{4})"),
)
_TIME = re.compile(
    r"(?P<h>\d+):(?P<min>[0-5]\d):(?P<s>[0-5]\d|60)(?:[.,:](?P<f>\d+))? ?(?P<half>[AaPp][Mm])?"
    r" ?(?P<zone>Z|UTC|[+-]\d\d:?(?:\d\d)?)?"
)
_PACKED = re.compile(r"(\d\d)(\d\d)(\d\d)(\.\d+)?(.*)")
_MINUTES = re.compile(r"(\d+):([0-5]\d[.,]\d+)")


def stamp(cell: str) -> float | None:
    """Return a stamp as a number, a date or time in seconds (UTC unless a zone is given); None if it is no stamp.

    12:05.3 means minutes and seconds. In 5/3/2024 the month is first, unless the first number is above 12.
    """
    found = number(cell)
    if found is not None:
        return found
    if minutes := _MINUTES.fullmatch(cell):
        return 60.0 * int(minutes[1]) + float(minutes[2].replace(",", "."))
    day = next((its for pattern in _DAYS if (its := pattern.match(cell))), None)
    if day is None:
        return _seconds(cell)
    seconds = _seconds(cell[day.end() :].lstrip("T_ -"))
    month, of_month = day["m"], int(day["d"])
    if month.isdigit():
        m = int(month)
        if "/" in day[0] and not day[0][:4].isdigit() and m > 12:
            m, of_month = of_month, m
    elif month.lower() in MONTHS:
        m = 1 + MONTHS.index(month.lower())
    else:
        return None
    try:
        midnight = datetime(int(day["y"]), m, of_month, tzinfo=UTC).timestamp()
    except ValueError:
        return None
    return None if seconds is None else midnight + seconds


def _seconds(text: str) -> float | None:
    """Return a time of day in seconds since midnight UTC; 0 for an empty text, None for any other text."""
    if not text:
        return 0.0
    if packed := _PACKED.fullmatch(text):
        text = f"{packed[1]}:{packed[2]}:{packed[3]}{packed[4] or ''}{packed[5]}"
    time = _TIME.fullmatch(text.strip())
    if time is None:
        return None
    hour, zone, half = int(time["h"]), time["zone"], time["half"]
    if half:
        hour = hour % 12 + 12 * (half.lower() == "pm")
    seconds = 3600.0 * hour + 60.0 * int(time["min"]) + float(f"{time['s']}.{time['f'] or 0}")
    if zone and zone[0] in "+-":
        digits = zone[1:].replace(":", "").ljust(4, "0")
        seconds -= float(f"{zone[0]}1") * (3600.0 * int(digits[:2]) + 60.0 * int(digits[2:]))
    return seconds


def clock_period(cell: str) -> float | None:
    """Return the period of a stamp's clock [s]: a day, an hour, or None if the clock never starts again."""
    if _MINUTES.fullmatch(cell):
        return HOUR
    return DAY if _TIME.fullmatch(cell) else None


def unrolled(t: np.ndarray, period: float | None) -> np.ndarray:
    """Return stamps (n) [s] of a clock with a period, unwrapped so that they rise beyond the period."""
    if period is not None:
        known = np.isfinite(t)
        t[known] = np.unwrap(t[known], period=period)
    return t
