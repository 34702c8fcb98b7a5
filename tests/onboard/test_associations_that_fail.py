"""Ambiguous pairings, pairings that contradict each other, and an estimate that has to be found again."""

from itertools import product

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from scipy.stats import chi2
from seen_landmarks import CAMERA, EXACT, OUTLINES, POINTS, ROOM, boxes, centers, covariance, jacobian, state

from ortilo_drake.model.signals import DETECTION_SIZE, DETECTIONS_SIZE, PAYLOAD
from ortilo_drake.onboard.landmarks.box_fix import DOUBLINGS, joint_distance, joint_limits, jointly_compatible
from ortilo_drake.onboard.landmarks.landmark_association import ambiguous, associate
from ortilo_drake.onboard.landmarks.landmark_fix import LandmarkFix
from ortilo_drake.scenario import LandmarkFix as Settings

GATE = float(chi2.ppf(0.999, 2))
FORBIDDEN = 1.0e6
LIMITS = joint_limits(0.999, 20)
SHOWN = [0, 2, 4, 6, 8, 9]  # of the room: in the image, whole, from EXACT


def all_ways(costs: np.ndarray, n_boxes: int) -> list[tuple[float, tuple[int, ...]]]:
    """The sum and the column of each landmark, of every way to give the boxes out."""
    k = len(costs)
    ways = []
    for columns in product(range(n_boxes + 1), repeat=k):
        taken = [c for c in columns if c < n_boxes]
        if len(set(taken)) == len(taken):
            sums = [costs[i, c] if c < n_boxes else costs[i, n_boxes + i] for i, c in enumerate(columns)]
            ways.append((float(sum(sums)), columns))
    return sorted(ways)


@pytest.mark.parametrize("seed", range(30))
def test_a_pairing_is_ambiguous_where_another_in_its_place_is_nearly_as_good(seed: int) -> None:
    """Against every way there is to give three boxes to three landmarks."""
    rng = np.random.default_rng(seed)
    m, k, margin = 3, 3, 6.0
    d2 = rng.uniform(0.0, GATE, (k, m))
    d2[rng.random((k, m)) < 0.4] = FORBIDDEN
    costs = np.full((k, m + k), FORBIDDEN)
    costs[:, :m] = d2
    costs[range(k), range(m, m + k)] = GATE
    ways = all_ways(costs, m)
    best, columns = ways[0]
    column = np.array([c if c < m else m + i for i, c in enumerate(columns)])
    expected = np.zeros(k, dtype=bool)
    for total, way in ways:
        if total - best >= margin:
            continue
        for i, j in enumerate(way):
            if j < m and columns[i] != j:
                expected |= [(r == i and c < m) or c == j for r, c in enumerate(columns)]
    np.testing.assert_array_equal(ambiguous(costs, column, m, margin), expected)


@pytest.mark.long
def test_of_two_alike_side_by_side_one_box_between_them_is_left_out() -> None:
    x = state((0.0, 0.0, 1.5, 0.0, 0.0, 0.0))
    positions = np.array([[5.0, 0.15, 1.5], [5.0, -0.15, 1.5], [5.0, 2.0, 1.5]])
    outlines, labels = np.tile(OUTLINES[3], (3, 1, 1)), np.zeros(3)
    middle = boxes(x[:6], np.array([[5.0, 0.02, 1.5], positions[2]]), outlines[:2])
    message = np.zeros(DETECTIONS_SIZE)
    message[0] = 1.0
    message[PAYLOAD::DETECTION_SIZE] = -1.0
    for row, box in enumerate(middle):
        message[PAYLOAD + 6 * row : PAYLOAD + 6 * row + 6] = [0.0, 0.9, *box]
    arguments = message, x, covariance(0.2), positions, outlines, labels, CAMERA, 1.0, GATE
    assert associate(*arguments)[0].tolist() == [0, 2]
    assert associate(*arguments, margin=9.0)[0].tolist() == [2]


def test_the_joint_distance_of_right_pairings_is_chi_square() -> None:
    """Mean and spread of 4000 draws; the boxes one by one would pass as well as all together."""
    rng, J = np.random.default_rng(0), jacobian(np.array(EXACT))
    sd = rng.uniform(0.5, 2.0, len(J))
    root = 0.01 * rng.normal(size=(6, 6))
    draws = []
    for _ in range(4000):
        e = J @ root @ rng.normal(size=6) + sd * rng.normal(size=len(J))
        draws.append(joint_distance(e, J, root @ root.T, sd))
    n = len(J)
    assert np.mean(draws) == pytest.approx(n, abs=4.0 * np.sqrt(2.0 * n / 4000.0))
    assert np.mean(np.array(draws) > chi2.ppf(0.99, n)) == pytest.approx(0.01, abs=4.0 * np.sqrt(0.01 / 4000.0))


@pytest.mark.family
@pytest.mark.parametrize("bad", range(len(POINTS)))
def test_the_pairing_that_contradicts_the_others_goes(bad: int) -> None:
    """A box within its own gate, by an error that the estimate can have only if all boxes have it."""
    P, sds = covariance(0.3).reshape(15, 15)[:6, :6], np.ones((len(POINTS), 2))
    z = centers(EXACT)
    z[bad] += [14.0, 0.0]
    of_all = jacobian(np.array(EXACT)).reshape(-1, 2, 6)
    J = of_all[bad]
    alone = np.array([14.0, 0.0]) @ np.linalg.solve(J @ P @ J.T + np.eye(2), [14.0, 0.0])
    assert alone < GATE
    kept = jointly_compatible(z - centers(EXACT), of_all, P, sds, LIMITS)
    assert kept.tolist() == [i for i in range(len(POINTS)) if i != bad]
    assert len(jointly_compatible(np.zeros_like(z), of_all, P, sds, LIMITS)) == len(POINTS)


def test_of_two_landmarks_given_each_others_boxes_there_is_no_fix_and_no_harm() -> None:
    P, sds, n = covariance(0.1).reshape(15, 15)[:6, :6], np.ones((2, 2)), [3, 5]
    seen, J = centers(EXACT)[n], jacobian(np.array(EXACT)).reshape(-1, 2, 6)[n]
    kept = jointly_compatible(seen[::-1] - seen, J, P, sds, LIMITS)
    assert len(kept) < 2


def shown(pose) -> np.ndarray:
    message = np.zeros(DETECTIONS_SIZE)
    message[0] = 1.0
    message[PAYLOAD::DETECTION_SIZE] = -1.0
    box = boxes(pose, ROOM.landmark_positions[SHOWN], ROOM.landmark_outlines[SHOWN])
    for row, (i, edges) in enumerate(zip(SHOWN, box, strict=True)):
        message[PAYLOAD + 6 * row : PAYLOAD + 6 * row + 6] = [ROOM.landmark_labels[i], 0.9, *edges]
    return message


@pytest.mark.parametrize("joint", [None, 0.999])
def test_an_estimate_that_is_worse_than_it_believes_is_found_again(joint: float | None) -> None:
    """0.4 m off with an sd of 0.05 m: refused at first, then associated by a wider and wider error."""
    system = LandmarkFix(Settings(method="pose", center_sd=1.0, joint=joint), ROOM, 320, 1.0 / 30.0)
    simulator = Simulator(system)
    context = simulator.get_mutable_context()
    xhat = state()
    xhat[1] += 0.4
    system.GetInputPort("detections").FixValue(context, shown(EXACT))
    system.GetInputPort("estimate").FixValue(context, xhat)
    system.GetInputPort("covariance").FixValue(context, covariance(0.05))
    there = []
    for tick in range(DOUBLINGS + 2):
        there.append(system.GetOutputPort("fix").Eval(context)[0] == 1.0)
        simulator.AdvanceTo((tick + 0.5) / 30.0)
    if joint is None:
        assert not any(there)
    else:
        assert not there[0]
        assert any(there)
        context.SetDiscreteState(0, [float(DOUBLINGS)])
        np.testing.assert_allclose(system.GetOutputPort("fix").Eval(context)[2:5], EXACT[:3], atol=1e-3)


@pytest.mark.long
def test_a_box_that_the_border_must_cut_is_left_out_though_it_seems_whole() -> None:
    """A bicycle 2.4 m ahead and below: the detector's box ends 4 px above the border, where the true one goes on."""
    x, size = state((0.0, 0.0, 1.5, 0.0, 0.0, 0.0)), np.array([0.5, 1.0, 1.2])
    outline = 0.5 * size * list(product((-1.0, 1.0), repeat=3))
    positions, outlines = np.array([[2.4, 0.0, 0.4]]), outline[None]
    true = boxes(x[:6], positions, outlines)[0]
    height = CAMERA.image[1]
    assert true[3] > height
    message = np.zeros(DETECTIONS_SIZE)
    message[0] = 1.0
    message[PAYLOAD::DETECTION_SIZE] = -1.0
    message[PAYLOAD : PAYLOAD + 6] = [0.0, 0.9, *true[:3], height - 4.0]
    arguments = message, x, covariance(0.1), positions, outlines, np.zeros(1), CAMERA, 3.0, GATE
    assert associate(*arguments)[0].tolist() == [0]
    assert associate(*arguments, inside=1.5)[0].tolist() == []
    up = np.array([[2.4, 0.0, 1.2]])  # whole, and still there
    message[PAYLOAD : PAYLOAD + 6] = [0.0, 0.9, *boxes(x[:6], up, outlines)[0]]
    found = associate(message, x, covariance(0.1), up, outlines, np.zeros(1), CAMERA, 3.0, GATE, inside=1.5)
    assert found[0].tolist() == [0]


@pytest.mark.long
def test_nothing_is_compatible_with_what_is_no_covariance() -> None:
    of_all, sds = jacobian(np.array(EXACT)).reshape(-1, 2, 6), np.ones((len(POINTS), 2))
    assert jointly_compatible(np.zeros((len(POINTS), 2)), of_all, -np.eye(6), sds, LIMITS).size == 0
