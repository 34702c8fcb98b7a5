"""Pictures through a lens that bends straight lines: rendered larger with straight lines, then bent."""

from typing import Any

import numpy as np
from pydrake.common.value import Value
from pydrake.systems.framework import Context, LeafSystem

from ortilo_drake.model.lens import straightened
from ortilo_drake.model.optional import later
from ortilo_drake.model.room import CameraModel
from ortilo_drake.model.typed_yaml import InputError

cv2 = later("cv2")

LARGEST = 4096  # longest side of a straight picture [px]


def straight_model(camera: CameraModel) -> CameraModel:
    """Return a camera without distortion and with square pixels that sees all a bent one sees, as fine in its middle.

    InputError if the lens sees so far aside that no straight picture can hold it.
    """
    reach = camera.constants.lens.reach
    if not np.all(2.0 * camera.focal_length * reach + 3.0 <= LARGEST):
        raise InputError(
            f"coefficients: {list(camera.coefficients)}: look so far aside that a straight picture is wider "
            f"than {LARGEST} px: fly with camera.kind projected, or a smaller camera.width"
        )
    half = np.ceil(camera.focal_length * reach).astype(int) + 1
    changes = {"width": int(2 * half[0] + 1), "height": int(2 * half[1] + 1), "center": tuple(half.astype(float))}
    plain = {"aspect": 1.0, "distortion": "none", "coefficients": ()}
    return camera.model_copy(update=changes | plain)


def straight_places(camera: CameraModel) -> tuple[np.ndarray, np.ndarray]:
    """Return each distorted pixel's place in the undistorted picture, u and v (height, width), float32 [px].

    A pixel without a ray, in the corners of a fisheye's picture, gets a place outside.
    """
    its, straight = camera.constants, straight_model(camera)
    places = np.empty((camera.height, camera.width, 2))
    for v in range(camera.height):
        y = (v - its.c[1]) / (its.f * its.lens.aspect)
        for u in range(camera.width):
            places[v, u] = straightened((u - its.c[0]) / its.f, y, its.lens)
    places = straight.center + straight.focal_length * np.nan_to_num(places, nan=-1e3)
    return places[..., 0].astype(np.float32), places[..., 1].astype(np.float32)


class BentPicture(LeafSystem):
    """Bends a straight picture as the lens does.

    Ports:
        straight (an image): the picture of straight_model's camera.
        bent (the same kind of image, output): the picture of the camera.

    Args:
        camera: the camera.
        kind: class of the image.
        outside: value of a pixel for which the lens has no ray.
    """

    def __init__(self, camera: CameraModel, kind: Any, outside: float):
        super().__init__()
        self.set_name(f"bent_{kind.__name__}")
        self._camera, self._kind, self._outside = camera, kind, outside
        self._places = straight_places(camera)
        self._blends = cv2.INTER_LINEAR if kind.__name__ == "ImageRgba8U" else cv2.INTER_NEAREST
        self._straight = self.DeclareAbstractInputPort("straight", Value(kind()))
        self.DeclareAbstractOutputPort(
            "bent", lambda: Value(kind()), self._calc_bent, prerequisites_of_calc={self._straight.ticket()}
        )

    def _calc_bent(self, context: Context, output: Value) -> None:
        image = self._kind(self._camera.width, self._camera.height)
        pixels, value = self._straight.Eval(context).data, (self._outside,) * 4
        found = cv2.remap(pixels, *self._places, self._blends, borderMode=cv2.BORDER_CONSTANT, borderValue=value)
        image.mutable_data[:] = found.reshape(image.mutable_data.shape)
        output.set_value(image)
