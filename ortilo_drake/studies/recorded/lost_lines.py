"""The times at which the filter was lost and found again, in the report's words."""

from collections.abc import Mapping

from ortilo_drake.studies.recorded.scores import Scores

MOST = 6  # times that are listed


def lost_lines(rows: Mapping[str, Scores]) -> list[str]:
    """Return a line for each row whose filter was lost, except where the losses were imposed."""
    return [f"{name}: {lost_line(s)}." for name, s in rows.items() if s.lost and "lost" not in name]


def lost_line(s: Scores) -> str:
    """Return a line on a filter's losses (number, duration, times), and on its errors at other times."""
    times = [
        f"lost from {since:.1f} s, " + ("not found again" if found is None else f"found again at {found:.1f} s")
        for since, found in s.lost
    ]
    more = f" and {len(times) - MOST} times more" if len(times) > MOST else ""
    line = "; ".join(times[:MOST]) + more
    total = sum(found - since for since, found in s.lost if found is not None)
    if len(times) > 1:
        line += f"; {len(times)} times, {total:.1f} s in all"
    if s.rmse_found is not None:
        line += f"; RMS error in x, y, z at other times {', '.join(f'{axis:.3f}' for axis in s.rmse_found)} m"
    return line
