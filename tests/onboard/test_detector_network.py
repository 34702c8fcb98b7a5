"""The detector's network: its backends agree, its boxes are the room's, and wrong files are refused."""

import importlib.util
from pathlib import Path

import cv2
import numpy as np
import pytest

from ortilo_drake.model.room import Room, load_room
from ortilo_drake.model.typed_yaml import InputError, validate
from ortilo_drake.onboard.detector import detector_network
from ortilo_drake.onboard.detector.class_names import COCO_CLASSES
from ortilo_drake.onboard.detector.darknet_cfg import parse_cfg, read_cfg
from ortilo_drake.onboard.detector.detector_network import (
    OWN_CFG,
    OWN_CLASSES,
    OWN_NETWORK,
    OWN_ONNX,
    class_names,
    load_detector,
    own_backend,
    room_labels,
)
from ortilo_drake.onboard.detector.network_backends import (
    check_installed,
    onnxruntime_network,
    opencv_network,
    torch_network,
)
from ortilo_drake.onboard.detector.yolo_boxes import decode
from ortilo_drake.scenario import Detector

ROOM = load_room()
needs_torch = pytest.mark.skipif(
    importlib.util.find_spec("torch") is None or importlib.util.find_spec("safetensors") is None,
    reason="torch or safetensors is not installed: no network in torch",
)
needs_onnxruntime = pytest.mark.skipif(
    importlib.util.find_spec("onnxruntime") is None, reason="onnxruntime is not installed: no network in it"
)


def cfg_text(classes: int, width: int = 64, height: int = 48) -> str:
    return f"""[net]\nwidth={width}\nheight={height}\nchannels=3
[convolutional]\nbatch_normalize=1\nfilters=6\nsize=3\nstride=4\npad=1\nactivation=leaky
[convolutional]\nfilters={2 * (5 + classes)}\nsize=1\nstride=1\nactivation=linear
[yolo]\nmask=0,1\nanchors=8,8,20,16\nclasses={classes}\nnum=2
"""


def darknet(folder: Path, classes: int, names: list[str] | None = None, seed: int = 0, size: int = 64) -> Detector:
    """Write a small network of seeded weights and return the settings that fly it."""
    cfg = parse_cfg(cfg_text(classes, size, size * 3 // 4), "net.cfg")
    (folder / "net.cfg").write_text(cfg.text)
    values = np.random.default_rng(seed).uniform(0.05, 0.4, cfg.weight_count).astype("<f4")
    (folder / "net.weights").write_bytes(np.array([0, 2, 0, 7, 0], dtype="<i4").tobytes() + values.tobytes())
    if names is not None:
        (folder / "net.names").write_text("\n".join(names) + "\n\n")
    return Detector(cfg=str(folder / "net.cfg"), weights=str(folder / "net.weights"), threshold=0.3)


def picture(seed: int = 0, size: tuple[int, int] = (320, 240)) -> np.ndarray:
    """Return a smooth picture with something in it."""
    rng = np.random.default_rng(seed)
    return cv2.resize(rng.integers(0, 256, (12, 16, 3), dtype=np.uint8), size, interpolation=cv2.INTER_CUBIC)


# --- backends -------------------------------------------------------------------------------------------------


def pixels_of(image: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(image.transpose(2, 0, 1)[None], dtype=np.float32) / np.float32(255)


@needs_torch
@needs_onnxruntime
def test_all_backends_find_the_same_boxes_whatever_the_weights() -> None:
    cfg = read_cfg(OWN_CFG)
    heads = torch_network(OWN_NETWORK, cfg)(pixels_of(picture()))
    size = np.array([320.0, 240.0])
    anchors = [np.array(head.anchors) for head in cfg.heads]
    scores = np.sort(decode(heads, anchors, size, size, 1e-6)[1])
    # Between two scores that differ: random weights give thousands alike.
    gaps = np.diff(scores[-200:]) / scores[-199:]
    k = int(np.argmax(gaps))
    threshold = float(scores[-200:][k] + scores[-200:][k + 1]) / 2
    results = {}
    for backend in ("torch", "onnxruntime", "opencv"):
        settings = validate(Detector, {"backend": backend, "threshold": threshold, "overlap": 0.99}, "detector")
        results[backend] = load_detector(settings, ROOM, (320, 240))(picture())
    labels, scores, boxes = results["torch"]
    assert len(labels) > 0
    for backend in ("onnxruntime", "opencv"):
        other = results[backend]
        # Each orders equal scores its own way.
        ours, theirs = (np.lexsort((b[:, 1].round(1), b[:, 0].round(1), n)) for n, _, b in (results["torch"], other))
        np.testing.assert_array_equal(labels[ours], other[0][theirs])
        np.testing.assert_allclose(scores[ours], other[1][theirs], rtol=1e-3)
        np.testing.assert_allclose(boxes[ours], other[2][theirs], atol=0.05)


@needs_onnxruntime
def test_auto_takes_onnxruntime_where_it_is_and_opencv_else(monkeypatch: pytest.MonkeyPatch) -> None:
    assert own_backend("auto") == "onnxruntime"
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    assert own_backend("auto") == "opencv"
    assert [own_backend(name) for name in ("torch", "opencv", "onnxruntime")] == ["torch", "opencv", "onnxruntime"]


@pytest.mark.parametrize(
    ("backend", "package", "extra"), [("onnxruntime", "onnxruntime", "onnx"), ("torch", "torch", "torch")]
)
def test_a_backend_that_is_not_installed_is_named_with_how_to_get_it(
    backend: str, package: str, extra: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None if name == package else found(name))
    settings = validate(Detector, {"backend": backend}, "detector")
    with pytest.raises(InputError, match=rf"{package}.* not installed.*: pip install 'ortilo-drake\[{extra}\]'"):
        load_detector(settings, ROOM, (320, 240))
    check_installed("numpy", "none")


@pytest.mark.parametrize("network", [pytest.param(onnxruntime_network, marks=needs_onnxruntime), opencv_network])
@pytest.mark.parametrize("content", [b"", b"not a network", None])
def test_a_damaged_onnx_file_is_refused(network: object, content: bytes | None, tmp_path: Path) -> None:
    path = tmp_path / "net.onnx"
    path.write_bytes(OWN_ONNX.read_bytes()[:100_000] if content is None else content)
    with pytest.raises(InputError, match=r"net\.onnx: not an ONNX network") as error:
        network(path)  # type: ignore[operator]
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("network", [pytest.param(onnxruntime_network, marks=needs_onnxruntime), opencv_network])
def test_a_missing_onnx_file_is_refused(network: object, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"net\.onnx: not an ONNX network"):
        network(tmp_path / "net.onnx")  # type: ignore[operator]


@needs_torch
@pytest.mark.parametrize("content", [b"", b"no safetensors", None])
def test_a_damaged_safetensors_file_is_refused(content: bytes | None, tmp_path: Path) -> None:
    path = tmp_path / "net.safetensors"
    path.write_bytes(OWN_NETWORK.read_bytes()[:100_000] if content is None else content)
    with pytest.raises(InputError, match=r"net\.safetensors: cannot be read"):
        torch_network(path, read_cfg(OWN_CFG))


@needs_torch
def test_our_file_with_another_cfg_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"ortilo\.safetensors: holds a network of another \.cfg"):
        torch_network(OWN_NETWORK, parse_cfg(cfg_text(9), "other.cfg"))


# --- classes --------------------------------------------------------------------------------------------------


def test_a_label_is_the_rooms_and_other_classes_are_none() -> None:
    names = ["sofa", *reversed(ROOM.classes), "toaster"]
    labels = room_labels(names, ROOM, "net.cfg")
    assert labels[0] == labels[-1] == -1
    assert [ROOM.classes[k] for k in labels[1:-1]] == list(reversed(ROOM.classes))


def test_a_room_with_a_class_that_the_network_does_not_know_is_refused() -> None:
    landmark = ROOM.landmarks[0].model_copy(update={"label": "unicorn"})
    room = Room.model_construct(**{**dict(ROOM), "landmarks": (*ROOM.landmarks, landmark)})
    with pytest.raises(InputError, match=r"ortilo\.names: does not know the class 'unicorn' of a landmark of room"):
        load_detector(Detector(), room, (320, 240))


def test_the_80_classes_of_coco_are_known_by_heart(tmp_path: Path) -> None:
    settings = darknet(tmp_path, 80)
    names, source = class_names(settings, read_cfg(tmp_path / "net.cfg"))
    assert source == f"{tmp_path}/net.cfg, of COCO's 80 classes"
    assert len(names) == len(set(names)) == 80
    # Places that everyone who has used these networks knows, and the room's classes are among them.
    assert [names[k] for k in (0, 2, 14, 15, 16, 56, 58, 74, 79)] == [
        "person", "car", "bird", "cat", "dog", "chair", "potted plant", "clock", "toothbrush",
    ]  # fmt: skip
    assert set(OWN_CLASSES) <= set(COCO_CLASSES)
    assert set(ROOM.classes) <= set(OWN_CLASSES)


# Darknet's data/coco.names where it differs from COCO's own list, by the place in the list.
DARKNETS_WORDS = {3: "motorbike", 4: "aeroplane", 57: "sofa", 58: "pottedplant", 60: "diningtable", 62: "tvmonitor"}


def test_darknets_own_words_for_cocos_classes_are_known(tmp_path: Path) -> None:
    words = [DARKNETS_WORDS.get(k, name) for k, name in enumerate(COCO_CLASSES)]
    settings = darknet(tmp_path, 80, words)
    names, source = class_names(settings, read_cfg(tmp_path / "net.cfg"))
    assert names == words
    np.testing.assert_array_equal(room_labels(names, ROOM, source), room_labels(list(COCO_CLASSES), ROOM, source))
    assert "potted plant" in ROOM.classes


@pytest.mark.parametrize(
    ("names", "classes", "expected"),
    [
        (["sofa", "cat"], ["cat", "couch"], [1, 0]),
        (["couch", "cat"], ["cat", "sofa"], [1, 0]),
        (["sofa", "couch"], ["couch", "sofa"], [1, 0]),  # who has both words means two things
        (["tv", "cat"], ["cat"], [-1, 0]),
    ],
)
def test_either_word_on_either_side(names: list[str], classes: list[str], expected: list[int]) -> None:
    landmarks = [ROOM.landmarks[0].model_copy(update={"label": label}) for label in classes]
    room = Room.model_construct(**{**dict(ROOM), "landmarks": tuple(landmarks)})
    order = list(room.classes)
    found = room_labels(names, room, "net.names")
    assert [order[k] if k >= 0 else None for k in found] == [classes[k] if k >= 0 else None for k in expected]


@needs_torch
def test_the_file_without_a_class_of_the_room_is_named(tmp_path: Path) -> None:
    settings = darknet(tmp_path, 2, ["cat", "dog"])
    with pytest.raises(InputError, match=rf"^{tmp_path}/net\.names: does not know the class"):
        load_detector(settings, ROOM, (64, 64))


def test_names_come_from_the_file_given_or_beside_the_cfg(tmp_path: Path) -> None:
    settings = darknet(tmp_path, 2, ["cat", " dog "])
    cfg = read_cfg(tmp_path / "net.cfg")
    assert class_names(settings, cfg) == (["cat", "dog"], f"{tmp_path}/net.names")
    (tmp_path / "other").write_text("clock\nbird\n")
    given = settings.model_copy(update={"names": str(tmp_path / "other")})
    assert class_names(given, cfg) == (["clock", "bird"], f"{tmp_path}/other")


@pytest.mark.parametrize(
    ("content", "names"),
    [
        (b"cat\r\ndog\r\ncow\r\n\r\n", ["cat", "dog", "cow"]),
        (b"\xef\xbb\xbfcat\n\tdog\ncow  \n\n", ["cat", "dog", "cow"]),
        (b"\ncat\ndog", ["", "cat", "dog"]),  # a name's line is its class
        (b"# 0\ncat\ndog", ["# 0", "cat", "dog"]),
    ],
)
def test_a_line_of_names_is_a_class(content: bytes, names: list[str], tmp_path: Path) -> None:
    settings = darknet(tmp_path, 3)
    (tmp_path / "net.names").write_bytes(content)
    assert class_names(settings, read_cfg(tmp_path / "net.cfg"))[0] == names


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (None, r"net\.names: missing: .*net\.cfg has 3 classes, give their names, one a line"),
        (b"cat\ndog\n", r"net\.names: holds 2 names, .*net\.cfg has 3 classes"),
        (b"", r"net\.names: holds 0 names"),
        (b"cat\n\ndog\ncow\n", r"net\.names: holds 4 names, .* has 3 classes; line 2, '', counts as a name, as in D"),
        (b"#pets\ncat\ndog\ncow", r"holds 4 names, .* has 3 classes; line 1, '#pets', counts as a name, as in Darknet"),
        (b"\xff\xfe\x00", r"net\.names: cannot be read"),
    ],
)
def test_wrong_names_are_refused(content: bytes | None, message: str, tmp_path: Path) -> None:
    settings = darknet(tmp_path, 3)
    if content is not None:
        (tmp_path / "net.names").write_bytes(content)
    with pytest.raises(InputError, match=message):
        class_names(settings, read_cfg(tmp_path / "net.cfg"))


def test_a_names_file_that_is_given_but_missing_is_refused(tmp_path: Path) -> None:
    settings = darknet(tmp_path, 80).model_copy(update={"names": str(tmp_path / "gone.names")})
    with pytest.raises(InputError, match=r"gone\.names: cannot be read"):
        class_names(settings, read_cfg(tmp_path / "net.cfg"))


# --- pictures -------------------------------------------------------------------------------------------------


def heads_with_one_box(pixels: np.ndarray) -> list[np.ndarray]:
    """A network that sees one dog, its centre where the picture is brightest."""
    _, _, height, width = pixels.shape
    gray = pixels[0].sum(axis=0)
    weight = np.where(gray > 1.5, gray, 0.0)
    v, u = np.mgrid[:height, :width]
    x, y = (float((weight * c).sum() / weight.sum()) + 0.5 for c in (u, v))  # from the corner
    heads = []
    for stride in (16, 8):
        head = np.zeros((1, 42, height // stride, width // stride), dtype=np.float32)
        head[0, 4::14] = -30.0
        if stride == 16:
            column, row = int(x // stride), int(y // stride)
            t = np.array([x / stride - column, y / stride - row])
            head[0, :2, row, column] = np.log(t / (1 - t))
            head[0, 4, row, column] = 30.0
            head[0, 5:14, row, column] = [30.0 if name == "dog" else -30.0 for name in OWN_CLASSES]
        heads.append(head)
    return heads


@pytest.mark.family
@pytest.mark.parametrize("size", [(320, 240), (640, 480), (160, 120), (200, 333)])
def test_boxes_are_in_the_pictures_pixels_whatever_its_size(
    size: tuple[int, int], monkeypatch: pytest.MonkeyPatch
) -> None:
    shapes = []

    def seen(pixels: np.ndarray) -> list[np.ndarray]:
        shapes.append((pixels.shape, pixels.dtype, pixels.flags.c_contiguous, float(pixels.max())))
        return heads_with_one_box(pixels)

    monkeypatch.setattr(detector_network, "opencv_network", lambda path: seen)
    image = np.zeros((size[1], size[0], 3), np.uint8)
    u, v, half = round(0.4 * size[0]), round(0.6 * size[1]), size[0] // 20
    image[v - half : v + half + 1, u - half : u + half + 1] = 255
    labels, scores, boxes = load_detector(Detector(backend="opencv"), ROOM, size)(image)
    assert shapes == [((1, 3, 240, 320), np.float32, True, 1.0)]
    assert [ROOM.classes[k] for k in labels] == ["dog"]
    assert scores.tolist() == pytest.approx([1.0])
    center = (boxes[0, :2] + boxes[0, 2:]) / 2
    np.testing.assert_allclose(center, [u, v], atol=0.2)
    anchor = np.array(read_cfg(OWN_CFG).heads[0].anchors[0])
    np.testing.assert_allclose(boxes[0, 2:] - boxes[0, :2], anchor * np.array(size) / [320, 240], rtol=1e-5)


def test_boxes_are_cut_at_the_border(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(detector_network, "opencv_network", lambda path: heads_with_one_box)
    image = np.zeros((240, 320, 3), np.uint8)
    image[1:4, 315:318] = 255
    _, _, boxes = load_detector(Detector(backend="opencv"), ROOM, (320, 240))(image)
    assert boxes[0, 1] == -0.5
    assert boxes[0, 2] == 319.5
    assert boxes[0, 0] < 315.0


@pytest.mark.parametrize("seed", [0, 1])
def test_our_network_tells_boxes_inside_the_picture_best_first_and_twice_the_same(seed: int) -> None:
    """Whatever the weights: a threshold near 0 lets even random ones speak."""
    detect = load_detector(Detector(backend="opencv", threshold=1e-4), ROOM, (320, 240))
    labels, scores, boxes = detect(picture(seed))
    assert len(labels) > 0
    assert np.all((labels >= 0) & (labels < len(ROOM.classes)))
    assert np.all(np.diff(scores) <= 0)
    assert np.all((scores >= 1e-4) & (scores <= 1.0))
    assert np.all(boxes >= -0.5)
    assert np.all(boxes <= np.array([319.5, 239.5] * 2))
    assert np.all(boxes[:, :2] <= boxes[:, 2:])
    for one, other in zip(detect(picture(seed)), (labels, scores, boxes), strict=True):
        np.testing.assert_array_equal(one, other)


# --- a network of the user's ----------------------------------------------------------------------------------


@pytest.mark.long
@needs_torch
def test_a_darknet_network_of_the_users_is_computed_and_its_other_classes_dropped(tmp_path: Path) -> None:
    settings = darknet(tmp_path, 80)
    labels, scores, boxes = load_detector(settings, ROOM, (320, 240))(picture())
    cfg = read_cfg(tmp_path / "net.cfg")
    image = cv2.resize(picture(), (64, 48), interpolation=cv2.INTER_LINEAR)
    heads = torch_network(tmp_path / "net.weights", cfg)(pixels_of(image))
    anchors = [np.array(head.anchors) for head in cfg.heads]
    size = np.array([320.0, 240.0])
    every = decode(heads, anchors, np.array([64.0, 48.0]), size, settings.threshold)
    landmarks = np.array([COCO_CLASSES[k] in ROOM.classes for k in every[0]])
    assert len(every[0]) > 0
    best = {ROOM.classes.index(COCO_CLASSES[k]) for k in every[0][landmarks]}
    assert set(labels.tolist()) == best
    assert set(scores.tolist()) <= set(every[1][landmarks].tolist())
    assert len(boxes) == len(labels)


@needs_torch
def test_scale_x_y_stretches_a_boxs_place_in_its_cell(tmp_path: Path) -> None:
    settings = darknet(tmp_path, 80)
    plain = load_detector(settings, ROOM, (320, 240))(picture())
    path = tmp_path / "net.cfg"
    path.write_text(path.read_text() + "scale_x_y = 1.5 # of YOLOv4\n")
    found = load_detector(settings, ROOM, (320, 240))(picture())
    place, was = (((b[:, :2] + b[:, 2:]) / 2 + 0.5) / 20.0 for b in (found[2][:1], plain[2][:1]))  # cells of 20 px
    np.testing.assert_array_equal(found[1][:1], plain[1][:1])
    np.testing.assert_allclose(place % 1 - 0.5, 1.5 * (was % 1 - 0.5), atol=1e-9)


@needs_torch
def test_weights_of_another_length_are_refused(tmp_path: Path) -> None:
    settings = darknet(tmp_path, 80)
    whole = (tmp_path / "net.weights").read_bytes()
    needed = read_cfg(tmp_path / "net.cfg").weight_count
    for content, held in ((whole[:-4], needed - 1), (whole + b"\0" * 8, needed + 2)):
        (tmp_path / "net.weights").write_bytes(content)
        with pytest.raises(InputError, match=rf"net\.weights: holds {held} weights, this network needs {needed}"):
            load_detector(settings, ROOM, (320, 240))
    (tmp_path / "net.weights").write_bytes(whole[:-4] + np.float32(np.nan).tobytes())
    with pytest.raises(InputError, match=r"net\.weights: .*NaN"):
        load_detector(settings, ROOM, (320, 240))


@pytest.mark.parametrize("files", [{"cfg": "a.cfg"}, {"weights": "a.weights"}])
def test_a_cfg_without_weights_and_weights_without_a_cfg_are_refused(files: dict[str, str]) -> None:
    with pytest.raises(InputError, match="give both or neither"):
        validate(Detector, files, "detector")
