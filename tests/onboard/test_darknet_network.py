"""The torch network against OpenCV's Darknet importer, on the three published architectures.

The references come from scripts/make_darknet_references.py; the weights from the same seed as there.
"""

import json
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from darknet_architectures import ANCHORS, SIZES, architecture, seeded_image, write_seeded_weights
from scipy.ndimage import correlate

from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.onboard.detector.darknet_cfg import parse_cfg
from ortilo_drake.onboard.detector.darknet_layers import Convolutional, Maxpool
from ortilo_drake.onboard.detector.yolo_boxes import decode

torch = pytest.importorskip("torch", reason="torch is not installed: the network in torch cannot run")

from ortilo_drake.onboard.detector.darknet_network import Convolution, DarknetNetwork, Pool  # noqa: E402
from ortilo_drake.onboard.detector.darknet_weights import read_weights  # noqa: E402

REFERENCES = json.loads((Path(__file__).parents[1] / "data" / "darknet_references.json").read_text())


def read_seeded(name: str, folder: Path) -> DarknetNetwork:
    weights = folder / f"{name}.weights"
    # Should another NumPy draw other numbers, say so rather than blame the network.
    assert write_seeded_weights(weights, name) == REFERENCES[name]["crc32"], "these are not the reference's weights"
    network = DarknetNetwork(parse_cfg(architecture(name).text, name)).eval()
    read_weights(weights, network)
    weights.unlink()  # a quarter of a gigabyte
    return network


@pytest.mark.parametrize("name", list(ANCHORS))
def test_heads_and_boxes_are_opencvs(name: str, tmp_path: Path) -> None:
    reference, network = REFERENCES[name], read_seeded(name, tmp_path)
    with torch.inference_mode():
        heads = [head.numpy() for head in network(torch.from_numpy(seeded_image(name)))]
    assert len(heads) == len(reference["heads"])
    for head, expected in zip(heads, reference["heads"], strict=True):
        assert list(head.shape) == expected["shape"]
        rms = expected["norm"] / head.size**0.5
        np.testing.assert_allclose(
            head.ravel()[expected["indices"]], expected["values"], rtol=2e-5, atol=2e-5 * rms
        )  # found: 6e-6 rms
        assert np.linalg.norm(head.astype(float)) == pytest.approx(expected["norm"], rel=1e-6)

    size = np.array(SIZES[name], dtype=float)
    anchors = [np.array(head.anchors) for head in network.cfg.heads]
    labels, scores, boxes = decode(heads, anchors, size, size, reference["threshold"])
    expected_labels, expected_scores, x, y, w, h = np.array(reference["boxes"]).T
    expected_boxes = np.stack([x - w / 2, y - h / 2, x + w / 2, y + h / 2], axis=1) * np.tile(size, 2) - 0.5
    assert len(labels) == len(expected_labels)
    # Each has its own order: pair them by class and left edge.
    ours, theirs = np.lexsort((boxes[:, 0], labels)), np.lexsort((expected_boxes[:, 0], expected_labels))
    np.testing.assert_array_equal(labels[ours], expected_labels[theirs])
    np.testing.assert_allclose(scores[ours], expected_scores[theirs], rtol=2e-6)
    spans = np.abs(expected_boxes).max(axis=1)[theirs, np.newaxis]
    assert np.all(np.abs(boxes[ours] - expected_boxes[theirs]) < 2e-5 * spans + 1e-3)


SMALL = """[net]\nwidth=64\nheight=32\nchannels=3
[convolutional]\nbatch_normalize=1\nfilters=7\nsize=3\nstride=2\npad=1\nactivation=leaky
[maxpool]\nsize=2\nstride=2
[convolutional]\nfilters=14\nsize=1\nstride=1\nactivation=linear
[yolo]\nmask=0,1\nanchors=8,8,16,16\nclasses=2\nnum=2
"""


@pytest.mark.parametrize(("n", "height", "width"), [(1, 32, 64), (3, 4, 12), (2, 100, 4)])
def test_any_multiple_of_the_stride_works(n: int, height: int, width: int) -> None:
    network = DarknetNetwork(parse_cfg(SMALL, "small.cfg"))
    (head,) = network(torch.zeros(n, 3, height, width))
    assert head.shape == (n, 14, height // 4, width // 4)


@pytest.mark.parametrize("shape", [(1, 3, 30, 64), (1, 3, 32, 62), (1, 1, 32, 64), (3, 32, 64), (1, 3, 0, 64)])
def test_refuses_images_of_another_shape(shape: tuple[int, ...]) -> None:
    with pytest.raises(InputError, match=r"images: .*: must be \(n, 3, height, width\), multiples of the stride 4"):
        DarknetNetwork(parse_cfg(SMALL, "small.cfg"))(torch.zeros(shape))


@pytest.mark.parametrize(("size", "stride"), [(2, 1), (2, 2), (3, 1), (3, 2), (4, 2), (5, 1), (13, 1)])
def test_pool_is_darknets_loop(size: int, stride: int) -> None:
    x = np.random.default_rng(size).normal(size=(1, 2, 8, 6)).astype(np.float32)
    # Darknet: padding = size - 1, half of it (rounded down) before; outside the image is never the largest.
    padding = size - 1
    n_y, n_x = (8 + padding - size) // stride + 1, (6 + padding - size) // stride + 1
    expected = np.full((1, 2, n_y, n_x), -np.inf, dtype=np.float32)
    for row, column, i, j in product(range(n_y), range(n_x), range(size), range(size)):
        v, u = row * stride + i - padding // 2, column * stride + j - padding // 2
        if 0 <= v < 8 and 0 <= u < 6:
            expected[:, :, row, column] = np.maximum(expected[:, :, row, column], x[:, :, v, u])
    np.testing.assert_array_equal(Pool(Maxpool(size, stride))(torch.from_numpy(x)).numpy(), expected)


@pytest.mark.parametrize(
    ("activation", "expected"), [("linear", -2.0), ("leaky", -0.2), ("logistic", 1.0 / (1.0 + np.exp(2.0)))]
)
def test_convolution_normalises_and_then_activates(activation: str, expected: float) -> None:
    layer = Convolution(Convolutional(1, 1, 1, 1, True, activation)).eval()
    values = {"convolution.weight": 3.0, "norm.weight": 0.5, "norm.bias": 1.0}
    values |= {"norm.running_mean": 9.0, "norm.running_var": 1.0 - 1e-6}
    for key, value in values.items():
        layer.state_dict()[key].fill_(value)
    with torch.inference_mode():  # 0.5 (3 x 1 - 9) / sqrt(1 - 1e-6 + 1e-6) + 1 = -2
        assert float(layer(torch.ones(1, 1, 1, 1))) == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("size", [1, 3, 5, 7])
def test_a_convolution_keeps_the_shape_and_is_scipys(size: int) -> None:
    rng = np.random.default_rng(size)
    x, w = (rng.normal(size=shape).astype(np.float32) for shape in ((9, 8), (size, size)))
    layer = Convolution(Convolutional(1, 1, size, 1, False, "linear")).eval()
    layer.state_dict()["convolution.weight"].copy_(torch.from_numpy(w))
    layer.state_dict()["convolution.bias"].fill_(0.5)
    with torch.inference_mode():
        found = layer(torch.from_numpy(x)[None, None])[0, 0].numpy()
    np.testing.assert_allclose(found, correlate(x, w, mode="constant") + 0.5, atol=1e-5)


def test_a_variance_of_zero_is_divided_by_as_opencv_does() -> None:
    layer = Convolution(Convolutional(1, 1, 1, 1, True, "linear")).eval()
    values = {"convolution.weight": 3.0, "norm.weight": 1.0, "norm.bias": 0.0, "norm.running_mean": 2.0}
    for key, value in (values | {"norm.running_var": 0.0}).items():
        layer.state_dict()[key].fill_(value)
    with torch.inference_mode():  # (3 - 2) / sqrt(0 + 1e-6); Darknet's own 1e-6 is added to the root
        assert float(layer(torch.ones(1, 1, 1, 1))) == pytest.approx(1e3, rel=1e-6)
