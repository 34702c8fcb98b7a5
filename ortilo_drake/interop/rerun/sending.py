"""Columns of a recording: many rows at once, over simulated time."""

import numpy as np
import rerun as rr

from ortilo_drake.interop.rerun.series import Series
from ortilo_drake.interop.ros.ros_fields import to_ns

TIMELINE = "time"  # simulated seconds from the flight's start


def time_column(times: np.ndarray) -> rr.TimeColumn:
    """Return the timeline's values at some times [s], in whole nanoseconds as in the logs."""
    return rr.TimeColumn(TIMELINE, duration=np.array([to_ns(t) for t in times.tolist()], dtype="timedelta64[ns]"))


def send_series(recording: rr.RecordingStream, path: str, series: Series) -> None:
    """Write time series; a value that is not finite is left out with its row."""
    there = np.isfinite(series.values).all(axis=1)
    if not there.any():
        return
    names = list(series.names)
    if series.is_sparse:
        recording.log(path, rr.SeriesPoints(names=names, marker_sizes=[2.0] * len(names)), static=True)
    else:
        mode = rr.components.InterpolationMode.StepAfter if series.is_step else None
        colors = list(series.colors) or None
        recording.log(path, rr.SeriesLines(names=names, colors=colors, interpolation_mode=mode), static=True)
    columns = rr.Scalars.columns(scalars=series.values[there])
    recording.send_columns(path, indexes=[time_column(series.times[there])], columns=columns)
