"""Recorded motions in a few lines."""

from collections.abc import Sequence

from ortilo_drake.studies.recorded.lost_lines import lost_line
from ortilo_drake.studies.recorded.replayed import CV, RAW, WITH_IMU, Replayed


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
