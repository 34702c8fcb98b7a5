"""Darknet's .cfg, the text that describes a YOLOv3 or YOLOv4-tiny network, read into consistent layers.

A section [net] comes first, then one section for each layer, numbered from 0. [route] and [shortcut] name earlier
layers by number, or by a negative number counted back from their own. Keys have Darknet's defaults (parser.c of
AlexeyAB's Darknet, which reads everything that Redmon's reads). Keys for training only, and keys that Darknet does not
know, are ignored, as in Darknet. A key that would change the network's output in a way not computed here is refused.
"""

from difflib import get_close_matches
from pathlib import Path

from ortilo_drake.model.input_files import TEXT_LIMIT, read_bytes
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.onboard.detector.darknet_layers import (
    ACTIVATIONS,
    Convolutional,
    DarknetCfg,
    Dropout,
    Layer,
    Maxpool,
    Net,
    Route,
    Shape,
    Shortcut,
    Upsample,
    Yolo,
)
from ortilo_drake.onboard.detector.darknet_sections import Section, read_sections

MAX_SIZE = 8192  # largest side of an input image and of a layer [px], and largest number of channels
MAX_VALUES = 2**28  # largest number of values of a layer, and of weights: 1 GiB of float32, four times YOLOv3's weights

_STRIDES = {"stride", "stride_x", "stride_y"}
# The keys that we read in each kind of section; all others are for training or unknown.
_KEYS = {
    "net": {"width", "height", "channels"},
    "convolutional": {"batch_normalize", "filters", "size", "pad", "padding", "groups", "activation", *_STRIDES},
    "shortcut": {"from", "activation"},
    "route": {"layers", "groups", "group_id"},
    "upsample": {"stride"},
    "maxpool": {"size", "padding", *_STRIDES},
    "dropout": set(),
    "empty": set(),
    "yolo": {"mask", "anchors", "classes", "num", "scale_x_y", "nms_kind"},
}
# Keys that change the network's output, with the one value that does not.
_DEFORMED = dict.fromkeys(("sway", "rotate", "stretch", "stretch_sway"), 0)
_NEUTRAL: dict[str, dict[str, float]] = {
    "net": {"letter_box": 0},
    "convolutional": {
        **{"antialiasing": 0, "binary": 0, "coordconv": 0, "dilation": 1, "dontload": 0, "dontloadscales": 0},
        **{"flipped": 0, "xnor": 0, **_DEFORMED},
    },
    "maxpool": {"antialiasing": 0, "maxpool_depth": 0, "maxpool_zero_nonmax": 0},
    "upsample": {"scale": 1},
    "yolo": {"new_coords": 0},
}


def _check_keys(section: Section) -> None:
    """Refuse keys that change the network's output in a way not computed here, and misspelt keys."""
    neutral = _NEUTRAL.get(section.kind, {})
    for key, value in neutral.items():
        if section.number(key, value) != value:
            raise section.error(key, f"must be {value}")
    if section.text("share_index") is not None:
        raise section.error("share_index", "weights shared by two layers are not computed here")
    missing = (_KEYS[section.kind] | set(neutral)) - set(section.values)
    for key in set(section.values) - _KEYS[section.kind] - set(neutral):
        for meant in get_close_matches(key, missing, n=1, cutoff=0.8):
            raise section.error(key, f"Darknet does not read it, perhaps it means {meant}")


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


def _stride(section: Section) -> int:
    """Return the stride, which must be the same in x and y."""
    stride = section.whole("stride", 1, 32, 1)
    for key in ("stride_x", "stride_y"):
        if section.whole(key, 1, 32, stride) != stride:
            raise section.error(key, f"must be the stride {stride}")
    return stride


def _strided(section: Section, size: int, padded: int) -> int:
    """Return the number of windows of this size that fit into `padded` padded cells."""
    if size > padded:
        raise section.error("size", f"must not be more than the {padded} padded rows or columns before it")
    return (padded - size) // _stride(section) + 1


def _convolutional(section: Section, layers: list[Layer], shapes: list[Shape]) -> tuple[Layer, Shape]:
    before = shapes[-1]
    size, filters = section.whole("size", 1, 63, 1), section.whole("filters", 1, MAX_SIZE, 1)
    padding = section.whole("padding", 0, 63, 0)
    if section.number("pad", 0):
        padding = size // 2
    groups = section.whole("groups", 1, MAX_SIZE, 1)
    if before.channels % groups or filters % groups:
        raise section.error("groups", f"must divide the {before.channels} channels before it and the {filters} filters")
    normalize = section.whole("batch_normalize", 0, 2, 0) != 0  # 2: normalised over several training steps
    activation = section.choice("activation", ACTIVATIONS, "logistic")
    height, width = (_strided(section, size, cells + 2 * padding) for cells in before[1:])
    stride = _stride(section)
    layer = Convolutional(before.channels, filters, size, stride, padding, normalize, activation, groups)
    return layer, Shape(filters, height, width)


def _maxpool(section: Section, layers: list[Layer], shapes: list[Shape]) -> tuple[Layer, Shape]:
    before, stride = shapes[-1], _stride(section)
    size = section.whole("size", 1, 63, stride)
    padding = section.whole("padding", 0, 126, size - 1)
    height, width = (_strided(section, size, cells + padding) for cells in before[1:])
    return Maxpool(size, stride, padding), Shape(before.channels, height, width)


def _upsample(section: Section, layers: list[Layer], shapes: list[Shape]) -> tuple[Layer, Shape]:
    before, stride = shapes[-1], section.whole("stride", 1, 32, 2)
    return Upsample(stride), Shape(before.channels, before.height * stride, before.width * stride)


def _shortcut(section: Section, layers: list[Layer], shapes: list[Shape]) -> tuple[Layer, Shape]:
    named, before = _earlier(section, "from", layers), shapes[-1]
    section.choice("weights_type", ("none",), "none")
    if len(named) != 1 or shapes[named[0] + 1] != before:
        raise section.error("from", f"must be one layer of {before.channels} x {before.height} x {before.width}")
    return Shortcut(named[0], section.choice("activation", ACTIVATIONS, "linear")), before


def _route(section: Section, layers: list[Layer], shapes: list[Shape]) -> tuple[Layer, Shape]:
    named = _earlier(section, "layers", layers)
    found = [shapes[n + 1] for n in named]
    sizes = list(dict.fromkeys(f"{s.height} x {s.width}" for s in found))
    if len(sizes) != 1:
        raise section.error("layers", f"must have one height and width, have {', '.join(sizes)[:60]}")
    groups = section.whole("groups", 1, MAX_SIZE, 1)
    group = section.whole("group_id", 0, groups - 1, 0)
    if any(s.channels % groups for s in found):
        raise section.error("groups", f"must divide the channels, {', '.join(str(s.channels) for s in found)[:60]}")
    channels = sum(s.channels for s in found) // groups
    return Route(tuple(named), groups, group), Shape(channels, found[0].height, found[0].width)


def _yolo(section: Section, layers: list[Layer], shapes: list[Shape]) -> tuple[Layer, Shape]:
    """Return a [yolo] head, checked against the layer before it."""
    before = shapes[-1]
    num, classes = section.whole("num", 1, 100, 1), section.whole("classes", 1, 10_000, 20)
    flat = section.numbers("anchors", whole=False, comment=True, most=2 * num)
    mask = list(range(num)) if section.text("mask") is None else section.numbers("mask", whole=True, comment=True)
    if len(flat) != 2 * num or not all(0.0 < value < 1e6 for value in flat):
        raise section.error("anchors", f"must be {2 * num} positive numbers, num={num} widths and heights")
    if len(set(mask)) != len(mask) or not all(0 <= n < num for n in mask):
        raise section.error("mask", f"must be different numbers from 0 to {num - 1}")
    if before.channels != (5 + classes) * len(mask):
        raise section.error(
            "classes", f"the layer before must have filters {(5 + classes) * len(mask)}, it has {before.channels}"
        )
    if section.text("nms_kind") == "diounms":
        raise section.error("nms_kind", "must be default or greedynms")
    scale_x_y = section.number("scale_x_y", 1.0)
    if not 0.1 <= scale_x_y <= 10.0:
        raise section.error("scale_x_y", "must be from 0.1 to 10")
    anchors = tuple((flat[2 * int(n)], flat[2 * int(n) + 1]) for n in mask)
    return Yolo(anchors, classes, scale_x_y), before


_LAYERS = {
    **{"convolutional": _convolutional, "maxpool": _maxpool, "upsample": _upsample},
    **{"shortcut": _shortcut, "route": _route, "yolo": _yolo},
}


def _layer(section: Section, layers: list[Layer], shapes: list[Shape]) -> tuple[Layer, Shape]:
    """Return the next layer and its shape; `shapes` starts with the input, so shapes[-1] is of the layer before."""
    if section.kind not in _KEYS or section.kind == "net":
        known = ", ".join(f"[{name}]" for name in _KEYS if name != "net")
        raise section.fault(f"not computed here, known are {known}")
    if layers and isinstance(layers[-1], Yolo) and section.kind != "route":
        raise section.fault("only [route] may follow [yolo]")
    _check_keys(section)
    read = _LAYERS.get(section.kind)
    return (Dropout(), shapes[-1]) if read is None else read(section, layers, shapes)


def parse_cfg(text: str, source: str) -> DarknetCfg:
    """Return the network that a .cfg's text describes; `source` is the text's name in errors.

    InputError naming source, line, section, key, value and the allowed values.
    """
    first, *rest = read_sections(text, source)
    _check_keys(first)
    net = Net(first.whole("width", 1, MAX_SIZE), first.whole("height", 1, MAX_SIZE))
    layers: list[Layer] = []
    shapes = [Shape(first.whole("channels", 3, 3), net.height, net.width)]
    for section in rest:
        layer, shape = _layer(section, layers, shapes)
        layers.append(layer)
        shapes.append(shape)
        if max(shape) > MAX_SIZE or shape.channels * shape.height * shape.width > MAX_VALUES:
            size = " x ".join(map(str, shape))
            raise section.fault(f"gives {size} values: each must not be more than {MAX_SIZE}, all {MAX_VALUES}")
    cfg = DarknetCfg(text, net, tuple(layers), tuple(shapes[1:]))
    if not cfg.heads:
        raise InputError(f"{source}: has no [yolo], needs one or more")
    if len({head.classes for head in cfg.heads}) != 1:
        raise InputError(f"{source}: [yolo] classes: must be one number, is {[head.classes for head in cfg.heads]}")
    if cfg.weight_count > MAX_VALUES:
        raise InputError(f"{source}: needs {cfg.weight_count} weights: must not be more than {MAX_VALUES}")
    return cfg


def read_cfg(path: Path) -> DarknetCfg:
    """Return the network of a .cfg file, whose comments may have any encoding; InputError as in parse_cfg."""
    return parse_cfg(read_bytes(path, TEXT_LIMIT).decode("utf-8", errors="replace"), str(path))
