"""The layers of a Darknet network of the YOLOv3 kind (Redmon and Farhadi, "YOLOv3", 2018), as frozen data.

Layers are numbered from 0 as Darknet does; what a layer names is given by its absolute number.
"""

from dataclasses import dataclass

ACTIVATIONS = ("linear", "leaky", "logistic")


@dataclass(frozen=True)
class Net:
    """[net]: the input image's width and height [px]."""

    width: int
    height: int


@dataclass(frozen=True)
class Convolutional:
    """[convolutional]: from inputs to filters channels, padded by size // 2, and its activation."""

    inputs: int
    filters: int
    size: int
    stride: int
    batch_normalize: bool
    activation: str


@dataclass(frozen=True)
class Shortcut:
    """[shortcut]: the layer before plus the layer numbered source, and its activation."""

    source: int
    activation: str


@dataclass(frozen=True)
class Route:
    """[route]: the channels of the layers numbered sources, one after the other."""

    sources: tuple[int, ...]


@dataclass(frozen=True)
class Upsample:
    """[upsample]: every cell repeated stride x stride times."""

    stride: int


@dataclass(frozen=True)
class Maxpool:
    """[maxpool]: the largest of size x size cells, padded by (size - 1) // 2 before and by size // 2 behind."""

    size: int
    stride: int


@dataclass(frozen=True)
class Yolo:
    """[yolo]: a head; its own anchors (width, height) [px of the network's input] and the number of classes."""

    anchors: tuple[tuple[float, float], ...]
    classes: int


Layer = Convolutional | Shortcut | Route | Upsample | Maxpool | Yolo


@dataclass(frozen=True)
class DarknetCfg:
    """A network that fits together.

    Attributes:
        text: the .cfg it was read from.
        net: its input.
        layers: its layers in Darknet's order and numbers.
        stride: input pixels to a cell of the coarsest layer; an input's width and height are multiples of it.
        strides: input pixels to a cell of each head.
        heads: its [yolo] layers, in their order.
    """

    text: str
    net: Net
    layers: tuple[Layer, ...]
    stride: int
    strides: tuple[int, ...]
    heads: tuple[Yolo, ...]

    @property
    def weight_count(self) -> int:
        """Floats in its .weights file behind the header: four vectors with batch normalisation, one without."""
        convolutions = (layer for layer in self.layers if isinstance(layer, Convolutional))
        return sum(c.filters * (c.inputs * c.size**2 + (4 if c.batch_normalize else 1)) for c in convolutions)
