"""Exported networks compute what was trained: torch, onnxruntime and OpenCV agree."""

import io
import warnings
from pathlib import Path

import cv2
import numpy as np
import pytest

from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.onboard.detector.darknet_cfg import parse_cfg, read_cfg
from ortilo_drake.onboard.detector.detector_network import OWN_CFG, OWN_CLASSES, OWN_NETWORK, OWN_ONNX
from ortilo_drake.onboard.detector.network_backends import onnxruntime_network, opencv_network, torch_network
from ortilo_drake.onboard.detector.yolo_boxes import decode

torch = pytest.importorskip("torch", reason="torch is not installed: nothing can be exported")
pytest.importorskip("safetensors", reason="safetensors is not installed: a trained network cannot be read")
pytest.importorskip("onnxruntime", reason="onnxruntime is not installed: nothing to compare with")

from ortilo_drake.onboard.detector.darknet_file import network_bytes, read_network  # noqa: E402
from ortilo_drake.onboard.detector.darknet_network import DarknetNetwork  # noqa: E402
from ortilo_drake.training.network.export import export, fold_batch_norm  # noqa: E402

pytestmark = pytest.mark.training

SPP = """[net]\nwidth=64\nheight=32\nchannels=3
[convolutional]\nbatch_normalize=1\nfilters=6\nsize=3\nstride=2\npad=1\nactivation=leaky
[convolutional]\nbatch_normalize=1\nfilters=6\nsize=3\nstride=1\npad=1\nactivation=leaky
[shortcut]\nfrom=-2\nactivation=linear
[maxpool]\nsize=2\nstride=2
[maxpool]\nsize=5\nstride=1
[route]\nlayers=-1,-2
[convolutional]\nfilters=14\nsize=1\nstride=1\nactivation=linear
[yolo]\nmask=2,3\nanchors=4,4,8,8,16,16,30,20\nclasses=2\nnum=4
[route]\nlayers=-3
[upsample]\nstride=2
[route]\nlayers=-1,2
[convolutional]\nbatch_normalize=1\nfilters=8\nsize=3\nstride=1\npad=1\nactivation=leaky
[convolutional]\nfilters=14\nsize=1\nstride=1\nactivation=linear
[yolo]\nmask=0,1\nanchors=4,4,8,8,16,16,30,20\nclasses=2\nnum=4
"""


def seeded(text: str) -> DarknetNetwork:
    """Return a network whose normalisations do something, as trained ones do."""
    torch.manual_seed(0)
    network = DarknetNetwork(parse_cfg(text, "net.cfg")).eval()
    rng = np.random.default_rng(0)
    for layer in network.convolutions():
        if layer.norm is not None:
            for name, low, high in (
                ("weight", 0.5, 2.0),
                ("bias", -0.5, 0.5),
                ("running_mean", -0.3, 0.3),
                ("running_var", 0.2, 2.0),
            ):
                values = rng.uniform(low, high, layer.norm.num_features).astype(np.float32)
                getattr(layer.norm, name).data.copy_(torch.from_numpy(values))
    return network


@pytest.fixture(scope="module", params=["ours", "spp"])
def exported(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    folder = tmp_path_factory.mktemp("export")
    source, onnx = folder / "net.safetensors", folder / "new" / "net.onnx"
    text = OWN_CFG.read_text() if request.param == "ours" else SPP
    network = seeded(text)
    classes = list(OWN_CLASSES) if request.param == "ours" else ["cat", "clock"]
    source.write_bytes(network_bytes(network, classes, str(source)))
    with warnings.catch_warnings():
        warnings.filterwarnings(
            "ignore", category=DeprecationWarning
        )  # torch's own older exporter needs no further package
        export(source, onnx)
    return source, onnx


def test_both_readers_of_onnx_compute_torchs_heads_and_boxes(exported: tuple[Path, Path]) -> None:
    source, onnx = exported
    cfg = read_network(source)[0].cfg
    size = np.array([cfg.net.width, cfg.net.height], dtype=float)
    pixels = np.random.default_rng(1).random((1, 3, cfg.net.height, cfg.net.width), dtype=np.float32)
    expected = torch_network(source, cfg)(pixels)
    anchors = [np.array(head.anchors) for head in cfg.heads]
    scores = decode(expected, anchors, size, size, 0.01)[1]
    threshold = float(np.sort(scores)[-30:].min()) * (1 - 1e-4)
    boxes = decode(expected, anchors, size, size, threshold)
    assert len(boxes[0]) >= 20
    for network in (onnxruntime_network(onnx), opencv_network(onnx)):
        heads = network(pixels)
        assert [head.shape for head in heads] == [head.shape for head in expected]
        for head, other in zip(heads, expected, strict=True):
            np.testing.assert_allclose(head, other, rtol=1e-4, atol=1e-4 * np.abs(other).max())
        found = decode(heads, anchors, size, size, threshold)
        np.testing.assert_array_equal(found[0], boxes[0])
        np.testing.assert_allclose(found[2], boxes[2], rtol=1e-3, atol=0.02)


def test_folding_leaves_the_heads_as_they_were() -> None:
    network = seeded(SPP)
    images = torch.rand(2, 3, 32, 64, generator=torch.Generator().manual_seed(2))
    with torch.inference_mode():
        before = network(images)
    with torch.no_grad():
        fold_batch_norm(network)
    assert all(layer.norm is None for layer in network.convolutions())
    with torch.inference_mode():
        for one, other in zip(before, network(images), strict=True):
            np.testing.assert_allclose(other.numpy(), one.numpy(), rtol=1e-4, atol=1e-5)


def test_nothing_half_done_is_left(exported: tuple[Path, Path]) -> None:
    assert [path.name for path in exported[1].parent.iterdir()] == ["net.onnx"]


def test_a_damaged_source_is_refused_and_nothing_written(tmp_path: Path) -> None:
    (tmp_path / "net.safetensors").write_bytes(b"\x08" + b"\x00" * 7 + b"{}      ")
    with pytest.raises(InputError, match=r"net\.safetensors"):
        export(tmp_path / "net.safetensors", tmp_path / "net.onnx")
    assert not (tmp_path / "net.onnx").exists()


def test_the_shipped_network_is_the_same_in_both_files_and_its_own_cfg() -> None:
    """Of whatever weights the package ships."""
    network, classes = read_network(OWN_NETWORK)
    cfg = read_cfg(OWN_CFG)
    assert tuple(classes) == OWN_CLASSES
    assert (network.cfg.net, network.cfg.layers) == (cfg.net, cfg.layers)
    pixels = np.random.default_rng(1).random((1, 3, cfg.net.height, cfg.net.width), dtype=np.float32)
    for head, other in zip(onnxruntime_network(OWN_ONNX)(pixels), torch_network(OWN_NETWORK, cfg)(pixels), strict=True):
        np.testing.assert_allclose(head, other, rtol=1e-3, atol=1e-4 * max(1.0, float(np.abs(other).max())))
    onnx = pytest.importorskip("onnx", reason="onnx is not installed: the file's form is not checked")
    onnx.checker.check_model(onnx.load_model(io.BytesIO(OWN_ONNX.read_bytes())))


def test_opencv_gives_the_heads_in_the_order_of_the_cfg() -> None:
    cfg = read_cfg(OWN_CFG)
    pixels = np.zeros((1, 3, cfg.net.height, cfg.net.width), dtype=np.float32)
    shapes = [head.shape[2:] for head in opencv_network(OWN_ONNX)(pixels)]
    assert (
        shapes
        == [cfg.shapes[i][1:] for i, layer in enumerate(cfg.layers) if layer in cfg.heads]
        == [(15, 20), (30, 40)]
    )
    assert cv2.getNumThreads() == 1
