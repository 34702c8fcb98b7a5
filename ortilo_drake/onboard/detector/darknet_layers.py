"""The layers of a Darknet network of the YOLOv3 kind (Redmon and Farhadi, "YOLOv3", 2018), as frozen data.

Layers are numbered from 0 as Darknet does; what a layer names is given by its absolute number.
"""

from dataclasses import dataclass
from typing import NamedTuple

# Darknet's activations of single values (activations.c, activations.h); those of whole channels are not computed.
ACTIVATIONS = (
    *("linear", "leaky", "logistic", "mish", "hard_mish", "swish", "relu", "relu6"),
    *("elu", "selu", "gelu", "tanh", "hardtan", "loggy", "relie", "ramp"),
)


class Shape(NamedTuple):
    """The size of a layer's output."""

    channels: int
    height: int
    width: int


@dataclass(frozen=True)
class Net:
    """[net]: the input image's width and height [px]."""

    width: int
    height: int


@dataclass(frozen=True)
class Convolutional:
    """[convolutional]: from inputs to filters channels, each in its own of the groups, and its activation.

    padding: rows and columns of zeros on every side.
    """

    inputs: int
    filters: int
    size: int
    stride: int
    padding: int
    batch_normalize: bool
    activation: str
    groups: int = 1


@dataclass(frozen=True)
class Shortcut:
    """[shortcut]: the layer before plus the layer numbered source, and its activation."""

    source: int
    activation: str


@dataclass(frozen=True)
class Route:
    """[route]: the channels of the layers numbered sources, one after the other; of each only one of groups parts."""

    sources: tuple[int, ...]
    groups: int = 1
    group: int = 0


@dataclass(frozen=True)
class Upsample:
    """[upsample]: every cell repeated stride x stride times."""

    stride: int


@dataclass(frozen=True)
class Maxpool:
    """[maxpool]: the largest of size x size cells, padded by padding // 2 before and by the rest behind."""

    size: int
    stride: int
    padding: int


@dataclass(frozen=True)
class Dropout:
    """[dropout] or [empty]: passes the layer before on; only training does anything in it."""


@dataclass(frozen=True)
class Yolo:
    """[yolo]: a head."""

    anchors: tuple[tuple[float, float], ...]
    """its own (width, height) [px of the network's input]."""
    classes: int
    """their number."""
    scale_x_y: float = 1.0
    """stretches the centre's place in its cell about the cell's middle."""


Layer = Convolutional | Shortcut | Route | Upsample | Maxpool | Dropout | Yolo


@dataclass(frozen=True)
class DarknetCfg:
    """A network that fits together."""

    text: str
    """the .cfg it was read from."""
    net: Net
    """its input."""
    layers: tuple[Layer, ...]
    """its layers in Darknet's order and numbers."""
    shapes: tuple[Shape, ...]
    """of each layer's output."""

    @property
    def heads(self) -> tuple[Yolo, ...]:
        """Its [yolo] layers, in their order."""
        return tuple(layer for layer in self.layers if isinstance(layer, Yolo))

    @property
    def weight_count(self) -> int:
        """Floats in its .weights file behind the header: four vectors with batch normalisation, one without."""
        convolutions = (layer for layer in self.layers if isinstance(layer, Convolutional))
        return sum(
            c.filters * (c.inputs // c.groups * c.size**2 + (4 if c.batch_normalize else 1)) for c in convolutions
        )
