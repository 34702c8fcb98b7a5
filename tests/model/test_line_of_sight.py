"""Lines through walls and stands against points sampled along them."""

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from pydrake.math import RotationMatrix

from ortilo_drake.model.geometry.line_of_sight import crosses_box, crosses_cylinder, is_hidden, walls_crossed
from ortilo_drake.model.room import load_room

settings.register_profile("compiled", deadline=None)  # the first example may wait for numba
settings.load_profile("compiled")

SAMPLES = 2001
WALL = np.array([2.0, -1.0, 1.5, 0.7, 1.5, 0.5, 1.5])
STAND = np.array([2.0, -1.0, 0.4, 0.86])


def in_box(points: np.ndarray, box: np.ndarray, grown: float = 0.0) -> np.ndarray:
    R_WX = RotationMatrix.MakeZRotation(box[3]).matrix()
    return np.all(np.abs((points - box[:3]) @ R_WX) <= box[4:] + grown, axis=-1)


def in_cylinder(points: np.ndarray, cylinder: np.ndarray, grown: float = 0.0) -> np.ndarray:
    aside = np.hypot(points[..., 0] - cylinder[0], points[..., 1] - cylinder[1])
    z = points[..., 2]
    return (aside <= cylinder[2] + grown) & (z >= -grown) & (z <= cylinder[3] + grown)


points = st.tuples(st.floats(-2, 6), st.floats(-5, 3), st.floats(-0.5, 4)).map(np.array)


@pytest.mark.family
@pytest.mark.parametrize(
    ("crosses", "inside", "obstacle"),
    [(crosses_box, in_box, WALL), (crosses_cylinder, in_cylinder, STAND)],
    ids=["box", "cylinder"],
)
@given(p=points, q=points)
def test_agrees_with_points_sampled_along_the_line(crosses, inside, obstacle, p, q) -> None:
    line = p + np.linspace(0, 1, SAMPLES)[:, None] * (q - p)
    between = np.linalg.norm(q - p) / (SAMPLES - 1)
    met = crosses(p, q, obstacle)
    if inside(p, obstacle) or inside(q, obstacle):
        assume(not inside(p, obstacle, 1e-9) or inside(p, obstacle, -1e-9))  # not on the surface itself
        assume(not inside(q, obstacle, 1e-9) or inside(q, obstacle, -1e-9))
        assert not met
    elif np.any(inside(line, obstacle, -1e-9)):
        assert met
    elif met:  # too short a chord for the samples: then the next sample is near
        assert np.any(inside(line, obstacle, between))


@given(p=points, q=points)
def test_is_the_same_from_both_ends(p, q) -> None:
    p, q = np.round(p, 3) + 1.2e-4, np.round(q, 3) + 3.4e-4  # no line along a face, where rounding decides
    boxes = load_room().wall_boxes
    assert walls_crossed(p, q, boxes) == walls_crossed(q, p, boxes)


@pytest.mark.long
def test_random_lines_through_the_room_meet_as_many_walls_as_the_samples_do() -> None:
    room = load_room()
    rng = np.random.default_rng(4)
    low, high = np.array(room.interior.min), np.array(room.interior.max)
    counts = []
    for _ in range(400):
        p, q = rng.uniform(low, high, (2, 3))
        line = p + np.linspace(0, 1, SAMPLES)[:, None] * (q - p)
        between = np.linalg.norm(q - p) / (SAMPLES - 1)
        least = most = 0
        for box in room.wall_boxes:
            if in_box(p, box) or in_box(q, box):
                continue
            least += bool(np.any(in_box(line, box)))
            most += bool(np.any(in_box(line, box, between)))
        counts.append(walls_crossed(p, q, room.wall_boxes))
        assert least <= counts[-1] <= most
        stands = [c for c in room.stand_cylinders if not in_cylinder(p, c) and not in_cylinder(q, c)]
        if counts[-1] or any(np.any(in_cylinder(line, c)) for c in stands):
            assert is_hidden(p, q, room.wall_boxes, room.stand_cylinders)
        elif not any(np.any(in_cylinder(line, c, between)) for c in stands):
            assert not is_hidden(p, q, room.wall_boxes, room.stand_cylinders)
    assert set(counts) >= {0, 1, 2}  # the sample means something


def test_a_wall_that_holds_an_anchor_does_not_count() -> None:
    room = load_room()
    mounted = [
        (anchor, box) for anchor in room.anchor_positions for box in room.wall_boxes if in_box(anchor, box, -1e-6)
    ]
    assert mounted  # some of the room's anchors are inside a wall
    for anchor, box in mounted:
        for direction in np.eye(3)[:2]:
            assert walls_crossed(anchor, anchor + 5 * direction, box[None]) == 0
            assert walls_crossed(anchor - 5 * direction, anchor + 5 * direction, box[None]) == 1


def test_lines_along_the_axes_need_no_division() -> None:
    box = np.array([[0.0, 0.0, 1.0, 0.0, 1.0, 0.5, 1.0]])
    assert walls_crossed(np.array([-3.0, 0.2, 1.0]), np.array([3.0, 0.2, 1.0]), box) == 1
    assert walls_crossed(np.array([-3.0, 0.6, 1.0]), np.array([3.0, 0.6, 1.0]), box) == 0
    assert walls_crossed(np.array([0.3, 0.1, -1.0]), np.array([0.3, 0.1, 3.0]), box) == 1
    assert walls_crossed(np.array([0.3, 0.1, 2.5]), np.array([0.3, 0.1, 3.0]), box) == 0
    assert walls_crossed(np.array([2.0, 2.0, 2.0]), np.array([2.0, 2.0, 2.0]), box) == 0
    above = np.array([0.1, 0.1, 3.0])
    assert crosses_cylinder(above, np.array([0.1, 0.1, -1.0]), np.array([0.0, 0.0, 0.2, 1.0]))
    assert not crosses_cylinder(above, np.array([0.1, 0.1, 1.1]), np.array([0.0, 0.0, 0.2, 1.0]))


def test_without_obstacles_nothing_is_hidden() -> None:
    p, q = np.zeros(3), np.ones(3)
    assert not is_hidden(p, q, np.empty((0, 7)), np.empty((0, 4)))
    assert walls_crossed(p, q, np.empty((0, 7))) == 0
