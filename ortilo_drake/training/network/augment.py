"""Augmentation: zoom, shift and mirroring of a picture, and the motion blur, exposure and tint of a real camera."""

import numpy as np

from ortilo_drake.model.optional import later

cv2 = later("cv2")


def blur_kernel(length: float, angle: float) -> np.ndarray:
    """Return the kernel (k x k) of a straight motion blur with this length [px] and angle [rad]."""
    size = 2 * int(np.ceil(length / 2)) + 1
    kernel = np.zeros((size, size), np.float32)
    middle = size // 2
    step = 0.5 * length * np.array([np.cos(angle), np.sin(angle)])
    start, end = (tuple(int(v) for v in np.round(16 * (middle + s * step))) for s in (-1, 1))
    cv2.line(kernel, start, end, 1.0, 1, cv2.LINE_AA, shift=4)
    kernel += kernel[::-1, ::-1]  # make it symmetric: OpenCV's line is off the middle and would shift the picture
    return kernel / kernel.sum()


def augment(image: np.ndarray, boxes: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Return an augmented picture (h x w x 3) and its boxes (m x 4) [px].

    Boxes are rows u_min, v_min, u_max, v_max, with pixel centres at integers, cut at the image's border. A box outside
    the image has no area.
    """
    h, w = image.shape[:2]
    if rng.random() < 0.7:  # zoom and shift
        s = rng.uniform(0.8, 1.25)
        t = rng.uniform(-0.5, 0.5, 2) * np.abs(1.0 - s) * [w, h] + rng.uniform(-0.06, 0.06, 2) * [w, h]
        t += (1.0 - s) * np.array([w - 1, h - 1]) / 2
        M = np.array([[s, 0.0, t[0]], [0.0, s, t[1]]])
        image = cv2.warpAffine(image, M, (w, h), flags=cv2.INTER_LINEAR, borderValue=(127, 127, 127))
        boxes = boxes * s + np.tile(t, 2)
    if rng.random() < 0.5:
        image = image[:, ::-1]
        boxes = np.stack([w - 1 - boxes[:, 2], boxes[:, 1], w - 1 - boxes[:, 0], boxes[:, 3]], axis=1)
    boxes = np.clip(boxes, -0.5, np.array([w, h, w, h]) - 0.5)
    if rng.random() < 0.35:
        image = cv2.filter2D(image, -1, blur_kernel(rng.uniform(1.0, 4.0), rng.uniform(0.0, np.pi)))
    gain = rng.uniform(0.75, 1.25) * rng.uniform(0.94, 1.06, 3)
    offset = rng.uniform(-15.0, 15.0)
    levels = np.arange(256)
    table = np.clip(np.outer(levels, gain) + offset, 0, 255).astype(np.uint8)[np.newaxis]
    return cv2.LUT(np.ascontiguousarray(image), table), boxes
