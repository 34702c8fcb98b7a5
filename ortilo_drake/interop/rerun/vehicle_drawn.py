"""A flight in a recording: true and estimated vehicle, paths, camera, signals, and the room, in W [m]."""

import numpy as np
import rerun as rr
import xarray as xr
from scipy.spatial.transform import Rotation

from ortilo_drake.flight.flight import scenario_of
from ortilo_drake.interop.rerun.series import Series
from ortilo_drake.interop.rerun.sightings import Sightings
from ortilo_drake.interop.ros.ros_motion import quaternion
from ortilo_drake.interop.ros.ros_types import to_ns
from ortilo_drake.model.pinhole import R_BC
from ortilo_drake.model.room import CameraModel, Room
from ortilo_drake.model.vehicle import Vehicle, rotor_places
from ortilo_drake.scenario import Scenario, WaypointPlanner
from ortilo_drake.world.scenery.meshcat_room import class_color

TRUTH, ESTIMATE = "world/truth", "world/estimate"
CAMERA = f"{TRUTH}/camera"
PICTURE, BOXES = f"{CAMERA}/picture", f"{CAMERA}/picture/boxes"
COLORS = {TRUTH: (40, 160, 40), ESTIMATE: (242, 13, 153), "planned": (26, 140, 255)}
PICTURE_AT = 1.0  # distance of the drawn picture from the camera [m]
HALF_PIXEL = 0.5  # the centre of a pixel has integer coordinates here, in Rerun its corner has
ROOM_GREY, WALL_RED, STAND_GREY, ANCHOR_YELLOW = (150, 152, 156), (173, 92, 66), (110, 112, 118), (255, 184, 0)
ANCHOR_RADIUS = 0.1  # [m]
TIMELINE = "time"  # simulated time since the start of the flight


def send_vehicle(recording: rr.RecordingStream, flight: xr.Dataset) -> None:
    """Write true and estimated poses over time, the true, estimated and planned paths, and the waypoints."""
    scenario, time = scenario_of(flight), flight["time"].values
    for path, name in ((TRUTH, "truth"), (ESTIMATE, "estimate")):
        states = flight[name].values[:, :6]
        there = np.isfinite(states).all(axis=1)
        if there.any():
            turns = np.array([quaternion(np.array(rpy)) for rpy in states[there, 3:6]])
            columns = rr.Transform3D.columns(translation=states[there, :3], quaternion=turns)
            recording.send_columns(path, indexes=[time_column(time[there])], columns=columns)
            _send_line(recording, f"world/paths/{name}", states[there, :3], COLORS[path])
            recording.log(f"{path}/body", _body(scenario.vehicle, COLORS[path]), static=True)
    reference = flight["reference"].values
    _send_line(recording, "world/paths/planned", reference[np.isfinite(reference).all(axis=1)], COLORS["planned"])
    points = waypoints(scenario)
    if len(points):
        labels = [str(i) for i in range(len(points))]
        dots = rr.Points3D(points, radii=[0.06], colors=[COLORS["planned"]], labels=labels)
        recording.log("world/waypoints", dots, static=True)


def waypoints(scenario: Scenario) -> np.ndarray:
    """Return the waypoints p_W (n, 3) [m] of a scenario with a waypoint planner, (0, 3) for other planners."""
    planner = scenario.planner
    return np.array(planner.points if isinstance(planner, WaypointPlanner) else []).reshape(-1, 3)


def _send_line(recording: rr.RecordingStream, path: str, points: np.ndarray, color: tuple[int, int, int]) -> None:
    if len(points):
        recording.log(path, rr.LineStrips3D([points], colors=[color], radii=[0.012]), static=True)


def _body(vehicle: Vehicle, color: tuple[int, int, int]) -> rr.LineStrips3D:
    """Return lines from the body's origin to each rotor, and one line forward."""
    x, y, _ = rotor_places(vehicle)
    ends = [*zip(x.tolist(), y.tolist(), [0.0] * len(x), strict=True), (float(np.hypot(x, y).max()), 0.0, 0.0)]
    return rr.LineStrips3D([[(0.0, 0.0, 0.0), end] for end in ends], colors=[color], radii=[0.025])


def send_camera(recording: rr.RecordingStream, scenario: Scenario, room: Room, seen: Sightings) -> None:
    """Write the camera of the true vehicle, its pictures, and the detected boxes with class and score."""
    if not scenario.sees_landmarks:
        return
    model = room.camera.scaled_to(scenario.image_width)
    recording.log(CAMERA, rr.Transform3D(translation=model.position, mat3x3=R_BC), pinhole(model), static=True)
    if seen.pictures:
        times = np.array([time for time, _ in seen.pictures])
        jpegs = [np.frombuffer(jpeg, np.uint8) for _, jpeg in seen.pictures]
        columns = rr.EncodedImage.columns(blob=jpegs, media_type=["image/jpeg"] * len(jpegs))
        recording.send_columns(PICTURE, indexes=[time_column(times)], columns=columns)
    if seen.boxes:
        _send_boxes(recording, room, seen)


def pinhole(model: CameraModel) -> rr.Pinhole:
    """Return the camera with the corner of the first pixel as the origin of pixel coordinates."""
    center = [model.center[0] + HALF_PIXEL, model.center[1] + HALF_PIXEL]
    return rr.Pinhole(
        focal_length=[model.focal_length, model.focal_length * model.aspect],
        principal_point=center,
        width=model.width,
        height=model.height,
        camera_xyz=rr.ViewCoordinates.RDF,
        image_plane_distance=PICTURE_AT,
    )


def _send_boxes(recording: rr.RecordingStream, room: Room, seen: Sightings) -> None:
    """Write the boxes of each picture as one row; a picture without boxes also has a row, which clears the view."""
    rows = np.concatenate([found for _, found in seen.boxes])
    labels = [f"{room.classes[int(label)]} {score:.2f}" for label, score in rows[:, :2].tolist()]
    low, high = rows[:, 2:4] + HALF_PIXEL, rows[:, 4:6] + HALF_PIXEL
    columns = rr.Boxes2D.columns(
        centers=(low + high) / 2, half_sizes=(high - low) / 2, labels=labels, class_ids=rows[:, 0].astype(int)
    )
    parted = columns.partition(lengths=[len(found) for _, found in seen.boxes])
    times = np.array([time for time, _ in seen.boxes])
    recording.send_columns(BOXES, indexes=[time_column(times)], columns=parted)


def time_column(times: np.ndarray) -> rr.TimeColumn:
    """Return the timeline's values at times (n) [s], in whole nanoseconds as in the logs."""
    return rr.TimeColumn(TIMELINE, duration=np.array([to_ns(t) for t in times.tolist()], dtype="timedelta64[ns]"))


def send_series(recording: rr.RecordingStream, path: str, series: Series) -> None:
    """Write time series; rows with a value that is not finite are left out."""
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


def send_room(recording: rr.RecordingStream, room: Room) -> None:
    """Write the surveyed room under the path world/room."""
    recording.log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    rgba = [(c.r(), c.g(), c.b()) for c in (class_color(room, name) for name in room.classes)]
    colors = [tuple(round(255 * part) for part in color) for color in rgba]
    classes = [(i, name, color) for i, (name, color) in enumerate(zip(room.classes, colors, strict=True))]
    recording.log("world", rr.AnnotationContext(classes), static=True)
    low, high = np.array(room.interior.min), np.array(room.interior.max)
    recording.log("world/room", rr.Boxes3D(mins=[low], sizes=[high - low], colors=[ROOM_GREY]), static=True)
    walls, stands = room.wall_boxes, room.stand_cylinders
    if len(walls):
        boxes = rr.Boxes3D(
            centers=walls[:, 0:3],
            half_sizes=walls[:, 4:7],
            quaternions=Rotation.from_euler("z", walls[:, 3:4]).as_quat(),
            colors=[WALL_RED],
            fill_mode=rr.components.FillMode.TransparentFillMajorWireframe,
        )
        recording.log("world/room/walls", boxes, static=True)
    if len(stands):
        centers = np.column_stack([stands[:, 0:2], stands[:, 3] / 2])
        cylinders = rr.Cylinders3D(
            centers=centers,
            radii=stands[:, 2],
            lengths=stands[:, 3],
            colors=[STAND_GREY],
            fill_mode=rr.components.FillMode.Solid,
        )
        recording.log("world/room/stands", cylinders, static=True)
    anchors = rr.Points3D(
        room.anchor_positions,
        colors=[ANCHOR_YELLOW],
        radii=[ANCHOR_RADIUS],
        labels=[f"anchor_{i}" for i in range(len(room.anchors))],
    )
    recording.log("world/room/anchors", anchors, static=True)
    if room.landmarks:
        _send_landmarks(recording, room)


def _send_landmarks(recording: rr.RecordingStream, room: Room) -> None:
    sizes = np.array([landmark.size or room.landmark_size[landmark.label] for landmark in room.landmarks])
    boxes = rr.Boxes3D(
        centers=room.landmark_positions,
        sizes=sizes,
        quaternions=Rotation.from_euler("z", [[landmark.yaw] for landmark in room.landmarks]).as_quat(),
        class_ids=room.landmark_labels.astype(int),
        labels=[landmark.label for landmark in room.landmarks],
    )
    recording.log("world/room/landmarks", boxes, static=True)
