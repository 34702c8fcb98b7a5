"""The layers of a Darknet network of the YOLOv3 kind (Redmon and Farhadi, "YOLOv3", 2018), as frozen data.

Layers are numbered from 0 as in Darknet; a layer refers to other layers by their absolute numbers.
"""

from dataclasses import dataclass
from typing import NamedTuple

# Darknet's activations of single values (activations.c, activations.h); activations over channels are not computed.
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
    """[convolutional]: a convolution in groups from `inputs` to `filters` channels, and its activation.

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
    """[shortcut]: the sum of the layer before and layer number `source`, and its activation."""

    source: int
    activation: str


@dataclass(frozen=True)
class Route:
    """[route]: the channels of the layers `sources`, concatenated; of each layer, part number `group` of `groups`."""

    sources: tuple[int, ...]
    groups: int = 1
    group: int = 0


@dataclass(frozen=True)
class Upsample:
    """[upsample]: every cell repeated stride x stride times."""

    stride: int


@dataclass(frozen=True)
class Maxpool:
    """[maxpool]: the maximum over size x size cells, padded by padding // 2 before and by the rest behind."""

    size: int
    stride: int
    padding: int


@dataclass(frozen=True)
class Dropout:
    """[dropout] or [empty]: returns its input unchanged; it acts only in training."""


@dataclass(frozen=True)
class Yolo:
    """[yolo]: a detection head."""

    anchors: tuple[tuple[float, float], ...]
    """(width, height) of the head's anchors [px of the network's input]."""
    classes: int
    """number of classes."""
    scale_x_y: float = 1.0
    """factor that stretches a box centre's position in its cell about the cell's middle."""


Layer = Convolutional | Shortcut | Route | Upsample | Maxpool | Dropout | Yolo


@dataclass(frozen=True)
class DarknetCfg:
    """A network with consistent layers."""

    text: str
    """text of the .cfg."""
    net: Net
    """input of the network."""
    layers: tuple[Layer, ...]
    """layers in Darknet's order and numbering."""
    shapes: tuple[Shape, ...]
    """shape of each layer's output."""

    @property
    def heads(self) -> tuple[Yolo, ...]:
        """The network's [yolo] layers, in their order."""
        return tuple(layer for layer in self.layers if isinstance(layer, Yolo))

    @property
    def weight_count(self) -> int:
        """The floats after the .weights header: kernels, and four vectors with batch normalisation, one without."""
        convolutions = (layer for layer in self.layers if isinstance(layer, Convolutional))
        return sum(
            c.filters * (c.inputs // c.groups * c.size**2 + (4 if c.batch_normalize else 1)) for c in convolutions
        )
