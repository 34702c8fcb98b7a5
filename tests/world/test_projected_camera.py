"""The pinhole model against OpenCV and finite differences; the camera against OpenCV's boxes and its own rates."""

import cv2
import numpy as np
import pytest
import yaml
from drake_box import PlayedBox
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy import stats
from scipy.spatial.transform import Rotation

from ortilo_drake.model import pinhole
from ortilo_drake.model.equations import rotation_matrix
from ortilo_drake.model.room import Room, load_room
from ortilo_drake.model.signals import DETECTION_SIZE, MAX_DETECTIONS, PAYLOAD
from ortilo_drake.model.typed_yaml import InputError, validate
from ortilo_drake.scenario import Camera as Settings
from ortilo_drake.scenario.camera import MeasuredErrors, ParametricErrors
from ortilo_drake.training.calibration.measured_errors import slow_correlation
from ortilo_drake.world.sensors.camera_calibration import QUANTILES, load_calibration
from ortilo_drake.world.sensors.camera_tables import look_up
from ortilo_drake.world.sensors.projected_camera import camera_box, poisson

H = 1.0 / 30.0
ROOM = load_room()
CAMERA = ROOM.camera.scaled_to(320).constants
P_BC, F, C, *_ = CAMERA
NO_ERRORS = ParametricErrors(kind="parametric", edge_sd=0.0, miss_base=0.0, miss_per_metre=0.0, false_boxes=0.0)
POSES = [(0.0, 0.0), (3.5, 0.9), (6.0, 1.8), (9.0, 0.5), (13.0, -2.3), (17.0, -2.2)]


def room_with(landmarks, walls=(), stands=()) -> Room:
    """Return the room with other landmarks, boxes along W's axes, and obstacles."""
    changed = {
        "landmarks": [{"label": label, "position": p} for label, p in landmarks],
        "landmark_outline": {},
        "walls": walls,
        "stands": stands,
    }
    return validate(Room, ROOM.model_dump(mode="json") | changed, "test")


def given_errors(**changes) -> Settings:
    """No errors but the given ones."""
    return Settings(errors=NO_ERRORS.model_copy(update=changes))


SILENT = given_errors()


def state(p_WB, rpy=(0.0, 0.0, 0.0)) -> np.ndarray:
    return np.concatenate([p_WB, rpy, np.zeros(6)])


def camera(settings: Settings, room: Room, seed: int = 1):
    """A function (state, tick) -> rows (n, 6) of the detections that are there."""
    played = PlayedBox(camera_box(settings, room, (), H), H, seed, sent=np.zeros(1), state=np.zeros(12))

    def rows(x, tick: int = 0) -> np.ndarray:
        message = played.say(tick, state=x)
        assert message[0] == 1.0
        assert message[1] == tick * H
        table = message[PAYLOAD:].reshape(MAX_DETECTIONS, DETECTION_SIZE)
        used = int(np.sum(table[:, 0] >= 0.0))
        assert np.all(table[used:, 0] == -1.0)  # unused rows come last
        return table[:used].copy()

    return rows


def opencv_pixels(points, x) -> np.ndarray:
    R_WC = Rotation.from_euler("ZYX", x[[5, 4, 3]]).as_matrix() @ pinhole.R_BC
    p_WC = x[0:3] + Rotation.from_euler("ZYX", x[[5, 4, 3]]).apply(P_BC)
    K = np.array([[F, 0.0, C[0]], [0.0, F, C[1]], [0.0, 0.0, 1.0]])
    rvec = cv2.Rodrigues(R_WC.T)[0]
    return cv2.projectPoints(np.asarray(points, dtype=float), rvec, -R_WC.T @ p_WC, K, None)[0][:, 0]


def corners(p_WL, size) -> np.ndarray:
    grid = np.array([[i, j, k] for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)])
    return np.asarray(p_WL) + 0.5 * grid * np.asarray(size)


def opencv_box(points, x, width: int = 320, height: int = 240) -> np.ndarray:
    uv = opencv_pixels(points, x)
    return np.concatenate([uv.min(axis=0), uv.max(axis=0)]).clip(-0.5, np.array([width, height, width, height]) - 0.5)


attitudes = st.tuples(*[st.floats(-0.5, 0.5)] * 3).map(np.array)
ahead = st.tuples(st.floats(1.0, 20.0), st.floats(-8.0, 8.0), st.floats(-3.0, 3.0)).map(np.array)


@settings(deadline=None)  # the first call compiles
@given(attitudes, ahead)
def test_projection_agrees_with_opencv(rpy, p_BL):
    p_WB, R_WB = np.array([3.0, -2.0, 1.5]), rotation_matrix(rpy)
    p_WL = p_WB + R_WB @ p_BL
    u, v, depth = pinhole.project(p_WL, p_WB, R_WB, CAMERA)
    np.testing.assert_allclose([u, v], opencv_pixels([p_WL], state(p_WB, rpy))[0], rtol=1e-9, atol=1e-9)
    assert depth == pytest.approx(p_BL[0] - P_BC[0], abs=1e-9)


def test_nothing_is_projected_from_behind():
    u, v, depth = pinhole.project(np.array([-1.0, 0.0, 0.0]), np.zeros(3), np.eye(3), CAMERA)
    assert np.isnan(u)
    assert np.isnan(v)
    assert depth < 0.0


def differences(function, pose, step: float = 1e-6) -> np.ndarray:
    """Central differences of a function of [p_WB, rpy]."""
    return np.array([(function(pose + d) - function(pose - d)) / (2.0 * step) for d in step * np.eye(6)]).T


shares = st.floats(-1.0, 1.0)
sizes3 = st.tuples(*[st.floats(0.1, 1.8)] * 3).map(np.array)
shapes = st.lists(st.tuples(shares, shares, shares), min_size=1, max_size=12).map(np.array)


def turned(shape, size, yaw) -> np.ndarray:
    return Rotation.from_euler("z", yaw).apply(0.5 * size * shape)


@pytest.mark.long
@settings(deadline=None)  # the first call compiles
@given(shapes, sizes3, st.floats(-np.pi, np.pi), attitudes, ahead)
def test_a_turned_outlines_box_agrees_with_opencv(shape, size, yaw, rpy, p_BL):
    outline, p_WB, R_WB = turned(shape, size, yaw), np.array([3.0, -2.0, 1.5]), rotation_matrix(rpy)
    p_WL, box, z, J = p_WB + R_WB @ p_BL, np.empty(4), np.empty(2), np.empty((2, 6))
    in_front = bool(np.all((p_WL + outline - p_WB) @ R_WB[:, 0] - P_BC[0] >= pinhole.NEAR))
    assert pinhole.extent_box(p_WL, outline, p_WB, R_WB, CAMERA, box) == in_front
    assert pinhole.box_center(p_WL, outline, p_WB, rpy, R_WB, CAMERA, z, J) == in_front
    if in_front:
        uv = opencv_pixels(p_WL + outline, state(p_WB, rpy))
        np.testing.assert_allclose(box, [*uv.min(axis=0), *uv.max(axis=0)], rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(z, 0.5 * (uv.min(axis=0) + uv.max(axis=0)), rtol=1e-9, atol=1e-9)
        # A box centre turned into a point's pixel, for the very box, is the pixel of the landmark's position.
        pixel = pinhole.point_pixels(z[None], p_WL[None], outline[None], p_WB, R_WB, CAMERA)
        np.testing.assert_allclose(pixel, opencv_pixels([p_WL], state(p_WB, rpy)), rtol=1e-9, atol=1e-9)


def has_a_kink(values) -> bool:
    """Whether another point is about to become the outermost."""
    ordered = np.sort(values)
    return len(values) > 1 and bool(min(ordered[1] - ordered[0], ordered[-1] - ordered[-2]) < 1e-2)


@pytest.mark.long
@settings(deadline=None)  # the first call compiles
@given(shapes, sizes3, st.floats(-np.pi, np.pi), attitudes, ahead)
def test_a_box_centers_jacobian_agrees_with_finite_differences(shape, size, yaw, rpy, p_BL):
    """One point alone is its own box, so this is a point's Jacobian too."""
    outline, p_WB = turned(shape, size, yaw), np.array([3.0, -2.0, 1.5])
    p_WL, pose = p_WB + rotation_matrix(rpy) @ p_BL, np.concatenate([p_WB, rpy])
    z, J = np.empty(2), np.empty((2, 6))
    assume(pinhole.box_center(p_WL, outline, p_WB, rpy, rotation_matrix(rpy), CAMERA, z, J))
    uv = opencv_pixels(p_WL + outline, pose)
    assume(not has_a_kink(uv[:, 0]) and not has_a_kink(uv[:, 1]))

    def center(pose):
        uv = opencv_pixels(p_WL + outline, pose)
        return 0.5 * (uv.min(axis=0) + uv.max(axis=0))

    np.testing.assert_allclose(J, differences(center, pose), rtol=1e-5, atol=1e-5 * np.abs(J).max())


@pytest.mark.parametrize("p_WB", POSES)
def test_boxes_are_the_projected_outlines_and_none_is_left_out(p_WB):
    """Without walls and stands everything large and near enough is found."""
    room = validate(Room, ROOM.model_dump(mode="json") | {"walls": [], "stands": []}, "test")
    x = state((*p_WB, 1.5), (0.02, -0.03, 0.1))
    p_WC = x[:3] + rotation_matrix(x[3:6]) @ P_BC
    expected = []
    for label, p_WL, outline in zip(ROOM.landmark_labels, ROOM.landmark_positions, ROOM.landmark_outlines, strict=True):
        depth = (p_WL + outline - p_WC) @ rotation_matrix(x[3:6])[:, 0]
        if np.all(depth > pinhole.NEAR) and np.linalg.norm(p_WL - p_WC) <= NO_ERRORS.max_distance:
            box = opencv_box(p_WL + outline, x)
            if min(box[2] - box[0], box[3] - box[1]) >= NO_ERRORS.min_size:
                expected.append([label, *box])
    found = camera(SILENT, room)(x)
    assert len(expected) >= 2
    np.testing.assert_allclose(found[:, [0, 2, 3, 4, 5]], expected, atol=1e-9)
    assert np.all((found[:, 1] >= 0.0) & (found[:, 1] <= 1.0))


PERSON, HYDRANT = ("person", (6.0, 0.0, 0.99)), ("fire hydrant", (6.0, 0.0, 0.3))


def test_a_wall_hides_and_only_if_it_stands_between():
    x = state((0.0, 0.0, 1.5))
    for wall, seen in [((3.0, 0.0, 0.0), 0), ((3.0, 3.0, 0.0), 1), ((10.0, 0.0, 0.0), 1), ((-3.0, 0.0, 0.0), 1)]:
        assert len(camera(SILENT, room_with([PERSON], walls=[wall]))(x)) == seen, wall


def test_a_stand_hides_what_is_low_and_narrow():
    x = state((0.0, 0.0, 1.0))
    assert len(camera(SILENT, room_with([HYDRANT], stands=[(5.0, 0.0)]))(x)) == 0
    assert len(camera(SILENT, room_with([HYDRANT], stands=[(5.0, 0.6)]))(x)) == 1
    assert len(camera(SILENT, room_with([PERSON], stands=[(5.0, 0.0)]))(x)) == 0
    everything = given_errors(min_visible=0.3)
    assert len(camera(everything, room_with([PERSON], stands=[(5.0, 0.0)]))(x)) == 1


@pytest.mark.parametrize(
    ("landmark", "seen"),
    [
        (("person", (6.0, 0.0, 0.99)), 1),
        (("person", (12.5, 0.0, 0.99)), 0),  # beyond max_distance
        (("clock", (9.0, 0.0, 1.5)), 0),  # 0.35 m at 9 m: 5.8 px, less than min_size
        (("clock", (7.0, 0.0, 1.5)), 1),
        (("person", (-6.0, 0.0, 0.99)), 0),  # behind
        (("person", (4.0, 6.0, 0.99)), 0),  # aside of the image
        (("person", (0.2, 0.0, 0.99)), 0),  # around the camera
    ],
)
def test_limits(landmark, seen):
    assert len(camera(SILENT, room_with([landmark]))(state((0.0, 0.0, 1.5)))) == seen


def test_a_cut_box_keeps_touching_the_border():
    noisy = given_errors(edge_sd=2.0)
    rows = camera(noisy, room_with([("person", (2.0, 2.0, 0.99))]))
    boxes = np.array([rows(state((0.0, 0.0, 1.5)), tick)[0, 2:] for tick in range(200)])
    assert np.all(boxes[:, 0] == -0.5)
    assert np.all(boxes[:, 3] == 239.5)
    assert np.std(boxes[:, 2]) > 1.0


def test_miss_rate_and_edge_noise():
    noisy = given_errors(edge_sd=1.3, miss_base=0.05, miss_per_metre=0.03)
    rows, x = camera(noisy, room_with([PERSON])), state((0.0, 0.0, 1.5))
    messages = [rows(x, tick) for tick in range(3000)]
    d = np.linalg.norm(np.array(PERSON[1]) - x[:3] - P_BC)
    found = sum(len(message) for message in messages)
    assert stats.binomtest(3000 - found, 3000, 0.05 + 0.03 * d).pvalue > 1e-3
    boxes = np.array([message[0, 2:] for message in messages if len(message)])
    errors = (boxes - opencv_box(corners(PERSON[1], ROOM.landmark_size["person"]), x)) / 1.3
    for edge in errors.T:
        assert stats.kstest(edge, "norm").pvalue > 1e-3
    correlation = np.corrcoef(errors.T) - np.eye(4)
    assert np.abs(correlation).max() < 4.0 / np.sqrt(found)


def test_false_boxes_are_poisson_and_within_the_image():
    false = given_errors(false_boxes=0.7)
    others = [("dog", (-5.0, 0.0, 0.3)), ("cat", (-6.0, 0.0, 0.3))]
    rows, x = camera(false, room_with([PERSON, *others])), state((0.0, 0.0, 1.5))
    messages = [rows(x, tick)[1:] for tick in range(2000)]
    counts = np.array([len(message) for message in messages])
    observed = [np.sum(counts == k) for k in range(3)] + [np.sum(counts >= 3)]
    expected = [2000 * stats.poisson.pmf(k, 0.7) for k in range(3)] + [2000 * stats.poisson.sf(2, 0.7)]
    assert stats.chisquare(observed, expected).pvalue > 1e-3
    table = np.concatenate(messages)
    assert set(table[:, 0]) == {0.0, 1.0, 2.0}  # of any class
    assert np.all(table[:, 2:4] >= -0.5)
    assert np.all(table[:, 4:] <= [319.5, 239.5])
    assert np.all(table[:, 4:] > table[:, 2:4])


@settings(deadline=None)  # the first call compiles
@given(st.floats(0.0, 0.9999), st.floats(0.0, 5.0))
def test_poisson_agrees_with_scipy(u, mean):
    k = poisson(u, mean, 100)
    # At a step of the distribution the last bit may decide: u lies within the step, or on its edge.
    assert stats.poisson.cdf(k, mean) >= u - 1e-12
    assert k == 0 or stats.poisson.cdf(k - 1, mean) <= u + 1e-12


def test_noise_belongs_to_the_landmark_the_seed_and_the_tick(tmp_path):
    defaults, x = measured(tmp_path, **{"false_boxes.mean": 0.0}), state((0.0, 0.0, 1.5))
    three = [PERSON, ("dog", (7.0, 2.0, 0.3)), ("chair", (8.0, -2.0, 0.4))]
    two = [PERSON, ("dog", (-7.0, 2.0, 0.3)), ("chair", (8.0, -2.0, 0.4))]  # the dog is behind
    a, b, other = (
        camera(defaults, room_with(three)),
        camera(defaults, room_with(two)),
        camera(defaults, room_with(three), seed=2),
    )
    for tick in range(100):
        without_dog = [row.tolist() for row in a(x, tick) if row[0] != 1.0]
        assert without_dog == b(x, tick).tolist()
    assert a(x, 5).tolist() == a(x, 5).tolist()
    assert a(x, 5).tolist() != a(x, 6).tolist()
    assert a(x, 5).tolist() != other(x, 5).tolist()


def test_more_boxes_than_rows_are_left_out():
    crowd = [("person", (6.0, -1.0 + 0.05 * i, 0.99)) for i in range(40)]
    many = given_errors(false_boxes=5.0)
    assert len(camera(many, room_with(crowd))(state((0.0, 0.0, 1.5)))) == MAX_DETECTIONS


def measured(folder, **changes) -> Settings:
    """The shipped calibration with changes by dotted name, written to a file of its own."""
    data = load_calibration(MeasuredErrors()).model_dump(mode="json")
    for name, value in changes.items():
        *groups, last = name.split(".")
        group = data
        for key in groups:
            group = group[key]
        assert last in group
        group[last] = value
    file = folder / "calibration.yaml"
    file.write_text(yaml.safe_dump(data))
    return Settings(errors=MeasuredErrors(file=str(file)))


@pytest.mark.family
@pytest.mark.parametrize("distance", [2.5, 6.0, 9.3])
def test_landmarks_are_found_at_the_measured_rates(tmp_path, distance):
    distances, rates = [1.0, 4.0, 8.0, 20.0], [0.95, 0.8, 0.5, 0.1]
    changes = {"false_boxes.mean": 0.0, "found.distance": distances, "slow_misses.share": 0.0}
    table = {name: rates if name == "other" else [0.0] * 4 for name in ("other", "person")}
    chosen = measured(tmp_path, **changes, **{"found.rate": table})
    x = state((0.0, 0.0, 0.3))
    dog = tuple(np.array([distance, 0.0, 0.0]) + x[:3] + P_BC)
    rows = camera(
        chosen, room_with([("dog", dog), ("person", (8.0, 2.0, 1.0))])
    )  # no dog in the table: one of the others
    found = [rows(x, tick) for tick in range(2000)]
    assert all(set(message[:, 0]) <= {0.0} for message in found)
    expected = np.interp(distance, distances, rates)
    assert stats.binomtest(sum(map(len, found)), 2000, expected).pvalue > 1e-3


@pytest.mark.long
@pytest.mark.parametrize(("width", "quantity"), [(320, 0), (320, 1), (320, 2), (320, 3), (640, 0)])
def test_boxes_err_by_the_measured_quantiles(tmp_path, width, quantity):
    """Errors against the file's own table, by SciPy's distribution of a normal number mapped through it."""
    changes = {"false_boxes.mean": 0.0, "slow_errors.share": 0.0, "errors.size": [1.0, 300.0]}
    sizes = {"errors.center": [0.5, 0.5], "errors.extent": [1.0, 1.0]}
    chosen = measured(tmp_path, **changes, **sizes)
    calibration = load_calibration(chosen.errors)
    rows, x = camera(chosen.model_copy(update={"width": width}), room_with([PERSON])), state((0.0, 0.0, 1.5))
    boxes = np.array([row[2:] for tick in range(4000) for row in rows(x, tick)])
    P = ROOM.camera.scaled_to(width).constants
    box = np.empty(4)
    pinhole.extent_box(np.array(PERSON[1]), corners((0, 0, 0), ROOM.landmark_size["person"]), x[:3], np.eye(3), P, box)
    axis, e = quantity % 2, (boxes - box) / (width / 320)
    low, high = e[:, axis], e[:, 2 + axis]
    errors = 0.5 * (low + high) / 0.5 if quantity < 2 else high - low
    expected = np.array(calibration.errors.quantiles[QUANTILES[quantity]])
    normal, growth = np.array(calibration.errors.normal), calibration.errors.visible_growth[-1]

    def cdf(e):
        return stats.norm.cdf(np.interp(np.asarray(e) / growth, expected, normal, left=-9.0, right=9.0))

    inside = (errors > growth * expected[0]) & (errors < growth * expected[-1])  # the table is constant beyond
    assert inside.mean() > 0.99
    edges = [stats.norm.cdf(normal[0]), stats.norm.cdf(normal[-1])]
    assert stats.kstest(errors[inside], lambda e: (cdf(e) - edges[0]) / (edges[1] - edges[0])).pvalue > 1e-3


@pytest.mark.long
def test_what_is_partly_hidden_is_found_less_often_and_errs_more(tmp_path):
    """A wall whose edge passes between the person's middle and its left side: 4 of 9 points hidden.

    The chance to be found is 0.2 + 0.6 * 5/9 then, the errors' growth 5 - 4 * 5/9; in the open 0.8 and 1.
    """
    distances = load_calibration(MeasuredErrors()).found.distance
    changes = {"false_boxes.mean": 0.0, "slow_misses.share": 0.0, "slow_errors.share": 0.0}
    rates = {"found.rate": {"other": [1.0] * len(distances)}, "found.visible": [0.0, 1.0]}
    hidden = {"found.visible_factor": [0.2, 0.8], "errors.visible_growth": [5.0, 1.0]}
    straight = {f"errors.quantiles.{name}": [-10.0, 10.0] for name in QUANTILES} | {"errors.normal": [-10.0, 10.0]}
    chosen = measured(tmp_path, **changes, **rates, **hidden, **straight)
    x, ticks = state((0.0, 0.0, 1.5)), 2000
    wall = (3.0, 0.04 + 0.5 * ROOM.wall_size[1], 0.0)
    spread = []
    for walls, rate in [([wall], 0.2 + 0.6 * 5.0 / 9.0), ([], 0.8)]:
        rows = camera(chosen, room_with([PERSON], walls=walls))
        boxes = np.array([row[2:] for tick in range(ticks) for row in rows(x, tick)])
        assert stats.binomtest(len(boxes), ticks, rate).pvalue > 1e-3
        spread.append(np.sqrt(np.mean(np.var(boxes[:, :2] + boxes[:, 2:], axis=0))))
    assert spread[0] / spread[1] == pytest.approx(5.0 - 4.0 * 5.0 / 9.0, rel=0.08)


@pytest.mark.long
def test_errors_persist_as_the_file_says(tmp_path):
    """Correlation over time of one landmark's errors, against the triangle-like one of interpolated nodes."""
    changes = {"false_boxes.mean": 0.0, "slow_errors.share": 0.6, "slow_errors.period": 0.5}
    straight = {f"errors.quantiles.{name}": [-10.0, 10.0] for name in QUANTILES} | {"errors.normal": [-10.0, 10.0]}
    rates = {"found.rate": {"other": [1.0] * len(load_calibration(MeasuredErrors()).found.distance)}}
    chosen = measured(tmp_path, **changes, **straight, **rates)
    rows, x = camera(chosen, room_with([PERSON])), state((0.0, 0.0, 1.5))
    boxes = np.array([rows(x, tick)[0, 2:] for tick in range(6000)])
    e = np.column_stack([boxes[:, :2] + boxes[:, 2:], boxes[:, 2:] - boxes[:, :2]])
    e = (e - e.mean(axis=0)) / e.std(axis=0)
    for lag in (1, 5, 10, 20, 40):
        correlation = np.mean(e[lag:] * e[:-lag])  # four independent errors
        assert correlation == pytest.approx(0.6 * float(slow_correlation(np.array(lag / 15.0))), abs=0.05)
    for tick in (0, 7, 15):  # standard normal at the nodes and between them
        assert np.std(e[tick::15]) == pytest.approx(1.0, abs=0.1)


@pytest.mark.long
def test_misses_persist_as_the_file_says(tmp_path):
    distances = load_calibration(MeasuredErrors()).found.distance
    changes = {"false_boxes.mean": 0.0, "slow_misses.share": 1.0, "slow_misses.period": 1.0}
    chosen = measured(tmp_path, **changes, **{"found.rate": {"other": [0.5] * len(distances)}})
    rows, x = camera(chosen, room_with([PERSON])), state((0.0, 0.0, 1.5))
    there = np.array([len(rows(x, tick)) for tick in range(6000)])
    assert there.mean() == pytest.approx(0.5, abs=0.08)  # 200 nodes
    # Two normals of correlation rho have the same sign with the chance 1/2 + arcsin(rho) / pi (Sheppard, 1899).
    for lag in (3, 60):
        rho = float(slow_correlation(np.array(lag / 30.0)))
        assert np.mean(there[lag:] == there[:-lag]) == pytest.approx(0.5 + np.arcsin(rho) / np.pi, abs=0.08)


@given(st.lists(st.floats(-5.0, 5.0), min_size=2, max_size=8, unique=True), st.floats(-6.0, 6.0))
@settings(deadline=None)
def test_tables_are_linear_between_knots_and_constant_beyond(knots, at):
    table = np.array([np.sort(knots), np.cos(3.0 * np.sort(knots))])
    assert look_up(table, 1, at) == pytest.approx(np.interp(at, *table), abs=1e-9)


def test_the_shipped_calibration_is_of_the_rooms_classes():
    calibration = load_calibration(MeasuredErrors())
    assert set(calibration.found.rate) == {*ROOM.classes, "other"}
    assert calibration.source.width == Settings().width


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"found.distance": [1.0, 1.0]}, "needs two knots or more, rising"),
        ({"found.inside_factor": [1.0]}, "found.inside_factor: 1 values for the"),
        ({"found.rate": {"person": [1.0]}}, "found.rate: no rates for 'other' classes"),
        ({"errors.quantiles": {"width": [0.0]}}, "errors.quantiles: ['width']: must be"),
        ({"false_boxes.mean": 9.0}, "false_boxes.mean: 9.0: must be at most 5"),
        ({"slow_errors.period": 0.0}, "slow_errors.period: 0.0: must be above 0"),
    ],
)
def test_a_wrong_calibration_is_refused_in_one_line(tmp_path, change, message):
    chosen = measured(tmp_path, **change)
    with pytest.raises(InputError) as error:
        camera(chosen, ROOM)
    assert message in str(error.value)
    assert str(error.value).startswith(str(tmp_path))
    assert "\n" not in str(error.value)


def test_a_missing_calibration_is_refused_in_one_line(tmp_path):
    with pytest.raises(InputError, match="no such camera calibration"):
        camera(Settings(errors=MeasuredErrors(file=str(tmp_path / "none.yaml"))), ROOM)
