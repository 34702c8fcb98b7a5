"""The pinhole model against OpenCV and finite differences; the camera against OpenCV's boxes and its own rates."""

import cv2
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy import stats
from scipy.spatial.transform import Rotation

from ortilo_drake.model import pinhole
from ortilo_drake.model.equations import rotation_matrix
from ortilo_drake.model.room import Room, load_room
from ortilo_drake.model.signals import DETECTION_SIZE, MAX_DETECTIONS, PAYLOAD
from ortilo_drake.model.typed_yaml import validate
from ortilo_drake.scenario import ProjectedCamera as Settings
from ortilo_drake.world.projected_camera import ProjectedCamera, poisson

H = 1.0 / 30.0
ROOM = load_room()
CAMERA = ROOM.camera.scaled_to(320).constants
P_BC, F, C, _ = CAMERA
SILENT = Settings(edge_sd=0.0, miss_base=0.0, miss_per_metre=0.0, false_boxes=0.0)
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


def state(p_WB, rpy=(0.0, 0.0, 0.0)) -> np.ndarray:
    return np.concatenate([p_WB, rpy, np.zeros(6)])


def camera(settings: Settings, room: Room, seed: int = 1):
    """A function (state, tick) -> rows (n, 6) of the detections that are there."""
    system = ProjectedCamera(settings, room, seed, H)
    context = system.CreateDefaultContext()
    port = system.GetInputPort("state")

    def rows(x, tick: int = 0) -> np.ndarray:
        port.FixValue(context, x)
        context.SetTime(tick * H)
        message = system.GetOutputPort("detections").Eval(context)
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
        if np.all(depth > pinhole.NEAR) and np.linalg.norm(p_WL - p_WC) <= SILENT.max_distance:
            box = opencv_box(p_WL + outline, x)
            if min(box[2] - box[0], box[3] - box[1]) >= SILENT.min_size:
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
    everything = SILENT.model_copy(update={"min_visible": 0.3})
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
    noisy = SILENT.model_copy(update={"edge_sd": 2.0})
    rows = camera(noisy, room_with([("person", (2.0, 2.0, 0.99))]))
    boxes = np.array([rows(state((0.0, 0.0, 1.5)), tick)[0, 2:] for tick in range(200)])
    assert np.all(boxes[:, 0] == -0.5)
    assert np.all(boxes[:, 3] == 239.5)
    assert np.std(boxes[:, 2]) > 1.0


def test_miss_rate_and_edge_noise():
    noisy = Settings(edge_sd=1.3, miss_base=0.05, miss_per_metre=0.03, false_boxes=0.0)
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


def test_the_defaults_err_like_a_small_detector():
    """Median error of a box centre between 0.7 and 1.1 px, as measured of a small net at 320 x 240."""
    rows, x = camera(Settings(false_boxes=0.0), room_with([PERSON])), state((0.0, 0.0, 1.5))
    boxes = np.array([row[2:] for tick in range(2000) for row in rows(x, tick)])
    errors = boxes - opencv_box(corners(PERSON[1], ROOM.landmark_size["person"]), x)
    rayleigh = Settings().edge_sd / np.sqrt(2.0) * np.sqrt(2.0 * np.log(2.0))  # median of the centre's error
    assert 0.7 < rayleigh < 1.1
    median = np.median(np.linalg.norm(errors[:, :2] + errors[:, 2:], axis=1) / 2.0)
    assert median == pytest.approx(rayleigh, rel=0.08)  # three standard deviations of the median


def test_false_boxes_are_poisson_and_within_the_image():
    false = SILENT.model_copy(update={"false_boxes": 0.7})
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


def test_noise_belongs_to_the_landmark_the_seed_and_the_tick():
    defaults, x = Settings(false_boxes=0.0), state((0.0, 0.0, 1.5))
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
    many = SILENT.model_copy(update={"false_boxes": 5.0})
    assert len(camera(many, room_with(crowd))(state((0.0, 0.0, 1.5)))) == MAX_DETECTIONS
