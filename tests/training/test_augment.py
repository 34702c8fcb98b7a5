"""Augmented pictures: what is drawn in a picture goes where its box goes."""

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ortilo_drake.training.network.augment import augment, blur_kernel

W, H = 96, 72


class Dice(np.random.Generator):
    """A generator whose random() is decided beforehand: zoom and shift, flip, blur."""

    def __init__(self, seed: int, decided: list[float]):
        super().__init__(np.random.PCG64(seed))
        self._decided = list(decided)

    def random(self, *_: object) -> float:  # type: ignore[override]
        return self._decided.pop(0)


YES, NO = 0.0, 0.99


def picture(box: tuple[int, int, int, int]) -> np.ndarray:
    image = np.full((H, W, 3), 127, dtype=np.uint8)  # as what a zoom leaves around the picture
    image[box[1] : box[3] + 1, box[0] : box[2] + 1] = 24
    return image


def first_edge(dark: np.ndarray) -> float:
    """Return where a profile first rises to half its height; a pixel's centre is at its index."""
    k = int(np.argmax(dark >= 0.5))
    return k - 1 + (0.5 - dark[k - 1]) / (dark[k] - dark[k - 1])


def box_of_pixels(image: np.ndarray) -> np.ndarray:
    """Return the edges of the dark rectangle, from profiles through its middle."""
    gray = image.astype(float).sum(axis=2)
    dark = (gray.max() - gray) / (gray.max() - gray.min())
    u, v = (int(np.mean(np.flatnonzero(dark.max(axis=axis) > 0.9))) for axis in (0, 1))
    profiles = dark[v], dark[:, u]
    low = [first_edge(profile) for profile in profiles]
    high = [len(profile) - 1 - first_edge(profile[::-1]) for profile in profiles]
    return np.array([*low, *high])


rectangles = st.tuples(st.integers(24, 40), st.integers(20, 30), st.integers(8, 24), st.integers(8, 20)).map(
    lambda r: (r[0], r[1], r[0] + r[2], r[1] + r[3])
)


@pytest.mark.family
@pytest.mark.parametrize("decided", [(z, f, b) for z in (YES, NO) for f in (YES, NO) for b in (YES, NO)])
@given(rectangles, st.integers(0, 2**32 - 1))
def test_a_rectangle_stays_in_its_box_under_every_transformation(
    decided: tuple[float, ...], rectangle: tuple[int, int, int, int], seed: int
) -> None:
    box = np.array([[rectangle[0] - 0.5, rectangle[1] - 0.5, rectangle[2] + 0.5, rectangle[3] + 0.5]])
    image, moved = augment(picture(rectangle), box, Dice(seed, list(decided)))
    assert image.shape == (H, W, 3)
    assert image.dtype == np.uint8
    assert np.abs(moved[0] - box_of_pixels(image)).max() <= 1.0
    if decided[2] == NO and decided[0] == YES:
        assert np.abs(moved[0] - box_of_pixels(image)).max() <= 0.2  # an edge's ramp, sampled at whole pixels
    if decided[2] == NO and decided[0] == NO:
        np.testing.assert_allclose(moved[0], box_of_pixels(image), atol=1e-9)


def test_a_flip_mirrors_pixels_and_boxes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cv2, "LUT", lambda image, table: image)
    image = np.random.default_rng(0).integers(0, 256, (H, W, 3), dtype=np.uint8)
    flipped, boxes = augment(image, np.array([[-0.5, 3.0, 10.5, 20.0]]), Dice(1, [NO, YES, NO]))
    np.testing.assert_array_equal(flipped, image[:, ::-1])
    np.testing.assert_array_equal(boxes, [[W - 1 - 10.5, 3.0, W - 0.5, 20.0]])


@given(st.integers(0, 2**32 - 1))
def test_boxes_stay_inside_and_in_order(seed: int) -> None:
    rng = np.random.default_rng(seed)
    corners = np.sort(rng.uniform([-0.5, -0.5], [W - 0.5, H - 0.5], (12, 2, 2)), axis=1)
    given_boxes = corners.reshape(12, 4)
    _, boxes = augment(np.zeros((H, W, 3), np.uint8), given_boxes.copy(), rng)
    assert boxes.shape == (12, 4)
    assert np.all(boxes[:, :2] <= boxes[:, 2:])
    assert boxes.min() >= -0.5
    assert np.all(boxes.max(axis=0) <= np.array([W, H, W, H]) - 0.5)


def test_neither_picture_nor_boxes_given_are_changed_and_the_same_dice_give_the_same() -> None:
    image = np.random.default_rng(0).integers(0, 256, (H, W, 3), dtype=np.uint8)
    boxes = np.array([[5.0, 6.0, 30.0, 40.0]])
    before = image.copy(), boxes.copy()
    results = [augment(image, boxes, np.random.default_rng(5)) for _ in range(2)]
    np.testing.assert_array_equal(image, before[0])
    np.testing.assert_array_equal(boxes, before[1])
    for one, other in zip(*results, strict=True):
        np.testing.assert_array_equal(one, other)


@given(st.floats(1.0, 4.0), st.floats(0.0, np.pi))
def test_a_blur_keeps_brightness_and_shifts_by_less_than_a_pixel(length: float, angle: float) -> None:
    kernel = blur_kernel(length, angle).astype(float)
    assert kernel.sum() == pytest.approx(1.0, abs=1e-6)
    assert kernel.min() >= 0.0
    offsets = np.arange(len(kernel)) - len(kernel) // 2
    centroid = kernel.sum(axis=0) @ offsets, kernel.sum(axis=1) @ offsets
    assert np.hypot(*centroid) < 0.75  # cv2.line draws whole pixels: half of one in each direction


class Spy(np.random.Generator):
    """A generator that keeps what random() gave."""

    def __init__(self, seed: int):
        super().__init__(np.random.PCG64(seed))
        self.drawn: list[float] = []

    def random(self, *_: object) -> float:  # type: ignore[override]
        self.drawn.append(super().random())
        return self.drawn[-1]


def test_all_of_it_happens() -> None:
    """Among two hundred pictures there are zoomed, flipped and blurred ones, in about the shares written."""
    happened = np.zeros(3)
    for seed in range(200):
        spy = Spy(seed)
        augment(np.zeros((H, W, 3), np.uint8), np.zeros((1, 4)), spy)
        happened += np.array(spy.drawn) < [0.7, 0.5, 0.35]
    assert np.all(np.abs(happened / 200 - [0.7, 0.5, 0.35]) < 0.12)
