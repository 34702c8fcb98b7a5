"""Trajectories of a recorded motion as files: the estimate, the smoother's and the truth, as TUM and as CSV.

All are in the anchors' frame and by the sensors' clock, stamps as the recording's files have them. TUM is what evo and
others read: `timestamp tx ty tz qx qy qz qw`; without an attitude the quaternion is 0 0 0 1, and CSV leaves it out.
"""

from io import StringIO
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from ortilo_drake.flight.files import write_text
from ortilo_drake.interop.recorded.recording import Recording
from ortilo_drake.studies.recorded.calibrate import truth_path
from ortilo_drake.studies.recorded.recorded_figure import main_row
from ortilo_drake.studies.recorded.replayed import RAW, WITH_IMU, Drawn, Replayed


def _true_attitude(found: Replayed, recording: Recording, t: np.ndarray, frame: str) -> np.ndarray | None:
    """Return the attitude (m, 3, 3) of the truth's body; None if it is not known or more than a heading turns it."""
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
    """Write NAME_estimate, NAME_smoother and NAME_truth, each .tum and .csv, and return the files' paths.

    `frame` says how the truth's frame was turned: yaw, se3 or same.

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
