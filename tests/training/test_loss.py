"""The training's loss: complete IoU by the paper's formula, and one decoder in training and in flight."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

torch = pytest.importorskip("torch", reason="torch is not installed: nothing can be trained")

from ortilo_drake.onboard.detector.yolo_boxes import decode  # noqa: E402
from ortilo_drake.training.network.loss import complete_iou, predicted_boxes, yolo_loss  # noqa: E402

pytestmark = pytest.mark.training
WIDTH, HEIGHT, CLASSES = 96, 64, 3
ANCHORS = (np.array([[30.0, 30.0], [60.0, 40.0]]), np.array([[8.0, 10.0], [14.0, 17.0]]))
GRIDS = ((4, 6), (8, 12))  # rows and columns of strides 16 and 8


def plain_complete_iou(a: tuple[float, ...], b: tuple[float, ...]) -> tuple[float, float]:
    """Equations 5 to 8 of Zheng et al. (2020): IoU - rho^2 / c^2 - alpha v; b is the ground truth."""
    (x, y, w, h), (x_gt, y_gt, w_gt, h_gt) = a, b
    left, right = max(x - w / 2, x_gt - w_gt / 2), min(x + w / 2, x_gt + w_gt / 2)
    top, bottom = max(y - h / 2, y_gt - h_gt / 2), min(y + h / 2, y_gt + h_gt / 2)
    intersection = max(0.0, right - left) * max(0.0, bottom - top)
    iou = intersection / (w * h + w_gt * h_gt - intersection)
    c_x = max(x + w / 2, x_gt + w_gt / 2) - min(x - w / 2, x_gt - w_gt / 2)
    c_y = max(y + h / 2, y_gt + h_gt / 2) - min(y - h / 2, y_gt - h_gt / 2)
    penalty = ((x - x_gt) ** 2 + (y - y_gt) ** 2) / (c_x**2 + c_y**2)
    v = 4 / math.pi**2 * (math.atan(w_gt / h_gt) - math.atan(w / h)) ** 2
    alpha = v / ((1 - iou) + v) if v > 0 else 0.0
    return iou, iou - penalty - alpha * v


sides = st.floats(1.0, 80.0)
box = st.tuples(st.floats(0.0, 96.0), st.floats(0.0, 64.0), sides, sides)


@given(box, box)
def test_complete_iou_is_the_papers_formula(a: tuple[float, ...], b: tuple[float, ...]) -> None:
    found = complete_iou(torch.tensor(a, dtype=torch.float64), torch.tensor(b, dtype=torch.float64))
    # The program adds 1e-7 px^2 or less to denominators of at least 1 px^2; next to IoU 1 alpha is 0 / 0.
    np.testing.assert_allclose([float(x) for x in found], plain_complete_iou(a, b), atol=1e-6)


@given(box)
def test_a_box_covers_itself_completely(a: tuple[float, ...]) -> None:
    iou, complete = complete_iou(torch.tensor(a, dtype=torch.float64), torch.tensor(a, dtype=torch.float64))
    assert float(iou) == pytest.approx(1.0, abs=1e-6)
    assert float(complete) == pytest.approx(1.0, abs=1e-6)


@given(st.integers(0, 2**32 - 1))
def test_training_and_flight_decode_the_same_boxes(seed: int) -> None:
    rng = np.random.default_rng(seed)
    for anchors, (n_y, n_x) in zip(ANCHORS, GRIDS, strict=True):
        raw = rng.normal(0.0, 1.5, (2 * (5 + CLASSES), n_y, n_x)).astype(np.float32)
        head = torch.from_numpy(raw).view(1, 2, 5 + CLASSES, n_y, n_x).permute(0, 1, 3, 4, 2)
        trained = predicted_boxes(head, torch.from_numpy(anchors), WIDTH / n_x).reshape(-1, 4).numpy()
        size = np.array([WIDTH, HEIGHT], dtype=float)
        _, scores, flown = decode([raw], [anchors], size, size, 1e-9)
        assert len(scores) == 2 * n_y * n_x
        # In flight a pixel's centre is an integer, in training the image's corner is 0.
        expected = np.hstack([trained[:, :2] - trained[:, 2:] / 2, trained[:, :2] + trained[:, 2:] / 2]) - 0.5
        np.testing.assert_allclose(flown, expected, rtol=1e-4, atol=1e-3)


Objects = list[tuple[int, tuple[float, float, float, float]]]


def encode(objects: Objects) -> list[np.ndarray]:
    """Return the raw heads that say exactly this: where anchors fit, the inverse of the paper's equations."""
    heads = []
    for anchors, (n_y, n_x) in zip(ANCHORS, GRIDS, strict=True):
        head = np.zeros((2, 5 + CLASSES, n_y, n_x), dtype=np.float32)
        head[:, 4] = -20.0
        for label, (x, y, w, h) in objects:
            for k, (p_w, p_h) in enumerate(anchors):
                if max(w / p_w, p_w / w, h / p_h, p_h / h) < 3.0:
                    column, row = int(x / WIDTH * n_x), int(y / HEIGHT * n_y)
                    t_x, t_y = x / WIDTH * n_x - column, y / HEIGHT * n_y - row
                    head[k, :2, row, column] = np.log(t_x / (1 - t_x)), np.log(t_y / (1 - t_y))
                    head[k, 2:4, row, column] = np.log(w / p_w), np.log(h / p_h)
                    head[k, 4:, row, column] = [20.0] + [20.0 if c == label else -20.0 for c in range(CLASSES)]
        heads.append(head.reshape(2 * (5 + CLASSES), n_y, n_x))
    return heads


def loss_of(heads: list[np.ndarray], objects: Objects, keep: list[bool] | None = None, gradient: bool = False) -> tuple:
    raw = [torch.from_numpy(head[None].copy()).requires_grad_(gradient) for head in heads]
    boxes, classes, wanted = torch.full((1, 6, 4), 1e-3), torch.full((1, 6), -1.0), torch.zeros(1, 6, dtype=torch.bool)
    for i, (label, edges) in enumerate(objects):
        boxes[0, i], classes[0, i], wanted[0, i] = torch.tensor(edges), label, keep is None or keep[i]
    anchors = tuple(torch.from_numpy(a).float() for a in ANCHORS)
    loss, parts = yolo_loss(tuple(raw), anchors, boxes, classes, wanted, WIDTH)
    if gradient:
        loss.backward()
    return float(loss.detach()), parts.numpy(), [head.grad for head in raw]


TRUTH: Objects = [(0, (20.3, 17.9, 26.0, 31.0)), (2, (70.2, 43.1, 12.0, 14.0)), (1, (53.7, 20.6, 50.0, 33.0))]


def test_heads_that_say_the_truth_cost_nothing_and_decode_to_it() -> None:
    heads = encode(TRUTH)
    loss, parts, _ = loss_of(heads, TRUTH)
    assert abs(loss) < 1e-4
    assert np.all(np.abs(parts) < 1e-4)
    size = np.array([WIDTH, HEIGHT], dtype=float)
    labels, scores, boxes = decode(heads, ANCHORS, size, size, 0.5)
    assert set(labels.tolist()) == {0, 1, 2}
    assert np.all(scores > 0.999)
    for label, (x, y, w, h) in TRUTH:
        for found in boxes[labels == label]:
            np.testing.assert_allclose(
                found, [x - w / 2 - 0.5, y - h / 2 - 0.5, x + w / 2 - 0.5, y + h / 2 - 0.5], atol=1e-3
            )


@pytest.mark.parametrize(("channel", "part"), [(0, 0), (2, 0), (4, 1), (5, 2)])
def test_any_other_word_costs(channel: int, part: int) -> None:
    heads = encode(TRUTH)
    _, before, _ = loss_of(heads, TRUTH)
    (label, (x, y, *_)) = TRUTH[0]
    assert label == 0
    heads[0][channel, int(y / HEIGHT * 4), int(x / WIDTH * 6)] -= 3.0 if channel < 4 else 30.0
    _, after, _ = loss_of(heads, TRUTH)
    grown = after - before
    assert grown[part] > 0.1
    assert np.all(np.delete(grown, part) < 1e-5)


def test_an_object_that_is_not_said_costs() -> None:
    assert loss_of(encode(TRUTH[:2]), TRUTH)[0] > 10.0
    assert loss_of(encode(TRUTH), TRUTH[:2])[0] > 10.0  # and one that is not there


def test_an_object_that_need_not_be_found_is_neither_rewarded_nor_punished() -> None:
    """Heads that find all three, of which the third does not count: its cells get no gradient."""
    heads = encode(TRUTH)
    heads[0][4::8] = np.clip(heads[0][4::8], -3.0, 3.0)  # where gradients are not all zero by saturation
    heads[1][4::8] = np.clip(heads[1][4::8], -3.0, 3.0)
    x, y, *_ = TRUTH[2][1]

    def gradients(keep: bool) -> list[np.ndarray]:
        _, _, found = loss_of(heads, TRUTH, [True, True, keep], gradient=True)
        cells = []
        for gradient, (n_y, n_x) in zip(found, GRIDS, strict=True):
            both = gradient[0].numpy().reshape(2, 5 + CLASSES, n_y, n_x)
            said = heads[len(cells)].reshape(2, 5 + CLASSES, n_y, n_x)[:, 4] > 0
            row, column = int(y / HEIGHT * n_y), int(x / WIDTH * n_x)
            cells.append(both[said[:, row, column], :, row, column])
        return cells

    ignored, wanted = gradients(False), gradients(True)
    assert sum(cell.size for cell in ignored) > 0
    assert all(not cell.any() for cell in ignored)
    assert any(cell.any() for cell in wanted)


def test_a_miss_of_an_object_that_need_not_be_found_costs_nothing() -> None:
    assert loss_of(encode(TRUTH[:2]), TRUTH, [True, True, False])[0] < 1e-4


def test_no_objects_leave_only_the_cost_of_false_ones() -> None:
    loss, parts, gradients = loss_of([head * 0.0 for head in encode(TRUTH)], [], gradient=True)
    cells = sum(2 * n_y * n_x for n_y, n_x in GRIDS)
    assert loss == pytest.approx(cells * math.log(2.0), rel=1e-5)
    assert parts[0] == parts[2] == 0.0
    assert all(torch.isfinite(gradient).all() for gradient in gradients)
