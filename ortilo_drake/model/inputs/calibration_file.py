"""A camera's calibration in the formats of other programs: Kalibr's camchain, ROS' camera_info, OpenCV's FileStorage.

    Kalibr    cam0: {camera_model: pinhole, intrinsics: [fu, fv, pu, pv], resolution: [width, height],
              distortion_model: radtan | equidistant | none, distortion_coeffs: [...]}
    EuRoC     the same keys without cam0, radial-tangential, distortion_coefficients (a data set's sensor.yaml)
    ROS       image_width, image_height, camera_matrix: {data: [9]}, distortion_coefficients: {data: [...]},
              distortion_model: plumb_bob | rational_polynomial | equidistant; or a message's d, k, width, height
    OpenCV    image_width, image_height, camera_matrix, distortion_coefficients as !!opencv-matrix; with
              fisheye_model: 1 the coefficients of cv::fisheye

In all formats pixel (0, 0) is the centre of the first pixel, as in this package.
"""

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from ortilo_drake.model.input_files import exists, read_text
from ortilo_drake.model.inputs.problems import shown
from ortilo_drake.model.typed_yaml import LARGEST, InputError, parse_yaml

_NAMES: Final = {
    "camera_matrix": ("camera_matrix", "cameraMatrix", "camera_Matrix", "K", "k", "mtx"),
    "distortion_coefficients": (
        *("distortion_coefficients", "distortionCoefficients", "Distortion_Coefficients", "distCoeffs"),
        *("dist_coeffs", "dist_coeff", "dist", "D", "d"),
    ),
    "image_width": ("image_width", "image_Width", "imageWidth", "width"),
    "image_height": ("image_height", "image_Height", "imageHeight", "height"),
}
_MODELS: Final = {
    "none": "none",
    "radtan": "brown_conrady",
    "plumb_bob": "brown_conrady",
    "rational_polynomial": "brown_conrady",
    "equidistant": "fisheye",
    "fisheye": "fisheye",
    "radial-tangential": "brown_conrady",
}
_MOST: Final = 8  # largest number of coefficients; OpenCV's further ones model a thin prism and a tilted sensor


def _wrong(source: str, field: str, value: Any, must: str) -> InputError:
    return InputError(f"{source}: {field}: {shown(value)}: must be {must}")


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and not abs(value) > LARGEST


def _as_number(value: Any) -> Any:
    """Return a text as a number, if it is one: Python and ROS write 2e-05, which YAML reads as text."""
    try:
        return float(value) if isinstance(value, str) else value
    except ValueError:
        return value


def _numbers(source: str, field: str, value: Any, counts: tuple[int, ...] = ()) -> list[float]:
    """Return a list of numbers; the elements of a matrix row by row."""
    data = value.get("data") if isinstance(value, dict) else value
    if isinstance(data, list) and data and all(isinstance(row, list) for row in data):
        data = [number for row in data for number in row]
    data = [_as_number(v) for v in data] if isinstance(data, list) else data
    is_number = [_is_number(v) for v in data] if isinstance(data, list) else []
    if not isinstance(data, list) or not all(is_number) or (counts and len(data) not in counts):
        raise _wrong(source, field, value, f"{' or '.join(map(str, counts))} numbers".strip())
    return [float(number) for number in data]


def _whole(source: str, field: str, value: Any) -> int:
    if not isinstance(value, int | float) or isinstance(value, bool) or value % 1 != 0:  # nan and inf are not either
        raise _wrong(source, field, value, "a whole number of pixels")
    return int(value)


def _lens(source: str, field: str, distortion: str, given: list[float]) -> dict[str, Any]:
    """Return the distortion and its coefficients, always both, so that they replace a default calibration completely.

    Zeros at the end, beyond our number of coefficients, are left out.
    """
    while len(given) > _MOST and given[-1] == 0.0:
        given = given[:-1]
    if len(given) > _MOST:
        raise _wrong(source, field, given[_MOST:], "0: of a thin prism or a tilted sensor")
    if distortion == "none" or (distortion == "brown_conrady" and not any(given)):
        return {"distortion": "none", "coefficients": []}
    if distortion == "brown_conrady" and len(given) in (6, 7):
        given += [0.0] * (_MOST - len(given))
    return {"distortion": distortion, "coefficients": given}


def _of_kalibr(source: str, data: Mapping[str, Any]) -> dict[str, Any]:
    cameras = [name for name in data if re.fullmatch(r"cam\d+", name)]
    if len(cameras) > 1:
        raise InputError(f"{source}: {', '.join(cameras)}: must be one camera: leave the others out")
    cam, its = f"{cameras[0]}.", data[cameras[0]]
    if not isinstance(its, dict):
        raise _wrong(source, cameras[0], its, "a camera's group")
    return _of_camera(source, cam, its, "distortion_coeffs")


def _of_camera(source: str, cam: str, its: Mapping[str, Any], coefficients: str) -> dict[str, Any]:
    """Return the calibration of a camera with Kalibr's keys; `cam` is their prefix in an error."""
    if its.get("camera_model") != "pinhole":
        raise _wrong(source, f"{cam}camera_model", its.get("camera_model"), "pinhole")
    model, known = its.get("distortion_model"), ("radtan", "equidistant", "none", "radial-tangential")
    if model not in known:
        raise _wrong(source, f"{cam}distortion_model", model, f"one of {', '.join(known)}")
    f_u, f_v, *center = _numbers(source, f"{cam}intrinsics", its.get("intrinsics"), (4,))
    size = _numbers(source, f"{cam}resolution", its.get("resolution"), (2,))
    width, height = (_whole(source, f"{cam}resolution", side) for side in size)
    found = {"width": width, "height": height, "focal_length": [f_u, f_v], "center": center}
    given = []
    if model != "none":
        given = _numbers(source, f"{cam}{coefficients}", its.get(coefficients), (4,))
    return found | _lens(source, f"{cam}{coefficients}", _MODELS[model], given)


def _of_ros_or_opencv(source: str, data: Mapping[str, Any]) -> dict[str, Any]:
    def find(key: str) -> tuple[str, Any]:
        name = next((name for name in _NAMES[key] if name in data), None)
        if name is None:
            raise InputError(f"{source}: {key}: is missing, must be there")
        return name, data[name]

    width, height = (_whole(source, *find(key)) for key in ("image_width", "image_height"))
    name, matrix = find("camera_matrix")
    K = _numbers(source, name, matrix, (9,))
    if K[1] != 0.0 or K[3] != 0.0 or K[6:] != [0.0, 0.0, 1.0]:
        raise _wrong(source, name, K, "[f_u, 0, c_u, 0, f_v, c_v, 0, 0, 1]")
    model = data.get("distortion_model", "plumb_bob") or "plumb_bob"
    if not isinstance(model, str) or model not in _MODELS:
        raise _wrong(source, "distortion_model", model, f"one of {', '.join(_MODELS)}")
    distortion = "fisheye" if data.get("fisheye_model") else _MODELS[model]
    name, given = find("distortion_coefficients")
    numbers = _numbers(source, name, given)
    if distortion == "fisheye" and len(numbers) != 4:
        raise _wrong(source, name, numbers, "4 numbers of a fisheye lens")
    if distortion == "brown_conrady" and len(numbers) not in (0, 4, 5, 6, 7, 8, 12, 14):
        raise _wrong(source, name, numbers, "4, 5, 8, 12 or 14 numbers")
    found = {"width": width, "height": height, "focal_length": [K[0], K[4]], "center": [K[2], K[5]]}
    return found | _lens(source, name, distortion, numbers)


def read_calibration(path: Path) -> dict[str, Any]:
    """Return a scenario's `camera.calibration` from a calibration file: size, focal lengths, centre and lens.

    A file that already has the keys of `camera.calibration` is returned unchanged. InputError names the file, the field
    and the allowed values.
    """
    if not exists(path):
        raise InputError(f"camera.calibration: {str(path)[:200]!r}: no such file")
    source, text = str(path), read_text(path)
    # OpenCV's first line is not a valid YAML directive, and its matrices have their own type.
    text = re.sub(r"\A%YAML[^\n]*\n", "", text).replace("!!opencv-matrix", "")
    # `rostopic echo` ends each message with ---: only the first message is read.
    parts = [part for part in re.split(r"(?m)^---\s*$", text) if part.strip()]
    data = parse_yaml(parts[0] if parts else "", source)
    if not isinstance(data, dict):
        raise InputError(f"{source}: must hold a calibration of Kalibr, ROS or OpenCV, not {type(data).__name__}")
    if "focal_length" in data:
        return data
    if any(re.fullmatch(r"cam\d+", name) for name in data):
        found = _of_kalibr(source, data)
    elif "intrinsics" in data and "camera_model" in data:
        found = _of_camera(source, "", data, "distortion_coefficients")
    elif any(name in data for key in ("camera_matrix", "distortion_coefficients") for name in _NAMES[key]):
        found = _of_ros_or_opencv(source, data)
    else:
        raise InputError(f"{source}: no cam0 of Kalibr and no camera_matrix of ROS or OpenCV: no calibration of these")
    (u, v), width, height = found["center"], found["width"], found["height"]
    if not (0.0 <= u < width and 0.0 <= v < height):
        outside = f"the centre, {u:g}, {v:g}, is outside the picture of {width} x {height} pixels"
        raise InputError(f"{source}: {outside}: calibrated at another resolution?")
    return found
