"""The surveyed room: counts and facts from the file, views of it, footprints, and what is refused."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError
from scipy.spatial.transform import Rotation

from ortilo_drake.model.footprints import Footprint, footprints
from ortilo_drake.model.room import ORTILO_ROOM, CameraModel, Room, load_room
from ortilo_drake.model.typed_yaml import InputError, validate

ROOM = load_room()
DATA: dict[str, Any] = yaml.safe_load(ORTILO_ROOM.read_text())


def room_with(**changes: Any) -> Room:
    return validate(Room, {**DATA, **changes}, "room.yaml")


def test_arrays_are_the_files_rows() -> None:
    np.testing.assert_array_equal(ROOM.anchor_positions, DATA["anchors"])
    np.testing.assert_array_equal(ROOM.landmark_positions, [item["position"] for item in DATA["landmarks"]])
    labels = [ROOM.classes[int(k)] for k in ROOM.landmark_labels]
    assert labels == [item["label"] for item in DATA["landmarks"]]
    assert len(set(ROOM.classes)) == len(ROOM.classes)
    assert ROOM.anchor_positions.shape == (12, 3)
    assert ROOM.wall_boxes.shape == (len(DATA["walls"]), 7)
    assert ROOM.stand_cylinders.shape == (len(DATA["stands"]), 4)


def test_everything_surveyed_is_inside_or_in_the_outer_walls() -> None:
    low, high = np.array(ROOM.interior.min), np.array(ROOM.interior.max)
    for points in (ROOM.anchor_positions, ROOM.landmark_positions):
        assert np.all((low <= points) & (points <= high))
    assert np.all((ROOM.wall_boxes[:, :3] > low - 1.0) & (ROOM.wall_boxes[:, :3] < high + 1.0))


def corners(box: np.ndarray) -> np.ndarray:
    """The corners seen from above of a wall (x, y, z, yaw, half sizes), each turned by hand."""
    x, y, _, yaw, a, b, _ = box
    turned = [(sx * a, sy * b) for sx in (-1, 1) for sy in (-1, 1)]
    return np.array([(x + p * np.cos(yaw) - q * np.sin(yaw), y + p * np.sin(yaw) + q * np.cos(yaw)) for p, q in turned])


def named(name: str, room: Room = ROOM) -> list[Footprint]:
    return [f for f in footprints(room) if f.name == name]


def test_a_walls_footprint_is_the_rectangle_about_its_turned_corners() -> None:
    walls = named("wall")
    assert len(walls) == len(ROOM.walls)
    for footprint, box in zip(walls, ROOM.wall_boxes, strict=True):
        np.testing.assert_allclose(footprint.low, corners(box).min(axis=0), atol=1e-12)
        np.testing.assert_allclose(footprint.high, corners(box).max(axis=0), atol=1e-12)
        assert footprint.radius == 0.0
        assert footprint.top == pytest.approx(ROOM.wall_size[2])


def test_a_landmarks_footprint_is_round_and_as_high_as_its_outline() -> None:
    """The fire hydrant at (4.53, 0.42) is 0.18 m wide and, centred at 0.169 m, 0.338 m high."""
    hydrant = named("fire hydrant")[0]
    assert hydrant.low == hydrant.high == pytest.approx((4.53162, 0.417347))
    assert hydrant.radius == pytest.approx(0.09, rel=0.05)
    assert hydrant.top == pytest.approx(0.169462 + 0.169, rel=0.02)


@pytest.mark.long
@given(st.floats(-np.pi, np.pi))
def test_a_wall_at_any_angle_is_within_its_footprint(yaw: float) -> None:
    room = room_with(walls=[[3.0, 1.0, yaw]])
    (wall,) = named("wall", room)
    found = corners(room.wall_boxes[0])
    np.testing.assert_allclose(wall.low, found.min(axis=0), atol=1e-12)
    np.testing.assert_allclose(wall.high, found.max(axis=0), atol=1e-12)


def test_stands_are_discs_and_the_rest_reaches_its_size() -> None:
    for stand, (x, y) in zip(named("stand"), ROOM.stands, strict=True):
        assert stand == Footprint("stand", (x, y), (x, y), ROOM.stand_radius, ROOM.stand_height)
    for label in ROOM.classes:
        sizes = ROOM.landmark_sizes[ROOM.landmark_labels == ROOM.classes.index(label)]
        found = [np.subtract(f.high, f.low) + 2 * f.radius for f in named(label)[-len(sizes) :]]  # after the furniture
        np.testing.assert_allclose(found, sizes[:, :2], atol=1e-12)
    before = len(ROOM.walls) + len(ROOM.stands)
    for footprint, (kind, x, y, z, *_) in zip(footprints(ROOM)[before:], ROOM.furniture, strict=False):
        size = ROOM.furniture_size[kind]
        assert (footprint.name, footprint.top) == (kind, z + size[2])
        np.testing.assert_allclose(np.subtract(footprint.high, footprint.low) + 2 * footprint.radius, size[:2])
        np.testing.assert_allclose(np.add(footprint.high, footprint.low) / 2, (x, y), atol=1e-12)
    n = before + len(ROOM.furniture) + len(ROOM.landmarks)
    assert len(footprints(ROOM)) == n


def test_a_class_without_an_outline_has_the_corners_of_its_box() -> None:
    landmarks = [{k: item[k] for k in ("label", "position")} for item in DATA["landmarks"]]
    room = room_with(landmarks=landmarks, landmark_outline={})
    sizes = np.array([DATA["landmark_size"][item["label"]] for item in landmarks])
    grid = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
    np.testing.assert_array_equal(room.landmark_outlines, grid * sizes[:, None])
    np.testing.assert_array_equal(room.landmark_sizes, sizes)


shares = st.floats(-1.0, 1.0)
outlines = st.lists(st.tuples(shares, shares, shares), min_size=4, max_size=9)
sizes3 = st.tuples(*[st.floats(0.05, 2.0)] * 3)


@pytest.mark.long
@given(outlines, st.none() | sizes3, st.floats(-10.0, 10.0))
def test_an_outline_is_scaled_and_turned_and_filled_up(
    points: list[tuple[float, float, float]], size: tuple[float, float, float] | None, yaw: float
) -> None:
    dog: dict[str, Any] = {"label": "dog", "position": [1.0, 2.0, 0.3], "yaw": yaw, "size": size}
    room = room_with(landmarks=[dog, {**dog, "label": "cat"}], landmark_outline={"dog": points})
    box, found = room.landmark_outlines[1], room.landmark_outlines[0]
    assert len(box) == len(found) == max(len(points), 8)
    half = 0.5 * np.array(size or DATA["landmark_size"]["dog"])
    expected = Rotation.from_euler("z", yaw).apply(np.array(points) * half)
    np.testing.assert_allclose(found[: len(points)], expected, atol=1e-12)
    assert np.all(found[len(points) :] == found[len(points) - 1])
    # The extent along W's axes is the least that holds all points, about the surveyed centre.
    np.testing.assert_allclose(room.landmark_sizes[0], 2.0 * np.abs(expected).max(axis=0), atol=1e-12)


def test_a_landmark_is_turned_like_the_same_piece_of_furniture() -> None:
    kinds = {
        "person": "person_standing_0",
        "fire hydrant": "fire_hydrant",
        "dog": "dog_beagle",
        "potted plant": "plant",
    }
    kinds |= {"chair": "office_chair", "bicycle": "bicycle", "bird": "bird1", "cat": "cat1", "clock": "clock"}
    for landmark in ROOM.landmarks:
        x, y, _ = landmark.position
        (yaw,) = [
            item[6]
            for item in ROOM.furniture
            if item[0] == kinds[landmark.label] and np.hypot(item[1] - x, item[2] - y) < 0.5
        ]
        assert landmark.yaw == yaw


def test_fire_hydrants_stand_on_the_floor() -> None:
    hydrants = [landmark for landmark in ROOM.landmarks if landmark.label == "fire hydrant"]
    assert len(hydrants) == 4
    for hydrant in hydrants:
        assert hydrant.size is not None
        assert hydrant.position[2] == pytest.approx(hydrant.size[2] / 2, abs=1e-3)


def test_a_camera_at_half_the_size_sees_the_same_directions() -> None:
    camera = CameraModel(width=640, height=480, focal_length=500.0, center=(319.5, 239.5), position=(0.1, 0.0, 0.0))
    half = camera.scaled_to(320)
    assert (half.width, half.height) == (320, 240)
    # The image's left and right borders lie at -1/2 and width - 1/2.
    for border in (0, 1):
        angles = [(border * c.width - 0.5 - c.center[0]) / c.focal_length for c in (camera, half)]
        assert angles[0] == pytest.approx(angles[1], rel=1e-12)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"anchors": DATA["anchors"][:2]}, ["anchors", "2 given", "at least 3"]),
        ({"anchors": []}, ["anchors", "0 given", "at least 3"]),
        ({"anchors": [[0.0, 1.0]] * 4}, ["anchors.0", "missing"]),
        ({"anchors": [[0.0, float("nan"), 1.0], *DATA["anchors"]]}, ["anchors.0.1", "nan", "finite"]),
        ({"interior": {"min": [0.0, 0.0, 0.0], "max": [5.0, -1.0, 3.0]}}, ["interior", "min y", "max y"]),
        ({"stand_radius": -0.1}, ["stand_radius", "-0.1", "above 0"]),
        ({"landmark_size": {}}, ["landmark_size", "no size for class"]),
        (
            {"landmark_outline": {"dog": [[0.0, 0.0, 1.5]] * 4}},
            ["landmark_outline.dog.0.2", "1.5", "at most"],
        ),
        ({"landmark_outline": {"dog": [[0.0, 0.0, 1.0]] * 3}}, ["landmark_outline.dog", "at least 4", "not 3"]),
        ({"landmark_outline": {"cow": [[0.0, 0.0, 1.0]] * 4}}, ["landmark_outline", "'cow'", "none of landmark_size"]),
        ({"landmarks": [{**DATA["landmarks"][0], "size": [1.0, 0.0, 1.0]}]}, ["landmarks.0.size.1", "above 0"]),
        ({"furniture_size": {}}, ["furniture_size", "no size for kind"]),
        ({"ceiling": 3.0}, ["ceiling", "unknown key"]),
        ({"camera": {**DATA["camera"], "width": 0}}, ["camera.width", "0", "at least 1"]),
        ({"camera": {**DATA["camera"], "height": 100_001}}, ["camera.height", "at most 100000"]),
        ({"furniture": [["c" * 65, 0.0, 0.0, 0.0]]}, ["furniture.0.0", "at most 64"]),
        ({"name": 7}, ["name", "7", "text"]),
    ],
)
def test_a_wrong_room_is_refused_in_one_line(changes: dict[str, Any], words: list[str]) -> None:
    with pytest.raises(InputError) as refusal:
        room_with(**changes)
    line = str(refusal.value)
    assert line.startswith("room.yaml: ")
    assert "\n" not in line
    for word in words:
        assert word in line


def test_a_missing_file_is_refused() -> None:
    with pytest.raises(InputError, match=r"^room: /nowhere/room\.yaml: no such room file$"):
        load_room(Path("/nowhere/room.yaml"))


def test_the_room_cannot_be_changed_and_equals_its_copy() -> None:
    again = room_with()
    assert again == ROOM
    assert hash(again) == hash(ROOM)
    with pytest.raises(ValidationError, match="frozen"):
        ROOM.name = "other"


@pytest.mark.parametrize("width", [100, 700, 1400])
def test_a_scaled_camera_looks_the_same_ways(width: int) -> None:
    """Shares of the image, from its border at -1/2 px on, and tangents stay; each axis has its own."""
    camera = CameraModel(width=700, height=400, focal_length=300.0, center=(340.0, 180.0), position=(0.1, 0.0, 0.0))
    scaled = camera.scaled_to(width)
    s = width / 700
    assert (scaled.width, scaled.height, scaled.position) == (width, round(400 * s), camera.position)
    assert scaled.focal_length == pytest.approx(300.0 * s)
    assert (scaled.center[0] + 0.5) / width == pytest.approx(340.5 / 700)
    assert (scaled.center[1] + 0.5) / (400 * s) == pytest.approx(180.5 / 400)


@pytest.mark.parametrize(
    ("height", "width", "taken"), [(8192, 2048, True), (8192, 2049, False), (8193, 1000, False), (1, 1, True)]
)
def test_a_picture_is_at_most_so_high_and_so_large(height: int, width: int, taken: bool) -> None:
    camera = CameraModel(width=width, height=height, focal_length=300.0, center=(1.0, 1.0), position=(0.0, 0.0, 0.0))
    if taken:
        assert camera.scaled_to(width) == camera
    else:
        with pytest.raises(InputError, match=f"are then {width} x {height} px"):
            camera.scaled_to(width)


def test_rooms_are_the_same_by_what_they_hold_whatever_was_computed_of_them() -> None:
    one = load_room()
    computed = hash(one), one.anchor_positions, one.landmark_outlines
    two, other = one.model_copy(), one.model_copy(update={"anchors": one.anchors[1:]})
    assert two == one
    assert hash(two) == computed[0]
    assert other != one
    np.testing.assert_array_equal(other.anchor_positions, computed[1][1:])
