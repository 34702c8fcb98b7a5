"""Association against brute force over all pairings, and what it must refuse."""

from itertools import permutations, product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import chi2

from ortilo_drake.model.equations import rotation_matrix
from ortilo_drake.model.pinhole import box_center, extent_box
from ortilo_drake.model.room import load_room
from ortilo_drake.model.signals import DETECTION_SIZE, DETECTIONS_SIZE, PAYLOAD
from ortilo_drake.onboard.landmarks.landmark_association import associate, innovation_covariance
from ortilo_drake.onboard.landmarks.landmark_association import squared_distance as kernel_distance

ROOM = load_room()
CAMERA = ROOM.camera.scaled_to(320).constants
OUTLINE = 0.5 * np.array([0.5, 0.5, 1.9]) * list(product((-1.0, 1.0), repeat=3))  # a person's box
PERSON, DOG = 0.0, 1.0
GATE = float(chi2.ppf(0.999, 2))
ROW = np.array([[5.0, 1.0, 1.0], [5.2, 0.4, 1.0], [5.0, -0.3, 1.0], [5.5, -1.2, 1.0]])  # persons side by side


def estimate(p_WB=(0.0, 0.0, 1.5), rpy=(0.01, 0.02, 0.03)) -> np.ndarray:
    return np.concatenate([p_WB, rpy, np.zeros(9)])


def covariance(position_sd: float, angle_sd: float = 0.005) -> np.ndarray:
    return np.diag([position_sd**2] * 3 + [angle_sd**2] * 3 + [1.0] * 9).ravel()


def box_of(p_WL, x, outline=OUTLINE) -> np.ndarray:
    box = np.empty(4)
    assert extent_box(np.asarray(p_WL), outline, x[:3], rotation_matrix(x[3:6]), CAMERA, box)
    return box


def message(rows) -> np.ndarray:
    """Detections from (label, box) pairs."""
    content = np.zeros(DETECTIONS_SIZE)
    content[0] = 1.0
    content[PAYLOAD::DETECTION_SIZE] = -1.0
    for i, (label, box) in enumerate(rows):
        content[PAYLOAD + 6 * i : PAYLOAD + 6 * i + 6] = [label, 1.0, *box]
    return content


def run(rows, xhat, P, positions=ROW, labels=None, sd: float = 1.0):
    positions = np.asarray(positions, dtype=float)
    labels = np.full(len(positions), PERSON) if labels is None else labels
    outlines = np.tile(OUTLINE, (len(positions), 1, 1))
    return associate(message(rows), xhat, P, positions, outlines, labels, CAMERA, sd, GATE)[:2]


def squared_distance(box, i: int, xhat, P, sd: float) -> float:
    z, J = np.empty(2), np.empty((2, 6))
    assert box_center(ROW[i], OUTLINE, xhat[:3], xhat[3:6], rotation_matrix(xhat[3:6]), CAMERA, z, J)
    e = 0.5 * (box[:2] + box[2:]) - z
    return float(e @ np.linalg.solve(J @ P.reshape(15, 15)[:6, :6] @ J.T + sd**2 * np.eye(2), e))


@given(st.integers(0, 10**6), st.tuples(st.floats(0.1, 10.0), st.floats(0.1, 10.0)))
def test_the_innovation_covariance_and_its_distance_are_dense_algebras(seed, sd):
    rng = np.random.default_rng(seed)
    J, root, e = rng.normal(size=(2, 6)), rng.normal(size=(6, 6)), rng.normal(size=2)
    S = J @ (root @ root.T) @ J.T + np.diag(sd) ** 2
    S_uu, S_uv, S_vv = innovation_covariance(J, root @ root.T, np.array(sd))
    np.testing.assert_allclose([[S_uu, S_uv], [S_uv, S_vv]], S, rtol=1e-9, atol=1e-9 * S.max())
    assert kernel_distance(*e, S_uu, S_uv, S_vv) == pytest.approx(e @ np.linalg.solve(S, e), rel=1e-6)


@pytest.mark.parametrize("seed", range(20))
def test_repeated_class_agrees_with_brute_force(seed):
    """Three boxes, four persons of one class: the least sum of d^2 over all ways, unpaired ones at the gate."""
    rng = np.random.default_rng(seed)
    truth, P, sd = estimate(), covariance(0.25), 2.0
    xhat = truth.copy()
    xhat[:3] += rng.normal(0.0, 0.25, 3)
    seen = np.sort(rng.choice(4, 3, replace=False))
    boxes = [box_of(ROW[i], truth) + rng.normal(0.0, sd, 4) for i in seen]
    d2 = np.array([[squared_distance(box, i, xhat, P, sd) for i in range(4)] for box in boxes])
    # One of four landmarks, or none (-1), for each box; an unpaired landmark costs the gate.
    best = None
    for way in set(permutations([0, 1, 2, 3, -1, -1, -1], 3)):
        pairs = [(j, i) for j, i in enumerate(way) if i >= 0]
        if all(d2[j, i] <= GATE for j, i in pairs):
            cost = sum(d2[j, i] for j, i in pairs) + GATE * (4 - len(pairs))
            best = (
                min(best, (cost, sorted((i, j) for j, i in pairs)))
                if best
                else (cost, sorted((i, j) for j, i in pairs))
            )
    chosen, centers = run([(PERSON, box) for box in boxes], xhat, P, sd=sd)
    assert best is not None
    assert chosen.tolist() == [i for i, _ in best[1]]
    expected = [0.5 * (boxes[j][:2] + boxes[j][2:]) for _, j in best[1]]
    np.testing.assert_array_equal(centers, np.reshape(expected, (-1, 2)))


@settings(deadline=None)
@given(st.permutations(range(5)), st.floats(-0.2, 0.2), st.floats(-0.2, 0.2))
def test_the_order_of_rows_does_not_matter(order, dx, dy):
    truth, xhat = estimate(), estimate((dx, dy, 1.5))
    rows = [(PERSON, box_of(p, truth)) for p in ROW] + [(DOG, np.array([20.0, 30.0, 60.0, 70.0]))]
    chosen, centers = run(rows, xhat, covariance(0.2))
    shuffled, same = run([rows[k] for k in order], xhat, covariance(0.2))
    assert chosen.tolist() == shuffled.tolist()
    assert centers.tolist() == same.tolist()


def test_a_good_estimate_finds_every_landmark():
    truth = estimate()
    chosen, centers = run([(PERSON, box_of(p, truth)) for p in ROW[::-1]], truth, covariance(0.05))
    assert chosen.tolist() == [0, 1, 2, 3]
    expected = [0.5 * (box_of(p, truth)[:2] + box_of(p, truth)[2:]) for p in ROW]
    np.testing.assert_allclose(centers, expected, atol=1e-12)


def shifted(box, du: float = 0.0, dv: float = 0.0) -> np.ndarray:
    return np.add(box, (du, dv, du, dv))


@pytest.mark.parametrize(
    ("row", "found"),
    [
        ((PERSON, shifted(box_of(ROW[2], estimate()), 2.0)), 1),
        ((DOG, box_of(ROW[2], estimate())), 0),  # another class
        ((PERSON, shifted(box_of(ROW[2], estimate()), 40.0)), 0),  # outside the gate
        ((PERSON, shifted(box_of(ROW[2], estimate()), 0.0, 40.0)), 0),
        ((PERSON, box_of(ROW[2], estimate(), OUTLINE * 1.7)), 0),  # larger than a person there
        ((PERSON, box_of(ROW[2], estimate(), OUTLINE / 1.7)), 0),
        ((PERSON, box_of(ROW[2], estimate(), OUTLINE * 1.4)), 1),
    ],
)
def test_what_is_refused(row, found):
    chosen, centers = run([row], estimate(), covariance(0.05), positions=ROW[2:3])
    assert len(chosen) == len(centers) == found


def test_a_box_is_given_to_a_landmark_of_its_own_class():
    """Side by side, as large as each other, and the boxes' classes the other way round."""
    truth, wide = estimate(), covariance(5.0, 0.5)
    there = [(PERSON, box_of(ROW[0], truth)), (DOG, box_of(ROW[1], truth))]
    for labels, chosen in [((PERSON, DOG), [0, 1]), ((DOG, PERSON), [1, 0])]:
        found, centers = run(there, truth, wide, positions=ROW[:2], labels=np.array(labels))
        assert found.tolist() == [0, 1]
        middles = [0.5 * (there[j][1][:2] + there[j][1][2:]) for j in chosen]
        np.testing.assert_allclose(centers, middles, atol=1e-12)
    # With a tight estimate neither is where the other class is expected.
    assert len(run(there, truth, covariance(0.01), positions=ROW[:2], labels=np.array([DOG, PERSON]))[0]) == 0


@pytest.mark.parametrize("edge", range(4))
def test_a_box_at_the_border_is_discarded(edge):
    """A person at the edge of the image, predicted exactly: usable 3 px from the border, not at it."""
    truth = estimate(rpy=(0.0, 0.0, 0.0))
    box = box_of(ROW[1], truth)
    border = np.array([-0.5, -0.5, 319.5, 239.5])[edge]
    outward = -1.0 if edge < 2 else 1.0
    for gap, found in [(3.0, 1), (1.0, 0), (0.0, 0)]:
        near_border = box.copy()
        near_border[edge % 2], near_border[2 + edge % 2] = box[edge % 2], box[2 + edge % 2]
        shift = border - outward * gap - box[edge]
        near_border[edge % 2] += shift
        near_border[2 + edge % 2] += shift
        wide = covariance(5.0, 0.5)  # wide enough to take it anywhere
        assert len(run([(PERSON, near_border)], truth, wide, positions=ROW[1:2])[0]) == found, gap


@pytest.mark.parametrize("towards", [(0.0, 1.0), (0.0, -1.0), (1.0, 0.0), (-1.0, 0.0)])
def test_who_is_expected_far_outside_the_image_is_not_looked_for(towards):
    """However unsure the estimate: half an image beyond the border is as far as a landmark is taken into account."""
    half = 0.5 * CAMERA.image / CAMERA.f  # tangents of the image's half angles, straight ahead
    truth, wide = estimate(rpy=(0.0, 0.0, 0.0)), covariance(5.0, 0.5)
    for images, found in [(0.9, 1), (1.1, 1), (1.9, 1), (2.1, 0)]:
        depth = 5.0
        y, z = images * depth * half * towards
        at = truth[:3] + CAMERA.p_BC * [1.0, 0.0, 0.0] + [depth, y, z]
        box = box_of(truth[:3] + CAMERA.p_BC + [depth, 0.0, 0.0], truth)
        assert len(run([(PERSON, box)], truth, wide, positions=at[None])[0]) == found, images


def test_landmarks_behind_and_no_boxes_are_no_trouble():
    truth = estimate()
    behind = np.array([[-5.0, 0.0, 1.0]])
    assert len(run([(PERSON, box_of(ROW[2], truth))], truth, covariance(0.2), positions=behind)[0]) == 0
    chosen, centers = run([], truth, covariance(0.2))
    assert chosen.shape == (0,)
    assert centers.shape == (0, 2)
