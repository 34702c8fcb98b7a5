"""The torch network against OpenCV's Darknet importer, on four published architectures and one of ours.

The references come from scripts/make_darknet_references.py; the weights from the same seed as there.
"""

import json
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from darknet_architectures import ANCHORS, SIZES, architecture, seeded_image, write_seeded_weights
from scipy.ndimage import correlate

from ortilo_drake.onboard.detector.darknet_cfg import parse_cfg
from ortilo_drake.onboard.detector.darknet_layers import ACTIVATIONS, Convolutional, Maxpool
from ortilo_drake.onboard.detector.yolo_boxes import decode

torch = pytest.importorskip("torch", reason="torch is not installed: the network in torch cannot run")

from ortilo_drake.onboard.detector.darknet_network import (  # noqa: E402
    Activation,
    Convolution,
    DarknetNetwork,
    Pool,
)
from ortilo_drake.onboard.detector.darknet_weights import read_weights  # noqa: E402

pytestmark = pytest.mark.long  # torch takes seconds to load
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
    scales = [head.scale_x_y for head in network.cfg.heads]
    labels, scores, boxes = decode(heads, anchors, size, size, reference["threshold"], scales)
    expected_labels, expected_scores, x, y, w, h = np.array(reference["boxes"]).T
    expected_boxes = np.stack([x - w / 2, y - h / 2, x + w / 2, y + h / 2], axis=1) * np.tile(size, 2) - 0.5
    assert len(labels) == len(expected_labels)
    # Each has its own order: pair them by class and left edge.
    ours, theirs = np.lexsort((boxes[:, 0], labels)), np.lexsort((expected_boxes[:, 0], expected_labels))
    np.testing.assert_array_equal(labels[ours], expected_labels[theirs])
    # A score is the product of two logistic functions of numbers that were held to 2e-5 rms above; each grows by no
    # more than its argument does. How single precision rounds depends on the processor: 2.3e-6 was found.
    largest = max(head["norm"] / np.prod(head["shape"]) ** 0.5 for head in reference["heads"])
    np.testing.assert_allclose(scores[ours], expected_scores[theirs], rtol=2 * 2e-5 * largest)
    spans = np.abs(expected_boxes).max(axis=1)[theirs, np.newaxis]
    assert np.all(np.abs(boxes[ours] - expected_boxes[theirs]) < 2e-5 * spans + 1e-3)


SMALL = """[net]\nwidth=64\nheight=32\nchannels=3
[convolutional]\nbatch_normalize=1\nfilters=7\nsize=3\nstride=2\npad=1\nactivation=leaky
[maxpool]\nsize=2\nstride=2
[convolutional]\nfilters=14\nsize=1\nstride=1\nactivation=linear
[yolo]\nmask=0,1\nanchors=8,8,16,16\nclasses=2\nnum=2
"""


@pytest.mark.parametrize("n", [1, 3])
def test_computes_several_images_at_once(n: int) -> None:
    network = DarknetNetwork(parse_cfg(SMALL, "small.cfg")).eval()
    images = torch.rand(n, 3, 32, 64, generator=torch.Generator().manual_seed(n))
    (head,) = network(images)
    assert head.shape == (n, 14, 8, 16)
    torch.testing.assert_close(head[-1:], network(images[-1:])[0])


@pytest.mark.parametrize(
    ("size", "stride", "padding"),
    [(2, 1, 1), (2, 2, 1), (3, 1, 2), (3, 2, 2), (4, 2, 3), (5, 1, 4), (13, 1, 12), (2, 2, 0), (3, 2, 5), (3, 3, 1)],
)
def test_pool_is_darknets_loop(size: int, stride: int, padding: int) -> None:
    x = np.random.default_rng(size).normal(size=(1, 2, 8, 7)).astype(np.float32)
    # Darknet: half of the padding (rounded down) before; outside the image is never the largest.
    n_y, n_x = (8 + padding - size) // stride + 1, (7 + padding - size) // stride + 1
    expected = np.full((1, 2, n_y, n_x), -np.inf, dtype=np.float32)
    for row, column, i, j in product(range(n_y), range(n_x), range(size), range(size)):
        v, u = row * stride + i - padding // 2, column * stride + j - padding // 2
        if 0 <= v < 8 and 0 <= u < 7:
            expected[:, :, row, column] = np.maximum(expected[:, :, row, column], x[:, :, v, u])
    np.testing.assert_array_equal(Pool(Maxpool(size, stride, padding))(torch.from_numpy(x)).numpy(), expected)


def sigmoid(x: np.ndarray) -> np.ndarray:
    return 1.0 / (1.0 + np.exp(-x))


CLOSED_FORMS = {  # as Darknet's activations.h and activations.c write them
    "linear": lambda x: x,
    "leaky": lambda x: np.where(x > 0, x, 0.1 * x),
    "logistic": sigmoid,
    "mish": lambda x: x * np.tanh(np.log1p(np.exp(x))),
    "hard_mish": lambda x: np.select([x > 0, x > -2], [x, x * x / 2 + x], 0.0),
    "swish": lambda x: x * sigmoid(x),
    "relu": lambda x: np.maximum(x, 0.0),
    "relu6": lambda x: np.minimum(np.maximum(x, 0.0), 6.0),
    "elu": lambda x: np.where(x >= 0, x, np.expm1(x)),
    "selu": lambda x: 1.0507 * np.where(x >= 0, x, 1.6732 * np.expm1(x)),
    "gelu": lambda x: 0.5 * x * (1.0 + np.tanh(0.797885 * x + 0.035677 * x**3)),
    "tanh": lambda x: 2.0 * sigmoid(2.0 * x) - 1.0,
    "hardtan": lambda x: np.clip(x, -1.0, 1.0),
    "loggy": lambda x: 2.0 * sigmoid(x) - 1.0,
    "relie": lambda x: np.where(x > 0, x, 0.01 * x),
    "ramp": lambda x: np.maximum(x, 0.0) + 0.1 * x,
}


@pytest.mark.parametrize("name", ACTIVATIONS)
def test_activation_is_darknets(name: str) -> None:
    x = np.linspace(-12.0, 12.0, 97)
    found = Activation(name)(torch.from_numpy(x.astype(np.float32))).numpy()
    np.testing.assert_allclose(found, CLOSED_FORMS[name](x), rtol=2e-6, atol=2e-5)


def test_convolution_normalises_and_then_activates() -> None:
    layer = Convolution(Convolutional(1, 1, 1, 1, 0, True, "leaky")).eval()
    values = {"convolution.weight": 3.0, "norm.weight": 0.5, "norm.bias": 1.0}
    values |= {"norm.running_mean": 9.0, "norm.running_var": 1.0 - 1e-6}
    for key, value in values.items():
        layer.state_dict()[key].fill_(value)
    with torch.inference_mode():  # 0.5 (3 x 1 - 9) / sqrt(1 - 1e-6 + 1e-6) + 1 = -2
        assert float(layer(torch.ones(1, 1, 1, 1))) == pytest.approx(-0.2, rel=1e-6)


def test_a_route_of_groups_takes_that_part_of_each_layer() -> None:
    text = SMALL.replace("filters=7", "filters=6").replace("filters=14", "filters=14\npad=0")
    text = text.replace("[maxpool]", "[route]\nlayers=-1,-1\ngroups=3\ngroup_id=2\n[maxpool]")
    network = DarknetNetwork(parse_cfg(text, "small.cfg")).eval()
    images = torch.rand(1, 3, 32, 64, generator=torch.Generator().manual_seed(4))
    seen: list[torch.Tensor] = []
    network.layers[0].register_forward_hook(lambda module, given, made: seen.append(made))
    network.layers[2].register_forward_hook(lambda module, given, made: seen.append(given[0]))
    network(images)
    whole, routed = (x.detach().numpy() for x in seen)
    np.testing.assert_array_equal(routed, whole[:, [4, 5, 4, 5]])


@pytest.mark.parametrize("size", [1, 3, 5, 7])
def test_a_convolution_keeps_the_shape_and_is_scipys(size: int) -> None:
    rng = np.random.default_rng(size)
    x, w = (rng.normal(size=shape).astype(np.float32) for shape in ((9, 8), (size, size)))
    layer = Convolution(Convolutional(1, 1, size, 1, size // 2, False, "linear")).eval()
    layer.state_dict()["convolution.weight"].copy_(torch.from_numpy(w))
    layer.state_dict()["convolution.bias"].fill_(0.5)
    with torch.inference_mode():
        found = layer(torch.from_numpy(x)[None, None])[0, 0].numpy()
    np.testing.assert_allclose(found, correlate(x, w, mode="constant") + 0.5, atol=1e-5)


def test_a_variance_of_zero_is_divided_by_as_opencv_does() -> None:
    layer = Convolution(Convolutional(1, 1, 1, 1, 0, True, "linear")).eval()
    values = {"convolution.weight": 3.0, "norm.weight": 1.0, "norm.bias": 0.0, "norm.running_mean": 2.0}
    for key, value in (values | {"norm.running_var": 0.0}).items():
        layer.state_dict()[key].fill_(value)
    with torch.inference_mode():  # (3 - 2) / sqrt(0 + 1e-6); Darknet's own 1e-6 is added to the root
        assert float(layer(torch.ones(1, 1, 1, 1))) == pytest.approx(1e3, rel=1e-6)
