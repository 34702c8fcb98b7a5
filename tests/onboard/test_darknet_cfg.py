"""Darknet's .cfg: the three published architectures, and what is refused."""

import contextlib
from pathlib import Path

import pytest
from darknet_architectures import architecture
from hypothesis import given
from hypothesis import strategies as st

from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.onboard.detector.darknet_cfg import parse_cfg, read_cfg
from ortilo_drake.onboard.detector.darknet_layers import Convolutional, DarknetCfg, Maxpool, Route, Shortcut

SMALL = """\
# a comment
[net]
width=64
height = 32
channels=3

[convolutional]
batch_normalize=1
filters=8
size=3
stride=2
pad=1
activation=leaky

[convolutional]
filters=8
size=1
stride=1
activation=logistic

[shortcut]
from=-2
activation=linear

[maxpool]
size=2
stride=2

[upsample]
stride=2

[route]
layers = -1, 0

[convolutional]
filters=14
size=1
stride=1
activation=linear

[yolo]
mask=0,2
anchors=1,2, 3,4, 5.5,6
classes=2
num=3
"""


@pytest.mark.parametrize(
    ("name", "layers", "convolutions", "file_size"),
    [  # layers and sizes of the .weights files as published
        ("yolov3", 107, 75, 248_007_048),
        ("yolov3-spp", 114, 76, 252_209_544),
        ("yolov3-tiny", 24, 13, 35_434_956),
    ],
)
def test_published_architectures(name: str, layers: int, convolutions: int, file_size: int) -> None:
    cfg = parse_cfg(architecture(name).text, name)
    assert len(cfg.layers) == layers
    assert sum(isinstance(layer, Convolutional) for layer in cfg.layers) == convolutions
    assert 4 * cfg.weight_count + 20 == file_size
    assert cfg.stride == 32
    assert cfg.strides == ((32, 16) if name == "yolov3-tiny" else (32, 16, 8))
    assert cfg.heads[0].anchors[-1] == ((344.0, 319.0) if name == "yolov3-tiny" else (373.0, 326.0))


def test_numbers_and_values_of_a_small_network() -> None:
    cfg = parse_cfg("\ufeff" + SMALL.replace("\n", "\r\n"), "small.cfg")
    assert (cfg.net.width, cfg.net.height, cfg.stride, cfg.strides) == (64, 32, 4, (2,))
    assert cfg.layers[0] == Convolutional(3, 8, 3, 2, True, "leaky")
    assert cfg.layers[1] == Convolutional(8, 8, 1, 1, False, "logistic")
    assert cfg.layers[2:4] == (Shortcut(0, "linear"), Maxpool(2, 2))
    assert cfg.layers[5:7] == (Route((4, 0)), Convolutional(16, 14, 1, 1, False, "linear"))
    assert cfg.heads[0].anchors == ((1.0, 2.0), (5.5, 6.0))
    assert cfg.weight_count == (8 * 27 + 32) + (64 + 8) + (16 * 14 + 14)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("[net]", "[nets]", "line 2: the first section must be [net]"),
        ("# a comment", "width=3", "line 1: 'width=3': must come after [net]"),
        ("# a comment", "hello", "line 1: 'hello': must be [section], key = value or # comment"),
        ("width=64", "", "line 2: [net] width: is missing"),
        ("width=64", "width=66", "line 3: [net] width: '66': must be a multiple of the network's stride 4"),
        ("width=64", "width=1_6", "line 3: [net] width: '1_6': must be a whole number from 1 to 8192"),
        ("width=64", "width=٦٤", "line 3: [net] width: '٦٤': must be a whole number from 1 to 8192"),
        ("channels=3", "channels=1", "line 5: [net] channels: '1': must be a whole number from 3 to 3"),
        ("channels=3", "channels=3\nletter_box=1", "line 6: [net] letter_box: '1': must be 0"),
        ("[maxpool]", "[avgpool]", "line 25: [avgpool]: unknown layer, known are [convolutional], [shortcut], "),
        ("pad=1", "", "line 7: [convolutional] pad: is missing"),
        ("pad=1", "pad=0", "line 12: [convolutional] pad: '0': must be 1 where size is not 1"),
        ("size=3", "size=4", "line 10: [convolutional] size: '4': must be odd"),
        ("size=3", "size=3\nsize=3", "line 10: [convolutional] size: '3': stands again in line 11"),
        ("size=3", "sizes=3", "line 10: [convolutional] sizes: '3': unknown key, known are activation, batch_norm"),
        ("size=3", "size=3\ngroups=2", "line 11: [convolutional] groups: '2': must be 1"),
        ("batch_normalize=1", "batch_normalize=2", "line 8: [convolutional] batch_normalize: '2': must be a whole"),
        ("=leaky", "=mish", "line 13: [convolutional] activation: 'mish': must be one of linear, leaky, logistic"),
        (
            "from=-2",
            "from=-3",
            "line 22: [shortcut] from: '-3': must be from 0 to 1, or from -2 to -1, here",
        ),
        ("from=-2", "from=2", "line 22: [shortcut] from: '2': must be from 0 to 1, or from -2 to -1, here"),
        ("from=-2", "from=-1,-2", "line 22: [shortcut] from: '-1,-2': must be one layer with 8 channels and stride 2"),
        ("filters=8\nsize=1", "filters=9\nsize=1", "[shortcut] from: '-2': must be one layer with 9 channels and"),
        ("size=1\nstride=1\n", "size=1\nstride=2\n", "[shortcut] from: '-2': must be one layer with 8 channels and"),
        ("[upsample]\nstride=2", "[upsample]\nstride=3", "line 30: [upsample] stride: '3': must divide the stride 4"),
        ("layers = -1, 0", "layers = -2, 0", "line 33: [route] layers: '-2, 0': must have one stride, have [4, 2]"),
        ("layers = -1, 0", "layers = -1, x", "line 33: [route] layers: '-1, x': must be whole numbers separated by"),
        ("filters=14", "filters=16", "line 44: [yolo] classes: '2': the layer before must have filters 14, it has 16"),
        ("activation=linear\n\n[yolo]", "activation=leaky\n\n[yolo]", "line 41: [yolo]: must follow a [convolutional]"),
        (
            "activation=linear\n\n[yolo]",
            "activation=logistic\n\n[yolo]",
            "line 41: [yolo]: must follow a [convolutional]",
        ),
        ("mask=0,2", "mask=0,3", "line 42: [yolo] mask: '0,3': must be different numbers from 0 to 2"),
        ("mask=0,2", "mask=0,-1", "line 42: [yolo] mask: '0,-1': must be different numbers from 0 to 2"),
        ("mask=0,2", "mask=0,0", "line 42: [yolo] mask: '0,0': must be different numbers from 0 to 2"),
        ("5.5,6", "5.5", "line 43: [yolo] anchors: '1,2, 3,4, 5.5': must be 6 positive numbers, num=3 widths and"),
        ("5.5,6", "nan,6", "line 43: [yolo] anchors: '1,2, 3,4, nan,6': must be numbers separated by commas"),
        ("5.5,6", "0,6", "line 43: [yolo] anchors: '1,2, 3,4, 0,6': must be 6 positive numbers"),
        ("num=3", "num=3\nscale_x_y=1.05", "line 46: [yolo] scale_x_y: '1.05': must be 1"),
        ("num=3", "num=3\n[maxpool]\nsize=2\nstride=1", "line 46: [maxpool]: only [route] may follow [yolo]"),
        ("num=3", "num=3\n[route]\nlayers=-1", "line 47: [route] layers: '-1': must not name a [yolo] layer"),
        (SMALL[SMALL.index("[yolo]") :], "", "has no [yolo], needs one or more"),
        (SMALL, "", "line 1: the first section must be [net]"),
        (SMALL[SMALL.index("[conv") :], "[route]\nlayers=-1", "[route] layers: '-1': there is no earlier layer"),
        (
            "filters=14",
            "filters=8193",
            "line 36: [convolutional] filters: '8193': must be a whole number from 1 to 8192",
        ),
        ("layers = -1, 0", "layers = " + 1030 * "0,", "[route] layers: '0,0,0"),
        (
            "layers = -1, 0",
            "layers = " + 1029 * "0," + "0",
            "[route]: channels and stride must not be more than 8192, are",
        ),
        ("filters=8\nsize=3", "filters=4096\nsize=63", "weights: must not be more than 268435456"),
    ],
)
def test_refuses(old: str, new: str, message: str) -> None:
    text = SMALL.replace(old, new, 1)
    assert text != SMALL
    if "weights" in message:  # two large layers of equal shape
        text = text.replace("filters=8\nsize=1", "filters=4096\nsize=63\npad=1", 1)
    with pytest.raises(InputError) as error:
        parse_cfg(text, "small.cfg")
    assert str(error.value).startswith("small.cfg: ")
    assert message in str(error.value)
    assert "\n" not in str(error.value)


def test_refuses_heads_of_different_classes() -> None:
    more = "[route]\nlayers=-2\n[convolutional]\nfilters=12\nsize=1\nstride=1\nactivation=linear\n"
    more += "[yolo]\nmask=0,1\nanchors=1,2,3,4\nclasses=1\nnum=2\n"
    more = more.replace("layers=-2", "layers=-3")
    with pytest.raises(InputError, match=r"small.cfg: \[yolo\] classes: must be one number, is \[2, 1\]"):
        parse_cfg(SMALL + more, "small.cfg")


def test_refuses_too_many_sections() -> None:
    with pytest.raises(InputError, match="1001 sections: must not be more than 1000"):
        parse_cfg("[net]\n" + 1000 * "[route]\n", "long.cfg")


def test_reads_a_file_and_names_one_that_is_not_there(tmp_path: Path) -> None:
    path = tmp_path / "small.cfg"
    with pytest.raises(InputError, match=r"small.cfg: cannot be read"):
        read_cfg(path)
    path.write_text(SMALL)
    assert read_cfg(path) == parse_cfg(SMALL, "")


@given(
    st.lists(
        st.tuples(
            st.integers(0, SMALL.count("\n")),
            st.sampled_from(
                [*SMALL.splitlines(), "size=0", "stride=32", "layers=-9", "classes=99999", "=", "[]", "[yolo", "num=-1"]
            )
            | st.text(max_size=20),
            st.booleans(),
        ),
        max_size=6,
    )
)
def test_any_text_is_a_network_or_an_input_error(edits: list[tuple[int, str, bool]]) -> None:
    lines = SMALL.splitlines()
    for place, line, replace in edits:
        lines[place : place + replace] = [line]
    with contextlib.suppress(InputError):
        cfg = parse_cfg("\n".join(lines), "edited.cfg")
        assert isinstance(cfg, DarknetCfg)
        assert cfg.heads
