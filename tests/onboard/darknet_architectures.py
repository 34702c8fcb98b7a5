"""The three networks of the YOLOv3 paper's authors and two later ones as .cfg text, and seeded weights for them.

YOLOv4-tiny is as published; "later" is small and has what else later networks have: mish and swish, grouped kernels,
[dropout], padding by number, and a picture whose size no stride divides.

Needs only NumPy: scripts/make_darknet_references.py runs it beside an OpenCV that has a Darknet importer. Channels are
counted here, apart from the package's own reader.
"""

import zlib
from pathlib import Path
from typing import NamedTuple

import numpy as np

CLASSES, SCALES = 80, 3
ANCHORS = {
    "yolov3": "10,13, 16,30, 33,23, 30,61, 62,45, 59,119, 116,90, 156,198, 373,326",
    "yolov3-spp": "10,13, 16,30, 33,23, 30,61, 62,45, 59,119, 116,90, 156,198, 373,326",
    "yolov3-tiny": "10,14, 23,27, 37,58, 81,82, 135,169, 344,319",
    "yolov4-tiny": "10,14, 23,27, 37,58, 81,82, 135,169, 344,319",
    "later": "10,14, 23,27, 37,58, 81,82",
}
# Width and height: true filters on small images; spp's widest pool of 13 cells needs a larger one to matter.
SIZES = {
    "yolov3": (128, 96),
    "yolov3-spp": (320, 256),
    "yolov3-tiny": (160, 128),
    "yolov4-tiny": (160, 128),
    "later": (102, 74),
}
# Variance that a head's convolution gives an input of variance 1, for logits of about 1 to 2.
HEAD_GAINS = {"yolov3": 0.3, "yolov3-spp": 0.06, "yolov3-tiny": 2.0, "yolov4-tiny": 2.0, "later": 4.0}


class Kernel(NamedTuple):
    inputs: int
    filters: int
    size: int
    normalize: bool
    gain: float  # variance that the layer gives an input of variance 1


class Architecture:
    """A .cfg as it grows: its text, the channels of each layer's output and the kernels so far."""

    def __init__(self, name: str) -> None:
        width, height = SIZES[name]
        self.text = f"[net]\n# Testing\nbatch=1\nwidth={width}\nheight={height}\nchannels=3\nsaturation = 1.5\n"
        self.anchors, self.head_gain = ANCHORS[name], HEAD_GAINS[name]
        self.channels = [3]  # of the input, then of each layer
        self.kernels: list[Kernel] = []

    def add(self, section: str, channels: int, **values: object) -> None:
        self.text += f"\n[{section}]\n" + "".join(f"{key}={value}\n" for key, value in values.items())
        self.channels.append(channels)

    def convolution(self, filters: int, size: int, stride: int = 1, gain: float = 1.7, **more: object) -> None:
        groups = int(str(more.get("groups", 1)))
        self.kernels.append(Kernel(self.channels[-1] // groups, filters, size, True, gain))
        values = {"filters": filters, "size": size, "stride": stride, "pad": 1, "activation": "leaky"} | more
        self.add("convolutional", filters, batch_normalize=1, **values)

    def pool(self, size: int, stride: int) -> None:
        self.add("maxpool", self.channels[-1], size=size, stride=stride)

    def route(self, *layers: int) -> None:
        channels = (self.channels[n + 1] if n >= 0 else self.channels[n] for n in layers)
        self.add("route", sum(channels), layers=", ".join(map(str, layers)))

    def second_half(self) -> None:
        self.add("route", self.channels[-1] // 2, layers=-1, groups=2, group_id=1)

    def residuals(self, filters: int, blocks: int) -> None:
        self.convolution(filters, 3, stride=2)
        for _ in range(blocks):
            self.convolution(filters // 2, 1)
            self.convolution(filters, 3, gain=0.1)
            self.add("shortcut", filters, **{"from": -3, "activation": "linear"})

    def head(self, mask: str, **more: object) -> None:
        filters = SCALES * (5 + CLASSES)
        self.kernels.append(Kernel(self.channels[-1], filters, 1, False, self.head_gain))
        self.add("convolutional", filters, size=1, stride=1, pad=1, filters=filters, activation="linear")
        num = self.anchors.count(",") // 2 + 1
        self.add(
            "yolo", filters, mask=mask, anchors=self.anchors, classes=CLASSES, num=num, jitter=0.3, random=1, **more
        )

    def up_to(self, layer: int, filters: int) -> None:
        self.route(-4)
        self.convolution(filters, 1)
        self.add("upsample", filters, stride=2)
        self.route(-1, layer)


def darknet_53(name: str) -> Architecture:
    net = Architecture(name)
    net.convolution(32, 3)
    for filters, blocks in ((64, 1), (128, 2), (256, 8), (512, 8), (1024, 4)):
        net.residuals(filters, blocks)
    for i, (filters, mask) in enumerate(((512, "6,7,8"), (256, "3,4,5"), (128, "0,1,2"))):
        if i > 0:
            net.up_to((0, 61, 36)[i], filters)
        for pair in range(3):
            net.convolution(filters, 1)
            if name == "yolov3-spp" and i == 0 and pair == 1:
                net.pool(5, 1)
                net.route(-2)
                net.pool(9, 1)
                net.route(-4)
                net.pool(13, 1)
                net.route(-1, -3, -5, -6)
                net.convolution(filters, 1)
            net.convolution(2 * filters, 3)
        net.head(mask)
    return net


def tiny() -> Architecture:
    net = Architecture("yolov3-tiny")
    for filters in (16, 32, 64, 128, 256, 512):
        net.convolution(filters, 3)
        net.pool(2, 1 if filters == 512 else 2)
    net.convolution(1024, 3)
    net.convolution(256, 1)
    net.convolution(512, 3)
    net.head("3,4,5")
    net.up_to(8, 128)
    net.convolution(256, 3)
    net.head("0,1,2")
    return net


def tiny_4() -> Architecture:
    """Cross-stage partial blocks: one half of the channels goes through two kernels, and joins the whole again."""
    net = Architecture("yolov4-tiny")
    net.convolution(32, 3, stride=2)
    net.convolution(64, 3, stride=2)
    for filters in (64, 128, 256):
        net.convolution(filters, 3)
        net.second_half()
        net.convolution(filters // 2, 3)
        net.convolution(filters // 2, 3)
        net.route(-1, -2)
        net.convolution(filters, 1)
        net.route(-6, -1)
        net.pool(2, 2)
    net.convolution(512, 3)
    net.convolution(256, 1)
    net.convolution(512, 3)
    net.head("3,4,5", scale_x_y=1.05, nms_kind="greedynms", beta_nms=0.6)
    net.up_to(23, 128)
    net.convolution(256, 3)
    net.head("1,2,3", scale_x_y=1.05, nms_kind="greedynms", beta_nms=0.6)
    return net


def later() -> Architecture:
    net = Architecture("later")
    net.convolution(8, 3, pad=0, padding=1, activation="mish")
    net.pool(2, 2)  # 102 x 74 to 51 x 37
    net.convolution(16, 3, stride=2, activation="swish", stopbackward=1, learning_rate=0.1)  # 26 x 19
    net.add("dropout", 16, probability=0.2)
    net.convolution(16, 3, groups=4, activation="relu")
    net.convolution(16, 5, activation="mish")
    net.head("0,2,3", scale_x_y=1.2)
    return net


def architecture(name: str) -> Architecture:
    made = {"yolov3-tiny": tiny, "yolov4-tiny": tiny_4, "later": later}
    return made[name]() if name in made else darknet_53(name)


def header(name: str) -> bytes:
    """Tiny gets the header of version 0.1, with 4 bytes of images seen, the others 0.2 with 8."""
    if name == "yolov3-tiny":
        return np.array([0, 1, 0, 32013312], dtype="<i4").tobytes()
    return np.array([0, 2, 0], dtype="<i4").tobytes() + np.array([32013312], dtype="<i8").tobytes()


def write_seeded_weights(path: Path, name: str) -> int:
    """Write a .weights file from a fixed seed and return its checksum."""
    rng = np.random.default_rng(20181)
    checksum = 0

    def uniform(n: int, low: float, high: float) -> np.ndarray:
        values = rng.random(n, dtype=np.float32)
        values *= np.float32(high - low)
        values += np.float32(low)
        return values

    with path.open("wb") as file:
        file.write(header(name))
        for kernel in architecture(name).kernels:
            n = kernel.filters
            parts = [uniform(n, -0.2, 0.2)]  # beta or bias
            if kernel.normalize:
                parts += [uniform(n, 0.5, 1.5), uniform(n, -0.2, 0.2), uniform(n, 0.5, 1.5)]  # gamma, mean, variance
            fan_in = kernel.inputs * kernel.size**2
            limit = float(np.sqrt(3.0 * kernel.gain / fan_in))
            for part in [*parts, uniform(n * fan_in, -limit, limit)]:
                checksum = zlib.crc32(part.astype("<f4", copy=False), checksum)
                file.write(part.astype("<f4", copy=False))
    return checksum


def seeded_image(name: str) -> np.ndarray:
    """Return an image (1, 3, height, width) in [0, 1]."""
    width, height = SIZES[name]
    return np.random.default_rng(53).random((1, 3, height, width), dtype=np.float32)
