"""The camera's pictures in a flight, drawn again for its page."""

import base64
from typing import Any

import numpy as np
import xarray as xr

from ortilo_drake.flight.flight import scenario_of
from ortilo_drake.model.input_error import InputError
from ortilo_drake.model.optional import later
from ortilo_drake.views.scene_view import draw_boxes, make_camera_view

cv2 = later("cv2")

RATE = 2.0  # [Hz]
WIDTH = 320  # [px]
QUALITY = 60  # of the JPEG
LARGEST = 4_000_000  # characters of all pictures; those that would go beyond are left out evenly


def onboard_pictures(flight: xr.Dataset) -> dict[str, Any]:
    """Return the pictures of a flight with a rendered camera, at 2 Hz, with the boxes found in them.

    A flight keeps no pictures: they are drawn again from its true states, which gives the same ones.

    Returns:
        time [s] and jpeg (base64), of as many pictures; both empty, with the reason in `none`, where there are none.
    """
    scenario = scenario_of(flight)
    if not scenario.is_rendered:
        return {"time": [], "jpeg": [], "none": "this flight has no rendered camera"}
    try:
        view = make_camera_view(scenario)
    except InputError as error:
        return {"time": [], "jpeg": [], "none": str(error)}
    room, times, pictures = scenario.load_room(), [], []
    every = max(1, round(1 / (RATE * scenario.h)))
    for time, x in zip(flight["time"].values[::every], flight["truth"].values[::every], strict=True):
        picture, boxes = view(float(time), x)
        height = round(WIDTH * picture.shape[0] / picture.shape[1])
        large = cv2.resize(picture, (WIDTH, height), interpolation=cv2.INTER_AREA)
        draw_boxes(large, boxes, room, WIDTH / picture.shape[1])
        _, jpeg = cv2.imencode(".jpg", large, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
        times.append(round(float(time), 3))
        pictures.append(base64.b64encode(jpeg.tobytes()).decode())
    kept = np.arange(0, len(pictures), max(1, -(-sum(map(len, pictures)) // LARGEST)))
    return {"time": [times[i] for i in kept], "jpeg": [pictures[i] for i in kept]}
