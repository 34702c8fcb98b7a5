"""The files written about recorded motions: the report, and trajectories as TUM and CSV.

The report has a summary and, for each motion, a table of rows, the calibration and the rejected data. Trajectories
are in the anchors' frame and by the sensors' clock, with the stamps of the recording's files. evo and others read TUM,
`timestamp tx ty tz qx qy qz qw`; without an attitude the quaternion is 0 0 0 1, and CSV leaves it out.
"""

from collections.abc import Mapping, Sequence
from io import StringIO
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from ortilo_drake.flight.files import write_text
from ortilo_drake.interop.recorded.recording import Recording
from ortilo_drake.studies.recorded.calibrate import truth_path
from ortilo_drake.studies.recorded.doubts import of_noise
from ortilo_drake.studies.recorded.replayed import CV, CV_RAW, RAW, WITH_IMU, Drawn, Replayed
from ortilo_drake.studies.recorded.scores import Scores
from ortilo_drake.views.numbers import table

COLUMNS = {  # for each field of Scores that is a column: its head and format
    "ate": ("ATE", ".4f"),
    "ate_aligned": ("ATE, aligned", ".4f"),
    "rpe": ("RPE in 1 s", ".4f"),
    "nees": ("NEES", ".2f"),
    "nis": ("NIS", ".2f"),
    "rejected": ("rejected", ".2%"),
    "available": ("available", ".1%"),
}
OF_ERRORS = (
    "RMS errors in m. ATE and RPE by evo: of the position, as it is, after the best SE(3), and over a second. NEES is "
    "3 if consistent. At gaps' ends: RMS and largest position error. "
)
LEGEND = (
    "NIS is about 1 if consistent. Rejected: ranges that the gate left out. Available: share of the time at which the "
    "filter's own standard deviation is below the map's `available` (0.3 m if it gives none)."
)
CLAIMS = 12.0  # NEES of errors twice as large as claimed
MOST_LOST = 6  # losses listed, at most
LONG = 1.0  # a longer time without ranges is told [s]


def _calibrated(found: Replayed) -> list[str]:
    if found.offset is None or found.shift is None or found.biases is None or found.lever is None:
        return ["No truth: nothing was calibrated, and no error is known.", ""]
    told = {"rates": "by the body rates", "ranges": "by the ranges", "map": "by the map"}[found.told_by or "map"]
    plain = ""
    if found.plain_residual is not None:
        plain = f" ({found.plain_residual:.3f} m in a quick fit of few ranges, one bias for all, the largest 5 % aside)"
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
    """Return a line on a filter's losses, and on its errors at other times if they differ from those at all times."""
    found = _other_times(s)
    return _lost_times(s) + (f"; RMS error in x, y, z at other times {found} m" if found else "")


def _other_times(s: Scores) -> str:
    """Return the RMS errors by axis while the filter was not lost [m]; "" if unknown or the same as at all times."""
    found, whole = (
        "" if rmse is None else ", ".join(f"{axis:.3f}" for axis in rmse) for rmse in (s.rmse_found, s.rmse)
    )
    return "" if found == whole else found


def _lost_times(s: Scores) -> str:
    """Return a text: when the filter was lost, how often, and for how long in all."""
    times = [
        f"lost from {since:.1f} s, "
        + ("not found again" if found is None else f"found again at {found:.1f} s")
        + _unheard(silent, None if found is None else found - since)
        for (since, found), silent in zip(s.lost, s.silent, strict=True)
    ]
    more = f" and {len(times) - MOST_LOST} times more" if len(times) > MOST_LOST else ""
    line = "; ".join(times[:MOST_LOST]) + more
    total = sum(found - since for since, found in s.lost if found is not None)
    if len(times) > 1:
        line += f"; {len(times)} times, {total:.1f} s in all"
    return line


def _losses(rows: Mapping[str, Scores]) -> list[str]:
    """Return lines on the losses of all rows; rows that were lost at the same times share a line."""
    alike: dict[str, list[str]] = {}
    for name, s in rows.items():
        if s.lost and "lost" not in name:  # imposed losses are no news
            found = _other_times(s)
            alike.setdefault(_lost_times(s), []).append(name + (f" (at other times {found} m)" if found else ""))
    if not alike:
        return []
    said = [f"- {times}: {'; '.join(names)}." for times, names in alike.items()]
    return ["The filter was lost (times since the first range; RMS errors in x, y, z):", "", *said, ""]


def _table(rows: Mapping[str, Scores]) -> list[str]:
    """Return the table of the scores, without the columns that no row has."""
    heads, cells = ["", "x", "y", "z", *(head for head, _ in COLUMNS.values()), "at gaps' ends"], []
    for name, s in rows.items():
        axes = ["-"] * 3 if s.rmse is None else [f"{axis:.4f}" for axis in s.rmse]
        figures = [(getattr(s, of), form) for of, (_, form) in COLUMNS.items()]
        ends = "-" if s.gap_end is None else f"{s.gap_end:.3f}, {s.gap_end_largest:.3f} of {s.gaps}"
        cells.append([name, *axes, *("-" if value is None else format(value, form) for value, form in figures), ends])
    kept = [k for k in range(len(heads)) if any(row[k] != "-" for row in cells)]
    return table([heads[k] for k in kept], [[row[k] for k in kept] for row in cells])


def _unheard(silent: float, lasted: float | None) -> str:
    """Return the time without ranges within a loss, in words; silent, lasted: longest such time, and the loss [s]."""
    if silent < LONG:
        return ""
    all_of_it = lasted is not None and silent > 0.95 * lasted
    return " (the recording has no ranges in between)" if all_of_it else f" (no ranges for {silent:.1f} s of it)"


def _largest(error: float, t: float, silent: float) -> str:
    """Return the largest error [m], its time and the time since the last range [s], in words."""
    return f"largest error {error:.2f} m at {t:.1f} s" + f", {silent:.1f} s after the last range" * (silent > LONG)


def _with_losses(ate: float, before: float) -> str:
    """Return how much larger the ATE with losses is than the ATE before [m], in words."""
    more = ate / before - 1.0
    if more >= 0.0:
        return f"{more:.0%} more error"
    return f"{-more:.0%} less error, by chance: these are one draw of losses, and fewer ranges tell no more"


def _axes(found: Replayed, name: str) -> str:
    rmse = found.rows[name].rmse
    assert rmse is not None
    return ", ".join(f"{axis:.3f}" for axis in rmse)


def overconfident(rows: Mapping[str, Scores]) -> list[str]:
    """Return a line for each row whose covariance claims far too small an error."""
    return [
        f"{name}: NEES is {s.nees:.0f}, not 3: its errors are {np.sqrt(s.nees / 3.0):.1f} times what it claims, which "
        + _lacking(name)
        for name, s in rows.items()
        if s.nees is not None and s.nees > CLAIMS
    ]


def _lacking(name: str) -> str:
    """Return which errors the standard deviations of a row do not include, in words."""
    if "not calibrated" in name:
        return "lacks what nobody calibrated (lever, biases): `filter` has too small a noise for that"
    if name.startswith(CV):
        return "lacks how the vehicle moves: `filter` has it as baseline_acceleration and baseline_range"
    return (
        "lacks the calibration's errors (clock, frame, lever, biases): give what is known of them under `calibration`"
    )


def replay_summary(motions: Sequence[Replayed], share: float) -> list[str]:
    """Return a summary of the findings, as a Markdown list."""
    lines = []
    for found in motions:
        if found.doubts:
            many = "one doubt" if len(found.doubts) == 1 else f"{len(found.doubts)} doubts"
            lines.append(f"**{found.name}: doubtful, {many}; its figures may mean nothing:**")
            lines += [f"  {found.name}: {doubt}{'' if doubt.endswith('?') else '.'}" for doubt in found.doubts]
        rows = found.rows
        main = next(name for name in (WITH_IMU, CV, RAW, *rows) if name in rows)
        if rows[main].lost:
            lines.append(f"{found.name}: {lost_line(rows[main])} ({main}).")
        if rows[main].rmse is None:
            lines.append(
                f"{found.name}: no truth; NIS {rows[main].nis:.2f}, {rows[main].rejected:.2%} of the ranges rejected."
            )
            lines += [f"{found.name}: {line}." for line in of_noise(rows, RAW, CV_RAW)]
            continue
        line = (
            f"{found.name}: RMS error in x, y, z {_axes(found, main)} m ({main}, after the first {share:.0%}, which "
            "calibrated it)"
        )
        if main != CV:
            line += f"; {_axes(found, CV)} m by the constant-velocity filter"
        lines.append(line + ".")
        if (largest := rows[main].largest) is not None:
            lines.append(f"{found.name}: {_largest(*largest)} ({main}, after the first {share:.0%}).")
        for name, scores in rows.items():
            if name.startswith(f"{main}, ") and scores.gap_end is not None:
                lines.append(f"{found.name}: {scores.gap_end:.2f} m RMS at the ends of {scores.gaps} gaps ({name}).")
            elif name.startswith(f"{main}, ") and name.endswith("lost") and scores.ate is not None:
                lines.append(f"{found.name}: {_with_losses(scores.ate, rows[main].ate or 1.0)} ({name}).")
        if RAW in rows:
            lines.append(f"{found.name}: {_axes(found, RAW)} m without any calibration.")
        lines += [f"{found.name}: {line}." for line in overconfident(rows)]
        lines += [f"{found.name}: {line}." for line in of_noise(rows, WITH_IMU, CV)]
    rejected = sum(sum(found.rejected.values()) for found in motions)
    lines.append(f"{rejected} rows, messages or single ranges could not be used; each motion below says which.")
    return ["## In short", "", *("  - " + line[2:] if line.startswith("  ") else f"- {line}" for line in lines), ""]


def report_text(motions: Sequence[Replayed], share: float) -> str:
    """Return the report in Markdown; `share` is the part of each motion's time that calibrated it."""
    lines = ["# Recorded motions", "", *replay_summary(motions, share)]
    for found in motions:
        lines += [f"## {found.name}", "", *_table(found.rows), *_calibrated(found), *_losses(found.rows)]
        lines += [f"- {note}" for note in found.notes] + [""] * bool(found.notes)
    known = any(found.offset is not None for found in motions)
    return "\n".join([*lines, OF_ERRORS * known + LEGEND, ""])


def main_row(drawn: Drawn) -> str:
    """Return the name of the row to draw: the best filter of those that ran."""
    return next(name for name in (WITH_IMU, CV, RAW, CV_RAW) if name in drawn)


def _true_attitude(found: Replayed, recording: Recording, t: np.ndarray, frame: str) -> np.ndarray | None:
    """Return the attitude (m, 3, 3) of the truth's body; None if unknown, or if F is more than a heading (se3)."""
    truth = recording.truth
    if truth is None or truth.R is None or found.offset is None or found.heading is None or frame == "se3":
        return None
    offset = found.offset - (recording.truth_origin - recording.origin)
    R = truth_path(truth).at(t + offset)[1]
    assert R is not None
    F = Rotation.from_rotvec([0.0, 0.0, found.heading]).as_matrix()
    return np.asarray(F @ R)


def _text(table: np.ndarray, mark: str, head: str, stamps: np.ndarray) -> str:
    out = StringIO()
    form = ["%.9f"] + ["%.9g"] * table.shape[1]
    np.savetxt(out, np.column_stack([stamps, table]), form, mark, header=head, comments="")
    return out.getvalue()


def write_trajectories(folder: Path, found: Replayed, drawn: Drawn, recording: Recording, frame: str) -> list[Path]:
    """Write NAME_estimate, NAME_smoother and NAME_truth, each as .tum and .csv, and return the files' paths.

    `frame` says how the truth's frame was turned: `yaw`, `se3` or `same`.

    Raises:
        InputError: if a file cannot be written.
    """
    main = main_row(drawn)
    estimate, truth = drawn[main]
    turned = main in (WITH_IMU, RAW)
    t = estimate.t + recording.origin
    Part = tuple[str, np.ndarray, np.ndarray | None, np.ndarray | None]
    parts: list[Part] = [("estimate", estimate.p, estimate.R if turned else None, estimate.P)]
    smoothed = drawn.get(f"{main}, smoothed")
    if smoothed is not None:
        parts.append(("smoother", smoothed[0].p, smoothed[0].R if turned else None, smoothed[0].P))
    if truth is not None:
        parts.append(("truth", truth, _true_attitude(found, recording, estimate.t, frame), None))
    written = []
    for kind, p, R, P in parts:
        q = np.tile([0.0, 0.0, 0.0, 1.0], (len(t), 1)) if R is None else Rotation.from_matrix(R).as_quat()
        head, table = "t,x,y,z", p
        if R is not None:
            head, table = f"{head},qx,qy,qz,qw", np.hstack([table, q])
        if P is not None:
            head, table = f"{head},sd_x,sd_y,sd_z", np.hstack([table, np.sqrt(np.einsum("kii->ki", P))])
        texts = {
            "tum": _text(np.hstack([p, q]), " ", "# timestamp tx ty tz qx qy qz qw", t),
            "csv": _text(table, ",", head, t),
        }
        for kind_of_file, text in texts.items():
            path = folder / f"{found.name}_{kind}.{kind_of_file}"
            write_text(path, text)
            written.append(path)
    return written
