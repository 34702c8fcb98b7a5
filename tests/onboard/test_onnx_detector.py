"""ONNX networks with the heads of YOLOv5, v8 and v11, against NumPy and OpenCV; and files that are none of them."""

import importlib.util
import zipfile
from pathlib import Path

import cv2
import numpy as np
import pytest

from ortilo_drake.model.room import Room, load_room
from ortilo_drake.model.typed_yaml import InputError, validate
from ortilo_drake.onboard.detector.detector_network import OWN_CFG, OWN_NETWORK, load_detector
from ortilo_drake.scenario import Detector, load_scenario

if importlib.util.find_spec("onnx") is None or importlib.util.find_spec("onnxruntime") is None:
    pytest.skip("onnx or onnxruntime is not installed: no network of it", allow_module_level=True)

from onnx_networks import STRIDES, Network, seen_by

HEADS = ("v5", "v8", "v11")
SIZE = 160, 128  # of the networks' input [px]
ROOM = load_room()
NAMES = [*reversed(ROOM.classes), "toaster", "sofa"]


def picture(seed: int, width: int, height: int) -> np.ndarray:
    rough = np.random.default_rng(seed).integers(0, 256, (height // 12, width // 12, 3), dtype=np.uint8)
    return cv2.resize(rough, (width, height), interpolation=cv2.INTER_CUBIC)


def metadata(names: object = None, **more: str) -> dict[str, str]:
    return {"names": str(dict(enumerate(NAMES)) if names is None else names)} | more


def settings(path: Path, **more: object) -> Detector:
    return validate(Detector, {"onnx": str(path), "threshold": 0.35, "overlap": 0.4, **more}, "detector")


def refused(path: Path, size: tuple[int, int] = (320, 240), **more: object) -> str:
    with pytest.raises(InputError) as error:
        load_detector(settings(path, **more), ROOM, size)
    assert "\n" not in str(error.value)
    assert str(error.value).startswith(str(path))
    return str(error.value).removeprefix(f"{path}: ")


# --- what is found --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("size", [(160, 128), (320, 240), (240, 320), (333, 200), (64, 48)])
@pytest.mark.parametrize("head", HEADS)
def test_boxes_are_those_of_numpy_and_opencv(head: str, size: tuple[int, int], tmp_path: Path) -> None:
    network = Network(head, len(NAMES), SIZE)
    detect = load_detector(settings(network.write(tmp_path / "net.onnx", metadata())), ROOM, size)
    seen = 0
    for seed in range(3):
        image = picture(seed, *size)
        labels, scores, boxes = detect(image)
        expected = [row for row in seen_by(network, image, 0.35, 0.4) if NAMES[row[0]] in ROOM.classes]
        assert [ROOM.classes[k] for k in labels] == [NAMES[k] for k, _, _ in expected]
        np.testing.assert_allclose(scores, [score for _, score, _ in expected], rtol=1e-4)
        np.testing.assert_allclose(boxes, np.reshape([box for _, _, box in expected], (-1, 4)), atol=2e-3)
        seen += len(expected)
    assert seen > 10


@pytest.mark.parametrize("head", HEADS)
def test_half_precision_and_open_sides_find_the_same(head: str, tmp_path: Path) -> None:
    image = picture(0, 320, 240)
    labels, scores, boxes = _found(Network(head, len(NAMES), SIZE), tmp_path, image, {})
    open_sides = _found(Network(head, len(NAMES), SIZE), tmp_path, image, {"open_sides": True})
    for one, other in zip((labels, scores, boxes), open_sides, strict=True):
        np.testing.assert_array_equal(one, other)
    half = _found(Network(head, len(NAMES), SIZE, kind=np.float16), tmp_path, image, {})
    best = scores > 0.45  # no score near the threshold
    assert set(labels[best]) <= set(half[0])
    np.testing.assert_allclose(half[1][:3], scores[:3], atol=5e-3)


def _found(network: Network, folder: Path, image: np.ndarray, options: dict[str, bool]) -> tuple[np.ndarray, ...]:
    path = network.write(folder / "net.onnx", metadata(imgsz=str([SIZE[1], SIZE[0]])), **options)
    return load_detector(settings(path), ROOM, (image.shape[1], image.shape[0]))(image)


def test_a_box_is_suppressed_by_a_better_one_of_its_class_alone(tmp_path: Path) -> None:
    """With overlap near 1 nothing falls; what falls with less overlaps a better box of its class."""
    path = Network("v8", len(NAMES), SIZE).write(tmp_path / "net.onnx", metadata())
    image = picture(1, 320, 240)
    every, some = (load_detector(settings(path, overlap=o), ROOM, (320, 240))(image) for o in (0.999, 0.3))
    assert len(every[0]) > len(some[0]) > 0
    assert {*every[0]} == {*some[0]}


@pytest.mark.parametrize("names", [NAMES, dict(enumerate(NAMES))])
def test_names_are_the_files_as_a_list_or_by_number(names: object, tmp_path: Path) -> None:
    path = Network("v5", len(NAMES), SIZE).write(tmp_path / "net.onnx", metadata(names))
    assert load_detector(settings(path), ROOM, (320, 240))


def test_names_may_stand_in_a_file_of_their_own(tmp_path: Path) -> None:
    path = Network("v8", len(NAMES), SIZE).write(tmp_path / "net.onnx", metadata([f"c{k}" for k in range(len(NAMES))]))
    assert refused(path).startswith("metadata 'names': does not know the class")
    assert refused(path).endswith(f"knows {', '.join(f'c{k}' for k in range(8))} and {len(NAMES) - 8} more")
    (tmp_path / "net.names").write_text("\n".join(NAMES) + "\n")
    labels, _, _ = load_detector(settings(path, names=str(tmp_path / "net.names")), ROOM, (320, 240))(
        picture(0, 320, 240)
    )
    assert len(labels) > 0


def test_a_scenario_names_the_file_from_where_it_lies(tmp_path: Path) -> None:
    (tmp_path / "mine.yaml").write_text(
        "base: nominal_imu_uwb_yolo\ncamera: {kind: rendered}\ndetector: {onnx: n.onnx}\n"
    )
    chosen = load_scenario(tmp_path / "mine.yaml")
    assert chosen.detector.onnx == str(tmp_path / "n.onnx")
    assert load_scenario(chosen).belief.detector == chosen.detector


# --- wrong files ----------------------------------------------------------------------------------------------


def _zipped(path: Path, *names: str) -> bytes:
    with zipfile.ZipFile(path, "w") as archive:
        for name in names:
            archive.writestr(name, b"x")
    return path.read_bytes()


@pytest.mark.parametrize(
    ("content", "what"),
    [
        (b"", "an empty file"),
        (b"\x80\x02}q\x00", r"a PyTorch checkpoint \(.pt\): .* yolo export"),
        (b"\x1c\0\0\0TFL3\x14\0 \0", "a TensorFlow Lite network"),
        (b"\0\0\0\0\2\0\0\0\5\0\0\0" + 40 * b"\1", r"Darknet's \.weights: give it as detector\.cfg and"),
        (OWN_CFG.read_bytes(), r"a Darknet \.cfg: give it as detector\.cfg and"),
        (OWN_NETWORK.read_bytes(), "a safetensors file"),
        (b"version https://git-lfs.github.com/spec/v1\noid sha256:0\n", "a Git LFS pointer"),
        (b"\n<!DOCTYPE html><html>", "a web page"),
        (b"<?xml version='1.0'?><net>", "an OpenVINO network"),
        (b"\x89HDF\r\n\x1a\n", "a Keras network"),
        (b'\x09\0\0\0{"a": 1}ftrt', "a TensorRT engine"),
    ],
)
def test_a_file_of_another_kind_is_called_what_it_is(content: bytes, what: str, tmp_path: Path) -> None:
    path = tmp_path / "net.onnx"
    path.write_bytes(content)
    with pytest.raises(InputError, match=rf"^{path}: not an ONNX network but {what}"):
        load_detector(settings(path), ROOM, (320, 240))


@pytest.mark.parametrize(
    ("names", "what"),
    [
        (("yolov8n/data.pkl", "yolov8n/version"), "a PyTorch checkpoint"),
        (("net/code/a.py", "net/constants.pkl", "net/data.pkl"), "a TorchScript network"),
        (("a.txt",), "a zip archive"),
    ],
)
def test_an_archive_is_called_what_it_is(names: tuple[str, ...], what: str, tmp_path: Path) -> None:
    _zipped(tmp_path / "yolov8n.pt", *names)
    assert refused(tmp_path / "yolov8n.pt").startswith(f"not an ONNX network but {what}")


def test_a_missing_or_damaged_file_is_refused(tmp_path: Path) -> None:
    assert refused(tmp_path / "gone.onnx").startswith("cannot be read")
    path = Network("v8", 3, SIZE).write(tmp_path / "net.onnx")
    path.write_bytes(path.read_bytes()[:2000])
    assert refused(path).startswith("not an ONNX network")


MASKS = {"extra": [(1, 32, SIZE[1] // 4, SIZE[0] // 4)]}


@pytest.mark.parametrize(
    ("head", "classes", "more", "options", "why"),
    [
        ("v8", 11, {"task": "segment"}, MASKS, "is a network of the task 'segment' (-seg): must be a detection"),
        ("v8", 11, {"task": "pose"}, {}, "is a network of the task 'pose' (-pose)"),
        ("v8", 11, {"task": "obb"}, {}, "is a network of the task 'obb' (-obb)"),
        ("v5", 43, {}, MASKS, "gives masks beside its boxes, a segmentation network (-seg)"),
        ("v8", 52, {"names": "{0: 'person'}"}, {}, "says 56 numbers of a box, which are 52 classes, and has 1 names"),
        ("v5", 5, {}, {}, "says 10 numbers of a box, which are 5 classes, and has 11 names"),
        ("v8", 11, {"names": "{1: 'person'}"}, {}, "metadata 'names': \"{1: 'person'}\": must be names, numbered"),
        ("v8", 11, {"names": "__import__('os')"}, {}, "metadata 'names': \"__import__('os')\": must be names"),
        ("v8", 11, {"imgsz": "[640"}, {"open_sides": True}, "metadata 'imgsz': '[640': must be [height, width]"),
    ],
)
def test_a_network_of_another_task_is_refused(
    head: str, classes: int, more: dict[str, str], options: dict[str, object], why: str, tmp_path: Path
) -> None:
    path = Network(head, classes, SIZE).write(tmp_path / "net.onnx", metadata() | more, **options)
    assert refused(path).startswith(why)


def test_a_network_without_names_needs_them_unless_it_has_cocos_80(tmp_path: Path) -> None:
    assert refused(Network("v8", 7, SIZE).write(tmp_path / "a.onnx")).startswith("has 7 classes and no names")
    assert load_detector(settings(Network("v8", 80, SIZE).write(tmp_path / "b.onnx")), ROOM, (320, 240))


def _plain(path: Path, input_shape: tuple[int, ...], output: np.ndarray, kind: str = "FLOAT") -> Path:
    """Write a network whose output is always the same."""
    import onnx
    from onnx import TensorProto, helper, numpy_helper

    node = helper.make_node("Identity", ["y"], ["output0"])
    its = helper.make_tensor_value_info("images", getattr(TensorProto, kind), input_shape)
    out = helper.make_tensor_value_info("output0", TensorProto.FLOAT, output.shape)
    graph = helper.make_graph([node], "net", [its], [out], [numpy_helper.from_array(output.astype(np.float32), "y")])
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    helper.set_model_props(model, metadata())
    onnx.save(model, path)
    return path


N = sum((SIZE[0] // s) * (SIZE[1] // s) for s in STRIDES)
INPUT = 1, 3, SIZE[1], SIZE[0]


@pytest.mark.parametrize(
    ("shape", "output", "kind", "why"),
    [
        (INPUT, (1, 1000), "FLOAT", "gives 1 x 1000 scores of the whole picture, a classifier (-cls)"),
        (INPUT, (1, 300, 6), "FLOAT", "gives boxes that it has suppressed itself: write it as ONNX with nms=False"),
        (INPUT, (1, 3, 16, 20, 16), "FLOAT", "gives raw grids, 1 x 3 x 16 x 20 x 16, not boxes"),
        (INPUT, (1, 15, 8400), "FLOAT", f"its first output is 1 x 15 x 8400: must be 1 x (4 + classes) x {N} (YOLOv8"),
        ((4, *INPUT[1:]), (1, 15, N), "FLOAT", "its input is of 4 pictures at once, must be of 1"),
        ((1, 1, *INPUT[2:]), (1, 15, N), "FLOAT", "its input has 1 channels, must have 3"),
        ((1, 3, 8, 8), (1, 15, N), "FLOAT", "its input is 8 x 8 px, must be 32 to 4096 each"),
        ((1, 3 * N), (1, 15, N), "FLOAT", "its input has 2 dimensions"),
        (INPUT, (1, 15, N), "UINT8", "its input is of tensor(uint8), must be of float or float16"),
    ],
)
def test_shapes_that_do_not_fit_are_refused(
    shape: tuple[int, ...], output: tuple[int, ...], kind: str, why: str, tmp_path: Path
) -> None:
    assert refused(_plain(tmp_path / "net.onnx", shape, np.zeros(output), kind)).startswith(why)


def test_numbers_that_are_no_boxes_in_pixels_are_refused(tmp_path: Path) -> None:
    shares = _plain(tmp_path / "shares.onnx", INPUT, np.full((1, 15, N), 0.5))
    assert refused(shares).startswith("its boxes are shares of the picture, up to 0.75: must be in pixels")
    assert refused(_plain(tmp_path / "nan.onnx", INPUT, np.full((1, 15, N), np.nan))).startswith("gives NaN")


@pytest.mark.parametrize("head", HEADS)
def test_an_output_that_lies_the_other_way_round_says_the_same(head: str, tmp_path: Path) -> None:
    import onnx
    from onnx import helper

    path = Network(head, len(NAMES), SIZE).write(tmp_path / "net.onnx", metadata())
    model, image = onnx.load(path), picture(1, 320, 240)
    (output,) = model.graph.output
    _, rows, columns = (side.dim_value for side in output.type.tensor_type.shape.dim)
    model.graph.node.append(helper.make_node("Transpose", ["output0"], ["turned"], perm=(0, 2, 1)))
    del model.graph.output[:]
    model.graph.output.append(helper.make_tensor_value_info("turned", 1, (1, columns, rows)))
    onnx.save(model, tmp_path / "turned.onnx")
    expected = load_detector(settings(path), ROOM, (320, 240))(image)
    assert len(expected[0])
    for found, its in zip(
        load_detector(settings(tmp_path / "turned.onnx"), ROOM, (320, 240))(image), expected, strict=True
    ):
        np.testing.assert_array_equal(found, its)


def test_scores_that_are_no_shares_are_refused(tmp_path: Path) -> None:
    assert refused(_plain(tmp_path / "net.onnx", INPUT, np.full((1, 15, N), 7.0))).startswith(
        "scores from 7 to 7: must"
    )


def test_onnxruntime_is_named_where_it_is_missing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = Network("v8", len(NAMES), SIZE).write(tmp_path / "net.onnx", metadata())
    found = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None if name == "onnxruntime" else found(name))
    with pytest.raises(InputError, match=r"onnxruntime: is not installed.*ortilo-drake\[onnx\]"):
        load_detector(settings(path), ROOM, (320, 240))


@pytest.mark.parametrize(
    ("more", "why"),
    [
        ({"backend": "opencv"}, "a file of .onnx takes 'auto' or 'onnxruntime'"),
        ({"cfg": "a.cfg", "weights": "a.weights"}, "give one of them"),
    ],
)
def test_settings_that_exclude_each_other_are_refused(more: dict[str, str], why: str) -> None:
    with pytest.raises(InputError, match=why):
        settings(Path("net.onnx"), **more)


def test_a_class_of_the_room_that_the_file_lacks_is_named(tmp_path: Path) -> None:
    landmark = ROOM.landmarks[0].model_copy(update={"label": "unicorn"})
    room = Room.model_construct(**{**dict(ROOM), "landmarks": (*ROOM.landmarks, landmark)})
    path = Network("v8", len(NAMES), SIZE).write(tmp_path / "net.onnx", metadata())
    with pytest.raises(InputError, match=rf"^{path}: metadata 'names': does not know the class 'unicorn'"):
        load_detector(settings(path), room, (320, 240))
