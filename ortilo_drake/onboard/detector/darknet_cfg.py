"""Darknet's .cfg, the text that describes a YOLOv3 network, read into layers that fit together.

A section [net] comes first, then one section a layer, numbered from 0; [route] and [shortcut] name earlier layers by
number, or by a negative number counted back from their own. Keys that only training knows are passed over in [net]
and [yolo]; a key that would change what the network computes, and that we do not compute, is refused.
"""

import math
from pathlib import Path

from ortilo_drake.model.input_files import read_text
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.onboard.detector.darknet_layers import (
    ACTIVATIONS,
    Convolutional,
    DarknetCfg,
    Layer,
    Maxpool,
    Net,
    Route,
    Shortcut,
    Upsample,
    Yolo,
)
from ortilo_drake.onboard.detector.darknet_sections import Section, read_sections

MAX_SIZE = 8192  # of an input image [px], and of a layer's channels
MAX_WEIGHTS = 2**28  # 1 GiB of float32, four times YOLOv3

_KEYS = {
    "convolutional": {"batch_normalize", "filters", "size", "stride", "pad", "activation"},
    "shortcut": {"from", "activation"},
    "route": {"layers"},
    "upsample": {"stride"},
    "maxpool": {"size", "stride"},
}
# Keys of Darknet's later networks, with the one value that leaves a YOLOv3 network as it is.
_NEUTRAL = {
    "antialiasing": 0,
    "dilation": 1,
    "flipped": 0,
    "groups": 1,
    "letter_box": 0,
    "new_coords": 0,
    "scale_x_y": 1,
}

Shape = tuple[int, int]  # channels of a layer's output and input pixels to one of its cells


def _check_keys(section: Section) -> None:
    """Refuse keys that would change the network in a way we do not know."""
    known = _KEYS.get(section.name)
    for key in section.values:
        if key in _NEUTRAL:
            if section.numbers(key, whole=False) != [_NEUTRAL[key]]:
                raise section.error(key, f"must be {_NEUTRAL[key]}")
        elif known is not None and key not in known:
            raise section.error(key, f"unknown key, known are {', '.join(sorted(known))}")


def _earlier(section: Section, key: str, layers: list[Layer]) -> list[int]:
    """Return the numbers of the earlier layers that a key names."""
    here = len(layers)
    named = [int(n) + (here if n < 0 else 0) for n in section.numbers(key, whole=True)]
    if here == 0:
        raise section.error(key, "there is no earlier layer")
    if not all(0 <= n < here for n in named):
        raise section.error(key, f"must be from 0 to {here - 1}, or from -{here} to -1, here in layer {here}")
    if any(isinstance(layers[n], Yolo) for n in named):
        raise section.error(key, "must not name a [yolo] layer")
    return named


def _yolo(section: Section, before: Layer | None, channels: int) -> Yolo:
    """Return a head, checked against the layer before it."""
    num, classes = section.whole("num", 1, 100), section.whole("classes", 1, 10_000)
    flat, mask = section.numbers("anchors", whole=False), section.numbers("mask", whole=True)
    if len(flat) != 2 * num or min(flat) <= 0:
        raise section.error("anchors", f"must be {2 * num} positive numbers, num={num} widths and heights")
    if len(set(mask)) != len(mask) or not all(0 <= n < num for n in mask):
        raise section.error("mask", f"must be different numbers from 0 to {num - 1}")
    if not isinstance(before, Convolutional) or before.activation != "linear":
        raise section.fault("must follow a [convolutional] with activation linear")
    if channels != (5 + classes) * len(mask):
        raise section.error(
            "classes", f"the layer before must have filters {(5 + classes) * len(mask)}, it has {channels}"
        )
    return Yolo(tuple((flat[2 * int(n)], flat[2 * int(n) + 1]) for n in mask), classes)


def _layer(section: Section, layers: list[Layer], shapes: list[Shape]) -> tuple[Layer, Shape]:
    """Return the next layer and its shape; shapes starts with the input's, so shapes[-1] is of the layer before."""
    _check_keys(section)
    (channels, stride), before = shapes[-1], layers[-1] if layers else None
    if isinstance(before, Yolo) and section.name != "route":
        raise section.fault("only [route] may follow [yolo]")
    match section.name:
        case "convolutional":
            size, filters = section.whole("size", 1, 63), section.whole("filters", 1, MAX_SIZE)
            if size % 2 == 0:
                raise section.error("size", "must be odd")
            if size > 1 and section.whole("pad", 0, 1) != 1:
                raise section.error("pad", "must be 1 where size is not 1")
            normalize = "batch_normalize" in section.values and section.whole("batch_normalize", 0, 1) == 1
            step, activation = section.whole("stride", 1, 32), section.choice("activation", ACTIVATIONS)
            return Convolutional(channels, filters, size, step, normalize, activation), (filters, stride * step)
        case "maxpool":
            step = section.whole("stride", 1, 32)
            return Maxpool(section.whole("size", 1, 63), step), (channels, stride * step)
        case "upsample":
            step = section.whole("stride", 1, 32)
            if stride % step:
                raise section.error("stride", f"must divide the stride {stride} of the layer before")
            return Upsample(step), (channels, stride // step)
        case "shortcut":
            named = _earlier(section, "from", layers)
            if len(named) != 1 or shapes[named[0] + 1] != shapes[-1]:
                raise section.error("from", f"must be one layer with {channels} channels and stride {stride}")
            return Shortcut(named[0], section.choice("activation", ACTIVATIONS)), shapes[-1]
        case "route":
            named = _earlier(section, "layers", layers)
            if len({shapes[n + 1][1] for n in named}) != 1:
                raise section.error("layers", f"must have one stride, have {[shapes[n + 1][1] for n in named]}")
            return Route(tuple(named)), (sum(shapes[n + 1][0] for n in named), shapes[named[0] + 1][1])
        case "yolo":
            return _yolo(section, before, channels), shapes[-1]
    known = ", ".join(f"[{name}]" for name in [*_KEYS, "yolo"])
    raise section.fault(f"unknown layer, known are {known}")


def parse_cfg(text: str, source: str) -> DarknetCfg:
    """Return the network that a .cfg's text describes.

    Args:
        text: the .cfg.
        source: what to call it in an error.

    Raises:
        InputError: naming source, line, section, key, value and what is allowed.
    """
    first, *rest = read_sections(text, source)
    _check_keys(first)
    net = Net(first.whole("width", 1, MAX_SIZE), first.whole("height", 1, MAX_SIZE))
    layers: list[Layer] = []
    shapes: list[Shape] = [(first.whole("channels", 3, 3), 1)]
    for section in rest:
        layer, shape = _layer(section, layers, shapes)
        layers.append(layer)
        shapes.append(shape)
        if shape[1] > MAX_SIZE or shape[0] > MAX_SIZE:
            raise section.fault(f"channels and stride must not be more than {MAX_SIZE}, are {shape[0]} and {shape[1]}")
    heads = tuple(layer for layer in layers if isinstance(layer, Yolo))
    if not heads:
        raise InputError(f"{source}: has no [yolo], needs one or more")
    if len({head.classes for head in heads}) != 1:
        raise InputError(f"{source}: [yolo] classes: must be one number, is {[head.classes for head in heads]}")
    strides = tuple(shape[1] for layer, shape in zip(layers, shapes[1:], strict=True) if isinstance(layer, Yolo))
    stride = math.lcm(*(shape[1] for shape in shapes))
    for key, value in (("width", net.width), ("height", net.height)):
        if value % stride:
            raise first.error(key, f"must be a multiple of the network's stride {stride}")
    cfg = DarknetCfg(text, net, tuple(layers), stride, strides, heads)
    if cfg.weight_count > MAX_WEIGHTS:
        raise InputError(f"{source}: needs {cfg.weight_count} weights: must not be more than {MAX_WEIGHTS}")
    return cfg


def read_cfg(path: Path) -> DarknetCfg:
    """Read a .cfg file; InputError if anything is wrong, see parse_cfg."""
    return parse_cfg(read_text(path), str(path))
