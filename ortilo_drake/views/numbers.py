"""Tables in Markdown, and numbers as text: with the digits that their intervals justify, 'lost' for lost flights."""

import math

from ortilo_drake.flight.intervals import Interval, Middle, share_interval

Rows = list[list[str]]


def table(header: list[str], rows: Rows) -> list[str]:
    """Return a Markdown table and the empty line after it."""
    lines = [" | ".join(header), " | ".join("---" for _ in header)]
    return [f"| {line} |" for line in (*lines, *(" | ".join(row) for row in rows))] + [""]


LOST = "lost"


def number(value: float, half_width: float | None = None) -> str:
    """Return a number as text, rounded to the first digit of its interval's half width, but to at least one digit.

    Without a half width the text has two digits. An infinite number is LOST.
    """
    if math.isinf(value):
        return LOST
    first = _place(value)
    if value == 0.0 and not half_width:
        return "0"
    places = first + 1 if half_width is None else max(first, _place(half_width)) if half_width > 0.0 else first + 3
    return f"{round(value, places):.{max(places, 0)}f}"


def _place(value: float) -> int:
    """Return the decimal place of a number's first digit: 1 for 0.3, 0 for 3, -1 for 30."""
    return -math.floor(math.log10(float(f"{abs(value):.0e}"))) if value else 0


def with_interval(value: float | None, interval: Interval | None) -> str:
    """Return a number and its interval as text; [?] if there are too few flights for an interval, 'none' for None."""
    if value is None:
        return "none"
    if interval is None or math.isinf(interval[0]):
        return number(value) + ("" if interval else " [?]")
    low, high = interval
    width = _half_width(value, low, high)
    return f"{number(value, width)} [{number(low, width)}, {number(high, width)}]"


def mean_with_interval(mean: float | None, interval: Interval | None) -> str:
    """Return a mean and its interval, if there is one, with two decimal places; '-' if the mean is None."""
    if mean is None:
        return "-"
    return f"{mean:.2f}" + (f" [{interval[0]:.2f}, {interval[1]:.2f}]" if interval else "")


def in_its_digits(other: float, value: float, interval: Interval | None) -> str:
    """Return `other` as text, rounded as with_interval rounds `value`."""
    known = interval is not None and not math.isinf(interval[0])
    return number(other, _half_width(value, *interval) if known and interval else None)


def _half_width(value: float, low: float, high: float) -> float | None:
    """Return the geometric mean of a number's distances to the finite ends of its interval; None for a lost flight."""
    apart = [abs(end - value) for end in (low, high) if math.isfinite(end)] if math.isfinite(value) else []
    if not apart:
        return None
    return math.sqrt(apart[0] * apart[-1]) or 0.5 * max(apart)


def of_all_and_kept(middle: Middle, lost: int) -> str:
    """Return the median with lost flights as the worst, then the median of kept flights if any flight was lost."""
    every = with_interval(middle.median, middle.interval)
    if not lost or middle.kept is None:
        return every
    return f"{every}; kept {with_interval(middle.kept, middle.kept_interval)}"


def count(events: int, trials: int) -> str:
    """Return the number of events among trials, and Wilson's interval of the share."""
    return f"{events} of {trials} {share(events, trials)}"


def share(events: int, trials: int) -> str:
    """Return Wilson's interval of a share in percent."""
    low, high = (100.0 * end for end in share_interval(events, trials))
    return f"[{_percent(low)}, {_percent(high)} %]"


def _percent(percent: float) -> str:
    return f"{percent:.2g}" if percent < 10.0 else f"{percent:.0f}"
