"""Darknet's .cfg: four published architectures, what Darknet reads in users' files, and what is refused."""

import contextlib
from pathlib import Path

import pytest
from darknet_architectures import architecture
from hypothesis import given
from hypothesis import strategies as st

from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.onboard.detector.darknet_cfg import parse_cfg, read_cfg
from ortilo_drake.onboard.detector.darknet_layers import (
    Convolutional,
    DarknetCfg,
    Dropout,
    Maxpool,
    Route,
    Shape,
    Shortcut,
    Yolo,
)

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


def head_shapes(cfg: DarknetCfg) -> list[Shape]:
    return [shape for layer, shape in zip(cfg.layers, cfg.shapes, strict=True) if isinstance(layer, Yolo)]


@pytest.mark.parametrize(
    ("name", "layers", "convolutions", "file_size"),
    [  # layers and sizes of the .weights files as published
        ("yolov3", 107, 75, 248_007_048),
        ("yolov3-spp", 114, 76, 252_209_544),
        ("yolov3-tiny", 24, 13, 35_434_956),
        ("yolov4-tiny", 38, 21, 24_251_276),
    ],
)
def test_published_architectures(name: str, layers: int, convolutions: int, file_size: int) -> None:
    cfg = parse_cfg(architecture(name).text, name)
    assert len(cfg.layers) == layers
    assert sum(isinstance(layer, Convolutional) for layer in cfg.layers) == convolutions
    assert 4 * cfg.weight_count + 20 == file_size
    strides = [cfg.net.width / shape.width for shape in head_shapes(cfg)]
    assert strides == [cfg.net.height / shape.height for shape in head_shapes(cfg)]
    assert strides == ([32, 16] if "tiny" in name else [32, 16, 8])
    assert cfg.heads[0].anchors[-1] == ((344.0, 319.0) if "tiny" in name else (373.0, 326.0))


def test_numbers_and_values_of_a_small_network() -> None:
    cfg = parse_cfg("\ufeff" + SMALL.replace("\n", "\r\n"), "small.cfg")
    assert (cfg.net.width, cfg.net.height, head_shapes(cfg)) == (64, 32, [(14, 16, 32)])
    assert cfg.layers[0] == Convolutional(3, 8, 3, 2, 1, True, "leaky")
    assert cfg.layers[1] == Convolutional(8, 8, 1, 1, 0, False, "logistic")
    assert cfg.layers[2:4] == (Shortcut(0, "linear"), Maxpool(2, 2, 1))
    assert cfg.layers[5:7] == (Route((4, 0)), Convolutional(16, 14, 1, 1, 0, False, "linear"))
    assert cfg.heads[0].anchors == ((1.0, 2.0), (5.5, 6.0))
    assert cfg.weight_count == (8 * 27 + 32) + (64 + 8) + (16 * 14 + 14)


@pytest.mark.parametrize(
    ("old", "new"),
    [  # what Darknet's read_cfg, read_option, atoi and atof make of it is the same network
        ("filters=14", "filters=14 #255"),
        ("filters=14", "filters = 1 4 ; as (5 + 2) 2"),
        ("width=64", "width\t=\t64 # 608"),
        ("classes=2", "classes=2 # 80"),
        ("mask=0,2", "mask = 0,2 # 3,4"),
        ("5.5,6", "5.5,6, 7,8  # of k-means"),
        ("5.5,6", "5.5,6,"),
        ("5.5,6", "55e-1,+6."),
        ("[net]", "[network]"),
        ("[net]", "[ net ]"),
        ("[convolutional]", "[conv]"),
        ("[maxpool]", "[max]"),
        ("width=64", "width=64\nwidth=32"),  # the first counts
        ("width=64", "width=64\nsubdivisions\nbatch="),
        ("width=64", "width=64\nmosaic=1\nsteps=400000,450000\nscales=.1,.1\nunheard_of=7"),
        ("pad=1", "padding=1"),
        ("pad=1", "pad=2\npadding=5"),
        ("size=3", "size=3\nlearning_rate=0.0\nstopbackward=1\ndont_update=1\nstream=0\ngroups=1\nstride_x=2"),
        ("size=3", "size=3\nbatch_normalize=0"),
        ("batch_normalize=1", "batch_normalize=2"),
        ("activation=linear\n\n[maxpool]", "\n[maxpool]"),  # of a [shortcut], by default
        ("[maxpool]\nsize=2", "[maxpool]\npadding=1"),  # size is the stride by default
        ("[upsample]\nstride=2", "[upsample]"),
        ("layers = -1, 0", "layers = -1, 0 #"),
        ("num=3", "num=3\nscale_x_y=1.0\nnms_kind=greedynms\nbeta_nms=0.6\niou_loss=ciou\nmax_delta=5\nresize=1.5"),
        ("num=3", "num=3\nnew_coords=0\nmax=200\ncounters_per_class=100,10\nfocal_loss"),
        ("# a comment", "; \ufffd\n  # another\n\t"),
    ],
)
def test_reads_what_darknet_reads(old: str, new: str) -> None:
    text = SMALL.replace(old, new, 1)
    assert text != SMALL
    read, plain = parse_cfg(text, "users.cfg"), parse_cfg(SMALL, "small.cfg")
    assert (read.net, read.layers, read.shapes) == (plain.net, plain.layers, plain.shapes)


def test_defaults_are_darknets() -> None:
    text = "[net]\nwidth=8\nheight=6\nchannels=3\n[conv]\n[conv]\nfilters=75\n[yolo]\nnum=3\nanchors=1,1,2,2,3,3"
    cfg = parse_cfg(text, "short.cfg")
    assert cfg.layers[0] == Convolutional(3, 1, 1, 1, 0, False, "logistic")
    assert cfg.layers[2] == Yolo(((1.0, 1.0), (2.0, 2.0), (3.0, 3.0)), 20, 1.0)


def test_values_of_a_later_network() -> None:
    """Cells by the rule of Darknet's layers: (n + padding - size) // stride + 1 of n."""
    cfg = parse_cfg(architecture("later").text.replace("[dropout]", "[ silence ]"), "later.cfg")
    assert cfg.layers[0] == Convolutional(3, 8, 3, 1, 1, True, "mish")
    assert cfg.layers[1:4] == (Maxpool(2, 2, 1), Convolutional(8, 16, 3, 2, 1, True, "swish"), Dropout())
    assert cfg.layers[4] == Convolutional(16, 16, 3, 1, 1, True, "relu", 4)
    assert cfg.shapes[:4] == ((8, 74, 102), (8, 37, 51), (16, 19, 26), (16, 19, 26))
    assert cfg.heads == (Yolo(((10.0, 14.0), (37.0, 58.0), (81.0, 82.0)), 80, 1.2),)


@given(size=st.integers(1, 6), stride=st.integers(1, 4), padding=st.integers(0, 3), width=st.integers(6, 40))
def test_a_layer_has_as_many_cells_as_windows_fit(size: int, stride: int, padding: int, width: int) -> None:
    for section, both in (("conv", 2 * padding), ("max", padding)):
        text = f"[net]\nwidth={width}\nheight=9\nchannels=3\n[{section}]\nfilters=3\n"
        text += f"size={size}\nstride={stride}\npadding={padding}\n[conv]\nfilters=6\n[yolo]\nanchors=1,1\nclasses=1\n"
        windows = [start for start in range(0, width + both, stride) if start + size <= width + both]
        assert parse_cfg(text, "cells.cfg").shapes[0].width == len(windows)


def test_comments_may_be_in_any_encoding(tmp_path: Path) -> None:
    path = tmp_path / "gbk.cfg"
    path.write_bytes(SMALL.replace("a comment", "\u7f51\u7edc").replace("=14", "=14 #\u7c7b").encode("gbk"))
    assert read_cfg(path).layers == parse_cfg(SMALL, "").layers


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("[net]", "[nets]", "line 2: the first section must be [net] or [network]"),
        ("# a comment", "width=3", "line 1: 'width=3': must come after [net]"),
        ("# a comment", "hello", "line 1: 'hello': must come after [net]"),
        ("[maxpool]", "[maxpool] # 2", "line 25: '[maxpool]#2': must be [name] with nothing behind it"),
        ("width=64", "", "line 2: [net] width: is missing"),
        ("width=64", "width", "line 3: [net] width: is missing"),
        (
            "width=64",
            "width=66",
            "line 33: [route] layers: '-1,0': must have one height and width, have 16 x 34, 16 x 33",
        ),
        ("width=64", "width=8193", "line 3: [net] width: '8193': must be a whole number from 1 to 8192"),
        ("width=64", "width=٦٤", "line 3: [net] width: '٦٤': must be a whole number from 1 to 8192"),
        ("channels=3", "channels=1", "line 5: [net] channels: '1': must be 3"),
        ("channels=3", "channels=3\nletter_box=1", "line 6: [net] letter_box: '1': must be 0"),
        ("[maxpool]", "[avgpool]", "line 25: [avgpool]: not computed here, known are [convolutional], [shortcut], "),
        ("size=3", "sizes=3", "line 10: [convolutional] sizes: '3': Darknet does not read it, perhaps it means size"),
        (
            "layers = -1, 0",
            "layer = -1, 0",
            "line 33: [route] layer: '-1,0': Darknet does not read it, perhaps it means",
        ),
        (
            "size=3",
            "size=3\ngroups=2",
            "line 11: [convolutional] groups: '2': must divide the 3 channels before it and",
        ),
        ("size=3", "size=3\ndilation=2", "line 11: [convolutional] dilation: '2': must be 1"),
        ("size=3", "size=3\nxnor=1", "line 11: [convolutional] xnor: '1': must be 0"),
        (
            "size=3",
            "size=3\nshare_index=-1",
            "line 11: [convolutional] share_index: '-1': weights shared by two layers",
        ),
        ("size=3", "size=3\nstride_y=1", "line 11: [convolutional] stride_y: '1': must be the stride 2"),
        (
            "size=3\nstride=2\npad=1",
            "size=63",
            "line 10: [convolutional] size: '63': must not be more than the 32 padded",
        ),
        (
            "=leaky",
            "=leek",
            "line 13: [convolutional] activation: 'leek': must be one of linear, leaky, logistic, mish",
        ),
        ("=leaky", "=leaky # mish", "activation: 'leaky#mish': must be one of linear, leaky"),
        ("=leaky", "=leaky # mish", "; Darknet reads a comment after a word as part of it"),
        ("[maxpool]", "[maxpool]\nmaxpool_depth=1", "line 26: [maxpool] maxpool_depth: '1': must be 0"),
        ("from=-2", "from=-2\nweights_type=per_feature", "[shortcut] weights_type: 'per_feature': must be one of none"),
        (
            "from=-2",
            "from=-3",
            "line 22: [shortcut] from: '-3': must be from 0 to 1, or from -2 to -1, here",
        ),
        ("from=-2", "from=2", "line 22: [shortcut] from: '2': must be from 0 to 1, or from -2 to -1, here"),
        ("from=-2", "from=-1,-2", "line 22: [shortcut] from: '-1,-2': must be one layer of 8 x 16 x 32"),
        ("filters=8\nsize=1", "filters=9\nsize=1", "[shortcut] from: '-2': must be one layer of 9 x 16 x 32"),
        ("size=1\nstride=1\n", "size=1\nstride=2\n", "[shortcut] from: '-2': must be one layer of 8 x 8 x 16"),
        (
            "[upsample]\nstride=2",
            "[upsample]\nstride=-2",
            "line 30: [upsample] stride: '-2': must be a whole number from 1",
        ),
        ("[upsample]\nstride=2", "[upsample]\nscale=2", "line 30: [upsample] scale: '2': must be 1"),
        (
            "layers = -1, 0",
            "layers = -2, 0",
            "line 33: [route] layers: '-2,0': must have one height and width, have 8 x 16",
        ),
        ("layers = -1, 0", "layers = -1, x", "line 33: [route] layers: '-1,x': must be whole numbers separated by"),
        (
            "layers = -1, 0",
            "layers = -1, 0 # a, b",
            "line 33: [route] layers: '-1,0#a,b': must be whole numbers separated",
        ),
        ("layers = -1, 0", "layers\ngroups=2", "line 33: [route] layers: is missing"),
        (
            "layers = -1, 0",
            "layers=0\ngroups=3\ngroup_id=1",
            "line 34: [route] groups: '3': must divide the channels, 8",
        ),
        (
            "layers = -1, 0",
            "layers=0\ngroups=2\ngroup_id=2",
            "line 35: [route] group_id: '2': must be a whole number from 0",
        ),
        ("filters=14", "filters=16", "line 44: [yolo] classes: '2': the layer before must have filters 14, it has 16"),
        ("mask=0,2", "mask=0,3", "line 42: [yolo] mask: '0,3': must be different numbers from 0 to 2"),
        ("mask=0,2", "mask=0,-1", "line 42: [yolo] mask: '0,-1': must be different numbers from 0 to 2"),
        ("mask=0,2", "mask=0,0", "line 42: [yolo] mask: '0,0': must be different numbers from 0 to 2"),
        ("5.5,6", "5.5", "line 43: [yolo] anchors: '1,2,3,4,5.5': must be 6 positive numbers, num=3 widths and"),
        ("5.5,6", "nan,6", "line 43: [yolo] anchors: '1,2,3,4,nan,6': must be numbers separated by commas"),
        ("5.5,6", "0,6", "line 43: [yolo] anchors: '1,2,3,4,0,6': must be 6 positive numbers"),
        ("num=3", "num=3\nscale_x_y=0", "line 46: [yolo] scale_x_y: '0': must be from 0.1 to 10"),
        ("num=3", "num=3\nnew_coords=1", "line 46: [yolo] new_coords: '1': must be 0"),
        ("num=3", "num=3\nnms_kind=diounms", "line 46: [yolo] nms_kind: 'diounms': must be default or greedynms"),
        ("anchors=1,2, 3,4, 5.5,6", "", "line 41: [yolo] anchors: is missing"),
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
            "[route]: gives 8240 x 16 x 32 values: each must not be more than 8192, all",
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
