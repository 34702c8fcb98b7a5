"""Calibration files as Kalibr, ROS and OpenCV write them, and what is wrong with others."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from ortilo_drake.model.inputs.calibration_file import read_calibration
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import load_scenario

KALIBR = """cam0:
  T_cam_imu:
  - [0.0148, 0.9995, -0.0257, 0.0652]
  - [-0.9998, 0.0149, 0.0037, -0.0206]
  - [0.0041, 0.0256, 0.9996, -0.0081]
  - [0.0, 0.0, 0.0, 1.0]
  cam_overlaps: []
  camera_model: pinhole
  distortion_coeffs: [-0.28340811, 0.07395907, 0.00019359, 0.0000176]
  distortion_model: radtan
  intrinsics: [458.654, 457.296, 367.215, 248.375]
  resolution: [752, 480]
  rostopic: /cam0/image_raw
  timeshift_cam_imu: 0.0
"""
ROS = """image_width: 640
image_height: 480
camera_name: head_camera
camera_matrix:
  rows: 3
  cols: 3
  data: [438.783367, 0.000000, 305.593336, 0.000000, 437.302876, 243.738352, 0.000000, 0.000000, 1.000000]
distortion_model: plumb_bob
distortion_coefficients:
  rows: 1
  cols: 5
  data: [-0.361976, 0.110510, 0.001014, 0.000505, 0.000000]
rectification_matrix: {rows: 3, cols: 3, data: [0.99, 0.0, 0.0, 0.0, 0.99, 0.0, 0.0, 0.0, 0.99]}
projection_matrix: {rows: 3, cols: 4, data: [393.6, 0.0, 322.7, 0.0, 0.0, 393.6, 241.0, 0.0, 0.0, 0.0, 1.0, 0.0]}
"""
FROM_ROS = {
    "width": 640,
    "height": 480,
    "focal_length": [438.783367, 437.302876],
    "center": [305.593336, 243.738352],
    "distortion": "brown_conrady",
    "coefficients": [-0.361976, 0.110510, 0.001014, 0.000505, 0.0],
}


def read(folder: Path, text: str) -> dict[str, object]:
    (folder / "camera.yaml").write_text(text)
    return read_calibration(folder / "camera.yaml")


def test_kalibrs_camchain(tmp_path: Path) -> None:
    expected = {"width": 752, "height": 480, "focal_length": [458.654, 457.296], "center": [367.215, 248.375]}
    k = [-0.28340811, 0.07395907, 0.00019359, 0.0000176]
    assert read(tmp_path, KALIBR) == expected | {"distortion": "brown_conrady", "coefficients": k}
    fish = read(tmp_path, KALIBR.replace("radtan", "equidistant"))
    assert fish == expected | {"distortion": "fisheye", "coefficients": k}
    assert read(tmp_path, KALIBR.replace("radtan", "none")) == expected | {"distortion": "none", "coefficients": []}


def test_a_sensor_file_of_euroc_has_kalibrs_keys(tmp_path: Path) -> None:
    of_cam0 = "\n".join(line[2:] for line in KALIBR.splitlines()[1:])
    euroc = of_cam0.replace("radtan", "radial-tangential").replace("distortion_coeffs", "distortion_coefficients")
    assert read(tmp_path, euroc) == read(tmp_path, KALIBR)


def test_ros_camera_info_as_a_file_and_as_a_message(tmp_path: Path) -> None:
    assert read(tmp_path, ROS) == FROM_ROS
    message = "\n".join(
        [
            *("header: {frame_id: camera}", "height: 480", "width: 640", "distortion_model: plumb_bob"),
            *("d: [-0.361976, 0.110510, 0.001014, 0.000505, 0.0]", "r: [1, 0, 0, 0, 1, 0, 0, 0, 1]"),
            "k: [438.783367, 0.0, 305.593336, 0.0, 437.302876, 243.738352, 0.0, 0.0, 1.0]",
        ]
    )
    assert read(tmp_path, message) == FROM_ROS
    assert read(tmp_path, f"{message}\n---\n{message}\n---\n") == FROM_ROS  # as `rostopic echo` goes on
    by_python = ROS.replace("0.001014", "2e-05")  # which is text to YAML
    assert read(tmp_path, by_python)["coefficients"] == [-0.361976, 0.110510, 2e-05, 0.000505, 0.0]
    fish = ROS.replace("plumb_bob", "equidistant").replace(", 0.000000]\nrect", "]\nrect")
    assert read(tmp_path, fish)["distortion"] == "fisheye"


@pytest.mark.parametrize("count", [4, 5, 8, 14])
def test_opencvs_file_storage_is_read_as_opencv_wrote_it(count: int, tmp_path: Path) -> None:
    path = tmp_path / "opencv.yml"
    k = np.zeros(count)
    k[: min(count, 8)] = [-0.31, 0.12, -0.001, 0.0007, -0.02, 0.3, -0.1, 0.01][:count]
    K = np.array([[500.5, 0.0, 320.25], [0.0, 499.0, 238.75], [0.0, 0.0, 1.0]])
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    for name, value in (("image_width", 640), ("image_height", 480), ("camera_matrix", K)):
        storage.write(name, value)
    storage.write("distortion_coefficients", k.reshape(1, -1))
    storage.release()
    found = read_calibration(path)
    assert found["focal_length"] == [500.5, 499.0]
    assert found["center"] == [320.25, 238.75]
    assert found["distortion"] == "brown_conrady"
    np.testing.assert_array_equal(found["coefficients"], k[: min(count, 8)])


def test_opencvs_fisheye_model_is_one(tmp_path: Path) -> None:
    path = tmp_path / "opencv.yml"
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    for name, value in (("image_width", 640), ("image_height", 480), ("fisheye_model", 1)):
        storage.write(name, value)
    storage.write("camera_matrix", np.array([[300.0, 0.0, 320.0], [0.0, 300.0, 240.0], [0.0, 0.0, 1.0]]))
    storage.write("distortion_coefficients", np.array([[-0.01, 0.03, -0.03, 0.01]]))
    storage.release()
    assert read_calibration(path)["distortion"] == "fisheye"


@pytest.mark.parametrize(
    ("text", "why"),
    [
        (KALIBR.replace("pinhole", "omni"), "cam0.camera_model: 'omni': must be pinhole"),
        (KALIBR.replace("radtan", "fov"), "cam0.distortion_model: 'fov': must be one of radtan, equidistant, none"),
        (ROS.replace("640", "300"), "the centre, 305.593, 243.738, is outside the picture of 300 x 480 pixels"),
        (KALIBR.replace("[458.654, ", "["), "cam0.intrinsics: "),
        (KALIBR.replace("[752, 480]", "[752.5, 480]"), "cam0.resolution: 752.5: must be a whole number of pixels"),
        (KALIBR.replace("[-0.28340811, ", "["), "cam0.distortion_coeffs: "),
        (KALIBR + KALIBR.replace("cam0", "cam1"), "cam0, cam1: must be one camera: leave the others out"),
        ("cam0: 7\n", "cam0: 7: must be a camera's group"),
        (ROS.replace("image_width: 640\n", ""), "image_width: is missing, must be there"),
        (ROS.replace("image_width: 640", "image_width: .inf"), "image_width: inf: must be a whole number of pixels"),
        (ROS.replace("image_width: 640", "image_width: wide"), "image_width: 'wide': must be a whole number of pixels"),
        (ROS.replace("plumb_bob", "barrel"), "distortion_model: 'barrel': must be one of none, radtan, plumb_bob"),
        (ROS.replace("plumb_bob", "equidistant"), "distortion_coefficients: "),
        (ROS.replace("[438.783367, 0.000000,", "[438.783367, 0.7,"), "camera_matrix: "),
        (ROS.replace("[438.783367, ", "["), "camera_matrix: "),
        (ROS.replace("0.000000]\nrect", "0.0, 0.0, 0.0, 0.0, 0.1, 0.0, 0.0, 0.0]\nrect"), "distortion_coefficients: "),
        (ROS.replace("[-0.361976, 0.110510, 0.001014, ", "[0.1, "), "distortion_coefficients: "),
        (ROS.replace("data: [-0.361976", "data: [x"), "distortion_coefficients: "),
        ("anchors: []\n", "no cam0 of Kalibr and no camera_matrix of ROS or OpenCV: no calibration of these"),
        ("- 1\n", "must hold a calibration of Kalibr, ROS or OpenCV, not list"),
        ("a: [1\n", ""),
        ("<!DOCTYPE html>", ""),
    ],
)
def test_a_wrong_file_is_answered_in_one_line_that_names_the_field(text: str, why: str, tmp_path: Path) -> None:
    with pytest.raises(InputError) as error:
        read(tmp_path, text)
    assert "\n" not in str(error.value)
    assert str(error.value).startswith(f"{tmp_path / 'camera.yaml'}")
    assert why in str(error.value)


def test_a_scenario_names_a_calibration_from_where_it_lies(tmp_path: Path) -> None:
    (tmp_path / "camera.yaml").write_text(ROS)
    (tmp_path / "mine.yaml").write_text("base: nominal_imu_uwb_yolo\ncamera: {calibration: camera.yaml}\n")
    (tmp_path / "over.yaml").write_text("base: mine.yaml\nseed: 3\n")
    (tmp_path / "straight.yaml").write_text(KALIBR.replace("radtan", "none"))
    (tmp_path / "other.yaml").write_text("base: mine.yaml\ncamera: {calibration: straight.yaml}\n")
    assert load_scenario(tmp_path / "other.yaml").camera.calibration.coefficients == ()
    for name in ("mine.yaml", "over.yaml"):
        chosen = load_scenario(tmp_path / name)
        assert chosen.camera.calibration.model_dump(mode="json") == FROM_ROS
    laid_over = load_scenario("nominal_imu_uwb_yolo", f"camera.calibration={tmp_path / 'camera.yaml'}")
    assert laid_over.camera.calibration == chosen.camera.calibration
    assert laid_over.belief.camera.calibration == chosen.camera.calibration
    camera = laid_over.load_room().camera.scaled_to(320)
    assert (camera.width, camera.height) == (320, 240)
    assert camera.focal_length == pytest.approx(438.783367 / 2)
    assert camera.focal_length * camera.aspect == pytest.approx(437.302876 / 2)
    assert camera.coefficients == tuple(FROM_ROS["coefficients"])  # type: ignore[arg-type]
    assert laid_over.load_room().camera.position == load_scenario("nominal_imu_uwb_yolo").load_room().camera.position


@pytest.mark.parametrize(
    ("settings", "why"),
    [
        ("camera.calibration=gone.yaml", r"camera\.calibration: .*gone\.yaml': no such file"),
        ("camera.calibration={width: 640}", r"camera\.calibration\.height: is missing"),
        (
            "camera.calibration={width: 64, height: 48, focal_length: [50, 50], center: [32, 24], coefficients: [1.0]}",
            r"camera\.calibration\.coefficients: 1 of them: none has 0",
        ),
    ],
)
def test_a_wrong_calibration_of_a_scenario_is_refused(settings: str, why: str) -> None:
    with pytest.raises(InputError, match=why):
        load_scenario("nominal_imu_uwb_yolo", settings)
