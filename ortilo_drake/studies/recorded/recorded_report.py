"""The report of recorded motions: in short, a table of rows for each, what was calibrated and what was rejected."""

from collections.abc import Sequence

import numpy as np

from ortilo_drake.studies.recorded.lost_lines import lost_lines
from ortilo_drake.studies.recorded.replayed import Replayed
from ortilo_drake.studies.recorded.scores import Scores
from ortilo_drake.studies.recorded.summary import replay_summary
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


def report_text(motions: Sequence[Replayed], share: float) -> str:
    """Return the report in Markdown.

    Args:
        motions: what was found.
        share: of each motion's time that calibrated it.
    """
    lines = ["# Recorded motions", "", *replay_summary(motions, share)]
    for found in motions:
        lines += [f"## {found.name}", "", *table(HEADER, [_cells(name, s) for name, s in found.rows.items()])]
        lines += _calibrated(found)
        if lost := lost_lines(found.rows):
            lines += ["The filter was lost (times since the first range):", "", *(f"- {line}" for line in lost), ""]
        lines += [f"- {note}" for note in found.notes] + [""] * bool(found.notes)
    return "\n".join([*lines, LEGEND, ""])
