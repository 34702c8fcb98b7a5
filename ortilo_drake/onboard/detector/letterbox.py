"""The letterbox: a picture in the middle of a network's input, its shape kept, grey beside it.

This is how Ultralytics' YOLOv5, v8 and v11 see a picture in training and afterwards (their LetterBox): scaled by
r = min(W / w, H / h), rounded to whole pixels, and put in the middle of the input (W, H).
"""

from typing import NamedTuple

import numpy as np

from ortilo_drake.model.optional import later

cv2 = later("cv2")

GREY = 114  # of the borders


class Letterbox(NamedTuple):
    """The place of a picture in a network's input.

    Attributes:
        picture: width and height of the picture [px].
        scaled: width and height of it in the input [px].
        corner: left and top of it in the input [px].
        whole: width and height of the input [px].
    """

    picture: tuple[int, int]
    scaled: tuple[int, int]
    corner: tuple[int, int]
    whole: tuple[int, int]

    def put(self, image: np.ndarray) -> np.ndarray:
        """Return the network's input (H, W, 3) with an image (h, w, 3) in it, uint8."""
        if self.scaled != self.picture:
            image = cv2.resize(image, self.scaled, interpolation=cv2.INTER_LINEAR)
        (left, top), (width, height) = self.corner, self.scaled
        whole = np.full((self.whole[1], self.whole[0], 3), GREY, dtype=np.uint8)
        whole[top : top + height, left : left + width] = image
        return whole

    def back(self, corners: np.ndarray) -> np.ndarray:
        """Return boxes (k, 4) of the input as they lie in the picture, u_min, v_min, u_max, v_max [px].

        The input's coordinates count from its corner, the picture's from the centre of its first pixel. The picture is
        rounded to whole pixels in each direction by itself, so each has its own scale.
        """
        scale = np.array(self.picture, dtype=float) / self.scaled
        return (corners - np.tile(self.corner, 2)) * np.tile(scale, 2) - 0.5


def letterbox(picture: tuple[int, int], whole: tuple[int, int]) -> Letterbox:
    """Return the place of a picture in a network's input, both given by width and height [px]."""
    r = min(whole[0] / picture[0], whole[1] / picture[1])
    scaled = max(round(picture[0] * r), 1), max(round(picture[1] * r), 1)
    # An odd rest goes to the right and below.
    corner = (whole[0] - scaled[0]) // 2, (whole[1] - scaled[1]) // 2
    return Letterbox(picture, scaled, corner, whole)
