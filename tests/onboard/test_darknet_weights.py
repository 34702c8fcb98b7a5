"""Files of weights: there and back, and what is refused."""

import contextlib
import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.onboard.detector.darknet_cfg import parse_cfg

torch = pytest.importorskip("torch", reason="torch is not installed: the network in torch cannot be read")
pytest.importorskip("safetensors", reason="safetensors is not installed: the network's file cannot be read")

from safetensors.torch import save  # noqa: E402

from ortilo_drake.onboard.detector.darknet_file import network_bytes, read_network  # noqa: E402
from ortilo_drake.onboard.detector.darknet_network import DarknetNetwork  # noqa: E402
from ortilo_drake.onboard.detector.darknet_weights import read_weights  # noqa: E402
from ortilo_drake.onboard.detector.detector_network import OWN_NETWORK  # noqa: E402

pytestmark = pytest.mark.long  # torch takes seconds to load
CFG = """[net]\nwidth=64\nheight=32\nchannels=3
[convolutional]\nbatch_normalize=1\nfilters=4\nsize=3\nstride=2\npad=1\nactivation=leaky
[convolutional]\nfilters=14\nsize=1\nstride=1\nactivation=linear
[yolo]\nmask=0,1\nanchors=8,8,16,16\nclasses=2\nnum=2
"""
COUNT = 4 * 4 + 4 * 27 + 14 + 14 * 4
CLASSES = ["cat", "clock"]


def network(seed: int = 0) -> DarknetNetwork:
    made = DarknetNetwork(parse_cfg(CFG, "small.cfg")).eval()
    rng = np.random.default_rng(seed)
    for value in made.state_dict().values():
        if value.ndim:
            value.copy_(torch.from_numpy(rng.uniform(0.1, 1.0, tuple(value.shape))))
    return made


def assert_same(a: DarknetNetwork, b: DarknetNetwork, rtol: float = 0.0) -> None:
    for key, value in a.state_dict().items():
        np.testing.assert_allclose(b.state_dict()[key].numpy(), value.numpy(), rtol=rtol, err_msg=key)


def header(major: int, minor: int, seen: int) -> bytes:
    seen_type = "<i8" if 10 * major + minor >= 2 else "<i4"
    return np.array([major, minor, 0], dtype="<i4").tobytes() + np.array([seen], dtype=seen_type).tobytes()


@pytest.mark.parametrize(("major", "minor"), [(0, 1), (0, 2), (0, 5), (1, 0), (2, 0)])
def test_reads_darknets_order_under_every_header(major: int, minor: int, tmp_path: Path) -> None:
    path, made = tmp_path / "net.weights", DarknetNetwork(parse_cfg(CFG, "small.cfg"))
    values = np.arange(COUNT, dtype="<f4")
    path.write_bytes(header(major, minor, 123) + values.tobytes())
    read_weights(path, made)
    first, second = made.convolutions()
    assert first.norm is not None
    assert second.convolution.bias is not None
    order = [first.norm.bias, first.norm.weight, first.norm.running_mean, first.norm.running_var]
    order += [first.convolution.weight, second.convolution.bias, second.convolution.weight]
    read = [value.detach().numpy().ravel() for value in order if value is not None]
    np.testing.assert_array_equal(np.concatenate(read), values)
    assert first.convolution.weight[1, 2, 0, 1].item() == 16 + 27 + 18 + 1  # (filters, inputs, rows, columns)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "0 bytes: must start with a header of 16"),
        (header(0, 2, 0)[:11], "11 bytes: must start with a header of 20"),
        (header(0, 2, 0)[:18], "18 bytes: must start with a header of 20"),
        (header(0, 2, 0), f"holds 0 weights, this network needs {COUNT}"),
        (header(0, 2, 0) + bytes(4 * COUNT - 4), f"holds {COUNT - 1} weights, this network needs {COUNT}"),
        (header(0, 2, 0) + bytes(4 * COUNT + 4), f"holds {COUNT + 1} weights, this network needs {COUNT}"),
        (header(0, 2, 0) + bytes(4 * COUNT + 2), f"holds {COUNT + 0.5} weights, this network needs {COUNT}"),
        (header(0, 2, 0) + np.full(COUNT, np.nan, "<f4").tobytes(), "convolution 0 convolution.weight: holds NaN or"),
        (header(0, 2, 0) + np.full(COUNT, -1, "<f4").tobytes(), "convolution 0 norm.running_var: holds -1.0, must be"),
        (b"[net]\nwidth=64\nheight=32\n", "must be from 0.0 to 999.999; is it a .weights file?"),
        (header(1001, 0, 0), "version 1001.0: must be from 0.0 to 999.999"),
    ],
)
def test_refuses_weights(content: bytes, message: str, tmp_path: Path) -> None:
    path = tmp_path / "net.weights"
    path.write_bytes(content)
    with pytest.raises(InputError) as error:
        read_weights(path, network())
    assert str(error.value).startswith(f"{path}: ")
    assert message in str(error.value)


def test_refuses_files_that_are_not_there(tmp_path: Path) -> None:
    for read in (lambda path: read_weights(path, network()), read_network):
        for path in (tmp_path / "none", tmp_path):
            with pytest.raises(InputError, match="cannot be read"):
                read(path)


def test_own_file_there_and_back(tmp_path: Path) -> None:
    path, made = tmp_path / "net.safetensors", network()
    path.write_bytes(network_bytes(made, CLASSES, "net"))
    read, classes = read_network(path)
    assert classes == CLASSES
    assert read.cfg == made.cfg
    assert not read.training
    assert_same(made, read, rtol=2.0**-11)  # float16 keeps 11 bits
    again = tmp_path / "again.safetensors"
    again.write_bytes(network_bytes(read, classes, "net"))
    assert_same(read, read_network(again)[0], rtol=0.0)  # the second rounding to float16 changes nothing


@pytest.mark.parametrize("epsilon", [1e-6, 1e-5, 1e-3])
def test_own_file_keeps_what_is_added_to_a_variance(epsilon: float, tmp_path: Path) -> None:
    made = DarknetNetwork(parse_cfg(CFG, "small.cfg"), epsilon).eval()
    path = tmp_path / "net.safetensors"
    path.write_bytes(network_bytes(made, CLASSES, "net"))
    norms = [layer.norm for layer in read_network(path)[0].convolutions() if layer.norm is not None]
    assert [norm.eps for norm in norms] == [epsilon] * len(norms) != []


def test_our_network_is_computed_as_it_was_trained() -> None:
    (epsilon,) = {layer.norm.eps for layer in read_network(OWN_NETWORK)[0].convolutions() if layer.norm is not None}
    assert epsilon == 1e-5


@pytest.mark.parametrize("classes", [["cat"], ["cat", ""], ["cat", "clock", "dog"]])
def test_refuses_to_write_other_classes(classes: list[str]) -> None:
    with pytest.raises(InputError, match="classes: "):
        network_bytes(network(), classes, "net")


@pytest.mark.parametrize("value", [70_000.0, float("nan")])
def test_refuses_to_write_what_float16_cannot_hold(value: float) -> None:
    made = network()
    made.convolutions()[0].convolution.weight.data[0] = value
    with pytest.raises(InputError, match=r"layers.0.convolution.weight: holds NaN, inf or more than float16's 65504"):
        network_bytes(made, CLASSES, "net")


def own_file(metadata: dict[str, str] | None = None, **tensors: object) -> bytes:
    """A file with some metadata and tensors exchanged; None leaves one out. __ stands for a key's point."""
    state = {key: value for key, value in network().state_dict().items() if "batches" not in key}
    state |= {key.replace("__", "."): value for key, value in tensors.items()}
    texts = {"cfg": CFG, "classes": json.dumps(CLASSES)} | (metadata or {})
    kept = {key: value for key, value in state.items() if value is not None}
    return bytes(save(kept, metadata={key: text for key, text in texts.items() if text}))


BIAS = "layers__1__convolution__bias"


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (own_file({"cfg": ""}), "metadata 'cfg': is missing"),
        (own_file({"classes": ""}), "metadata 'classes': is missing"),
        (own_file({"cfg": "[net]"}), "cfg: line 1: [net] width: is missing"),
        (own_file({"classes": "["}), "classes: '[': must be a list of names"),
        (own_file({"classes": '{"cat": 1}'}), "must be a list of names"),
        (own_file({"classes": '["cat"]'}), "classes: holds 1 names, this network needs 2"),
        (own_file({"epsilon": "0.0"}), "epsilon: 0.0: must be a number between 0 and 1"),
        (own_file({"epsilon": "small"}), "epsilon: 'small': must be a number between 0 and 1"),
        (own_file(**{BIAS: None}), "tensor 'layers.1.convolution.bias': is missing"),
        (own_file(other=torch.zeros(1)), "tensor 'other': is not of its cfg"),
        (
            own_file(**{BIAS: torch.zeros(13)}),
            "tensor 'layers.1.convolution.bias': is F32 (13,), must be F16 or F32 (14,)",
        ),
        (own_file(**{BIAS: torch.zeros(14, dtype=torch.int64)}), "is I64 (14,), must be F16 or F32 (14,)"),
        (own_file(**{BIAS: torch.full((14,), torch.nan)}), "convolution 1 convolution.bias: holds NaN or inf"),
        (own_file(layers__0__norm__running_var=-torch.ones(4)), "convolution 0 norm.running_var: holds -1.0, must be"),
        (b"", "cannot be read"),
        (b"\x80\x04K\x01.", "cannot be read"),  # a pickle
        (own_file()[:-1], "cannot be read"),
        (own_file() + b"\0", "cannot be read"),
    ],
)
def test_refuses_own_files(content: bytes, message: str, tmp_path: Path) -> None:
    path = tmp_path / "net.safetensors"
    path.write_bytes(content)
    with pytest.raises(InputError) as error:
        read_network(path)
    assert str(error.value).startswith(f"{path}: ")
    assert message in str(error.value)
    assert "\n" not in str(error.value)


GOOD = own_file()


@settings(max_examples=300)
@given(place=st.integers(0, len(GOOD) - 1), byte=st.integers(0, 255), cut=st.booleans())
def test_a_damaged_file_is_a_network_or_an_input_error(
    place: int, byte: int, cut: bool, tmp_path_factory: pytest.TempPathFactory
) -> None:
    path = tmp_path_factory.mktemp("damaged") / "net.safetensors"
    path.write_bytes(GOOD[:place] if cut else GOOD[:place] + bytes([byte]) + GOOD[place + 1 :])
    with contextlib.suppress(InputError):
        read, classes = read_network(path)
        assert not cut
        assert len(classes) == 2
        assert all(torch.isfinite(value).all() for value in read.state_dict().values())
