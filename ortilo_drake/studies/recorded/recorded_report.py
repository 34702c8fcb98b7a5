"""The report of recorded motions: in short, a table of rows for each, what was calibrated and what was rejected."""

from collections.abc import Sequence

import numpy as np

from ortilo_drake.studies.recorded.replayed import CV, RAW, WITH_IMU, Replayed
from ortilo_drake.studies.recorded.scores import Scores
from ortilo_drake.views.markdown import table

HEADER = [
    "",
    "x",
    "y",
    "z",
    "ATE",
    "ATE, aligned",
    "RPE in 1 s",
    "NEES",
    "NIS",
    "rejected",
    "available",
    "at gaps' ends",
]
LEGEND = (
    "RMS errors in m. ATE and RPE by evo: of the position, as it is, after the best SE(3), and over a second. NEES is "
    "3 if consistent, NIS about 1. Rejected: ranges that the gate left out. Available: share of the time at which the "
    "filter's own standard deviation is below the map's limit. At gaps' ends: RMS and largest position error."
)
MOST_LOST = 6  # times that are listed


def _cell(value: float | None, form: str) -> str:
    return "-" if value is None else format(value, form)


def _cells(name: str, s: Scores) -> list[str]:
    axes = ["-"] * 3 if s.rmse is None else [f"{axis:.4f}" for axis in s.rmse]
    ends = "-" if s.gap_end is None else f"{s.gap_end:.3f}, {s.gap_end_largest:.3f} of {s.gaps}"
    figures = [_cell(value, ".4f") for value in (s.ate, s.ate_aligned, s.rpe)]
    return [
        name,
        *axes,
        *figures,
        _cell(s.nees, ".2f"),
        f"{s.nis:.2f}",
        f"{s.rejected:.2%}",
        f"{s.available:.1%}",
        ends,
    ]


def _calibrated(found: Replayed) -> list[str]:
    if found.offset is None or found.shift is None or found.biases is None or found.lever is None:
        return ["No truth: nothing was calibrated, and no error is known.", ""]
    told = {"rates": "by the body rates", "ranges": "by the ranges", "map": "by the map"}[found.told_by or "map"]
    plain = "" if found.plain_residual is None else f", {found.plain_residual:.3f} m with one bias for all ranges"
    shift, lever = (", ".join(f"{v:.3f}" for v in vector) for vector in (found.shift, found.lever))
    return [
        f"- Truth's clock less the sensors', {told}: {found.offset:.3f} s.",
        f"- Truth's frame in the anchors': shift ({shift}) m, heading {np.degrees(found.heading or 0.0):.2f}°.",
        f"- Antenna from the truth's point, body axes: ({lever}) m.",
        f"- Biases of the ranges: {', '.join(f'{b:.3f}' for b in found.biases)} m.",
        f"- Errors of the ranges after the calibration: {found.residual:.3f} m RMS{plain}; the filter counts on "
        f"{found.range_noise:.3f} m.",
        "",
    ]


def lost_line(s: Scores) -> str:
    """Return a line on a filter's losses (number, duration, times), and on its errors at other times."""
    times = [
        f"lost from {since:.1f} s, " + ("not found again" if found is None else f"found again at {found:.1f} s")
        for since, found in s.lost
    ]
    more = f" and {len(times) - MOST_LOST} times more" if len(times) > MOST_LOST else ""
    line = "; ".join(times[:MOST_LOST]) + more
    total = sum(found - since for since, found in s.lost if found is not None)
    if len(times) > 1:
        line += f"; {len(times)} times, {total:.1f} s in all"
    if s.rmse_found is not None:
        line += f"; RMS error in x, y, z at other times {', '.join(f'{axis:.3f}' for axis in s.rmse_found)} m"
    return line


def _axes(found: Replayed, name: str) -> str:
    rmse = found.rows[name].rmse
    assert rmse is not None
    return ", ".join(f"{axis:.3f}" for axis in rmse)


def replay_summary(motions: Sequence[Replayed], share: float) -> list[str]:
    """Return a summary of the findings, as a Markdown list."""
    lines = []
    for found in motions:
        if found.doubts:
            many = "one doubt" if len(found.doubts) == 1 else f"{len(found.doubts)} doubts"
            lines.append(f"**{found.name}: doubtful, {many}; its figures may mean nothing:**")
            lines += [f"  {found.name}: {doubt}." for doubt in found.doubts]
        rows = found.rows
        main = next(name for name in (WITH_IMU, CV, *rows) if name in rows)
        if rows[main].lost:
            lines.append(f"{found.name}: {lost_line(rows[main])} ({main}).")
        if rows[main].rmse is None:
            lines.append(
                f"{found.name}: no truth; NIS {rows[main].nis:.2f}, {rows[main].rejected:.2%} of the ranges rejected."
            )
            continue
        line = (
            f"{found.name}: RMS error in x, y, z {_axes(found, main)} m ({main}, calibrated on the first {share:.0%})"
        )
        if main != CV:
            line += f"; {_axes(found, CV)} m by the constant-velocity filter"
        lines.append(line + ".")
        for name, scores in rows.items():
            if name.startswith(f"{main}, ") and scores.gap_end is not None:
                lines.append(f"{found.name}: {scores.gap_end:.2f} m RMS at the ends of {scores.gaps} gaps ({name}).")
            elif name.startswith(f"{main}, ") and name.endswith("lost") and scores.ate is not None:
                more = scores.ate / (rows[main].ate or 1.0) - 1.0
                lines.append(f"{found.name}: {more:+.0%} error ({name}).")
        if RAW in rows:
            lines.append(f"{found.name}: {_axes(found, RAW)} m without any calibration.")
    rejected = sum(sum(found.rejected.values()) for found in motions)
    lines.append(f"{rejected} rows, messages or single ranges could not be used; each motion below says which.")
    return ["## In short", "", *("  - " + line[2:] if line.startswith("  ") else f"- {line}" for line in lines), ""]


def report_text(motions: Sequence[Replayed], share: float) -> str:
    """Return the report in Markdown; so large a share of each motion's time calibrated it."""
    lines = ["# Recorded motions", "", *replay_summary(motions, share)]
    for found in motions:
        lines += [f"## {found.name}", "", *table(HEADER, [_cells(name, s) for name, s in found.rows.items()])]
        lines += _calibrated(found)
        # Losses that were imposed are no news.
        lost = [f"- {name}: {lost_line(s)}." for name, s in found.rows.items() if s.lost and "lost" not in name]
        if lost:
            lines += ["The filter was lost (times since the first range):", "", *lost, ""]
        lines += [f"- {note}" for note in found.notes] + [""] * bool(found.notes)
    return "\n".join([*lines, LEGEND, ""])
