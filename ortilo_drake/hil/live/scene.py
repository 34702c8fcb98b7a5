"""The scene of a live flight on Meshcat's page."""

from collections import deque
from typing import Final

import numpy as np
from pydrake.geometry import Meshcat, Rgba, Sphere
from pydrake.math import RigidTransform
from pydrake.trajectories import Trajectory

from ortilo_drake.hil.live.live_flight import ShownTick
from ortilo_drake.model.room import Room
from ortilo_drake.model.vehicle import Vehicle
from ortilo_drake.world.scenery.meshcat_replay import PLANNED_PATH, draw_flown, draw_plan, draw_vehicle, show_pose
from ortilo_drake.world.scenery.meshcat_room import aim_camera, draw_room

GOAL: Final = "/flight/goal"
LAMPS: Final = "/flight/lamps"
LIT_FOR: Final = 0.2  # time for which a lamp stays lit after a message [s]
TRAIL: Final = 20.0  # duration of the flown path that is shown [s]
CORNER_EVERY: Final = 0.1  # time between two corners of that line [s]; with one a tick a page would get 3 MB/s
LIT, DARK = (0.15, 0.85, 0.25, 1.0), (0.75, 0.1, 0.1, 1.0)


class Scene:
    """The room, the vehicle, its estimate, the goal, and a lamp for each sensor above the vehicle.

    The lamps of `sensors` stand side by side, the first to the west.
    """

    def __init__(self, meshcat: Meshcat, room: Room, vehicle: Vehicle, sensors: tuple[str, ...]):
        self._meshcat, self._vehicle, self._sensors = meshcat, vehicle, sensors
        draw_room(meshcat, room)
        low, high = np.array(room.interior.min), np.array(room.interior.max)
        length = np.array([high[0] - low[0], 0.0, 0.0])
        aim_camera(meshcat, low - 0.25 * length, high + 0.4 * length)  # readings and controls take up both sides
        meshcat.SetObject(GOAL, Sphere(0.12), Rgba(0.95, 0.6, 0.05, 0.8))
        for i, sensor in enumerate(sensors):
            meshcat.SetObject(f"{LAMPS}/{sensor}", Sphere(0.08), Rgba(*DARK))
            meshcat.SetTransform(f"{LAMPS}/{sensor}", RigidTransform([0.25 * (i - (len(sensors) - 1) / 2.0), 0.0, 0.0]))

    def begin(self, path: Trajectory | None) -> None:
        """Show the start of a new flight along a path."""
        self._lit, self._until = dict.fromkeys(self._sensors, False), dict.fromkeys(self._sensors, -1.0)
        self._flown: deque[np.ndarray] = deque(maxlen=round(TRAIL / CORNER_EVERY))
        self._corner_at = 0.0
        draw_vehicle(self._meshcat, self._vehicle)
        self.show_path(path)
        for sensor in self._sensors:
            self._meshcat.SetProperty(f"{LAMPS}/{sensor}", "color", list(DARK))

    def lit(self) -> dict[str, bool]:
        """Return for each sensor whether its lamp is lit."""
        return dict(self._lit)

    def show_path(self, path: Trajectory | None) -> None:
        """Show the path that is flown from now on."""
        if path is None:
            self._meshcat.Delete(PLANNED_PATH)
        else:
            draw_plan(self._meshcat, path)

    def show_goal(self, x: float, y: float, z: float) -> None:
        """Show the goal at a position x, y, z in W [m]."""
        self._meshcat.SetTransform(GOAL, RigidTransform([x, y, z]))

    def show(self, seen: ShownTick, draws: bool) -> None:
        """Show a tick; the vehicle and its flown path are drawn only if `draws` and all values are finite."""
        for sensor in self._sensors:
            if sensor in seen.arrived:
                self._until[sensor] = seen.time + LIT_FOR
            lit = seen.time < self._until[sensor]
            if lit != self._lit[sensor]:
                self._lit[sensor] = lit
                self._meshcat.SetProperty(f"{LAMPS}/{sensor}", "color", list(LIT if lit else DARK))
        now = np.concatenate([seen.x[:3], seen.xhat[:3]])
        if seen.time >= self._corner_at:
            self._flown.append(now)
            self._corner_at = seen.time + CORNER_EVERY
        if seen.path is not None:
            self.show_path(seen.path)
        if draws and np.isfinite([*seen.x, *seen.xhat[:6], *seen.P[:3, :3].flat]).all():
            show_pose(self._meshcat, seen.x, seen.xhat, seen.P[:3, :3], np.eye(3), seen.time)
            self._meshcat.SetTransform(LAMPS, RigidTransform(seen.x[:3] + [0.0, 0.0, 0.45]))
            draw_flown(self._meshcat, np.array([*self._flown, now]))
