"""Doubts about how the body lies, by the specific force: upside down, or tilted where it begins at rest.

At rest the force is gravity's reaction, along the body's z if the body is level. A quadrotor's thrust is along z too,
so the rule also holds for a quadrotor that is already in the air.
"""

from typing import Final

import numpy as np

from ortilo_drake.interop.recorded.map_file import Map
from ortilo_drake.interop.recorded.recording import Imu
from ortilo_drake.interop.recorded.units import FORCE_UNITS, axes_matrix, axes_names, size_of
from ortilo_drake.studies.recorded.at_rest import AT_REST
from ortilo_drake.studies.recorded.imu_doubts import AXES

DOWN: Final = 0.5  # the body looks upside down if so large a share of the mean force is along -z
TILTED: Final = np.radians(30.0)  # no floor is so steep [rad]
LEANS: Final = np.radians(12.0)  # few floors are so steep [rad]
TURNS: Final = sorted((D for D in AXES if np.linalg.det(D) > 0.0), key=lambda D: -np.trace(D))  # the least turn first


def level_doubts(imu: Imu, map_: Map) -> list[str]:
    """Return a doubt if the body is upside down, or begins tilted though the map gives its `start` or `standstill`."""
    size = float(np.linalg.norm(imu.force, axis=1).mean())
    if map_.imu is None or map_.command is not None or size == 0.0:
        return []
    up = float(imu.force[:, 2].mean())
    if up <= -DOWN * size:
        return [_upside_down(map_, up)]
    f = _first_force(imu, map_)
    if f is None or f[2] >= np.cos(TILTED):
        return []
    best = max(TURNS, key=lambda D: float((D @ f)[2]))
    level = f"imu: {{axes: {axes_names(best @ axes_matrix(map_.imu.force_axes or map_.imu.axes, 'axes', True))}}}"
    mends = "" if (best @ f)[2] < np.cos(TILTED) else f"is `axes` right? {level} makes it level; "
    return [
        f"imu: by its force at the start the body lies {_lies(f)} degrees: {mends}if it does begin so, say `start: "
        "{tilted: true}`"
    ]


def lean_warning(imu: Imu, map_: Map) -> str:
    """Return a warning if the body begins at its `start` or `standstill` tilted as few floors are; else empty."""
    f = _first_force(imu, map_)
    if f is None or f[2] >= np.cos(LEANS):
        return ""
    return (
        f"imu: by its force at the start the body lies {_lies(f)} degrees: unless the floor is so, the imu is mounted "
        "so, and the attitude is as wrong"
    )


def _first_force(imu: Imu, map_: Map) -> np.ndarray | None:
    """Return the direction of the first force (3) if the map says that the body begins level, else None."""
    if map_.imu is None or map_.command is not None or (map_.start is not None and map_.start.tilted):
        return None
    if map_.start is None and map_.imu.standstill == 0.0:
        return None
    f = imu.force[imu.t <= imu.t[0] + max(AT_REST, map_.imu.standstill)].mean(axis=0)
    size = float(np.linalg.norm(f))
    return f / size if size > 0.0 else None


def _lies(f: np.ndarray) -> str:
    roll, pitch = np.degrees([np.arctan2(f[1], f[2]), np.arcsin(-f[0])])
    return f"rolled by {roll:.0f}" if abs(f[1]) > abs(f[0]) else f"pitched by {pitch:.0f}"


def _upside_down(map_: Map, up: float) -> str:
    assert map_.imu is not None
    if isinstance(map_.imu.axes, str):
        key = {"flu": "frd", "frd": "flu"}[map_.imu.axes]
    else:  # half a turn about x: changing only z's sign would mirror
        x, *others = map_.imu.axes
        key = f"[{', '.join([x, *(axis[1:] if axis[0] == '-' else f'-{axis}' for axis in others)])}]"
    turned = f"imu: {{force_unit: {-size_of(map_.imu.force_unit, FORCE_UNITS):.6g}}} if it reports gravity itself"
    return (
        f"imu: by its force, {up:.3g} m/s² along z, the body is upside down: imu: {{axes: {key}}} turns it up, or "
        f"{turned}"
    )
