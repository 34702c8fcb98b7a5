"""Export of a trained network (.safetensors) to ONNX; the package ships both files, with the same numbers."""

import io
import warnings
from pathlib import Path

import torch

from ortilo_drake.flight.files import write_bytes
from ortilo_drake.onboard.detector.darknet_file import read_network
from ortilo_drake.onboard.detector.darknet_network import DarknetNetwork


def fold_batch_norm(network: DarknetNetwork) -> None:
    """Merge each batch normalisation into the convolution before it, in place; the network's outputs stay the same."""
    for layer in network.convolutions():
        if layer.norm is not None:
            layer.convolution = torch.nn.utils.fuse_conv_bn_eval(layer.convolution, layer.norm)
            layer.norm = None


def export(source: Path, onnx: Path) -> None:
    """Write the network of a .safetensors file as ONNX, for one RGB picture (1 x 3 x height x width) in [0, 1].

    InputError if the source is damaged or a file cannot be written.
    """
    network, _ = read_network(source)
    network.eval()
    fold_batch_norm(network)
    images = torch.zeros(1, 3, network.cfg.net.height, network.cfg.net.width)
    names = [f"head{k}" for k in range(len(network.cfg.heads))]
    made = io.BytesIO()
    with warnings.catch_warnings():
        # Constant folding skips the padding of a pool that differs between sides, and warns; the result is the same.
        warnings.filterwarnings("ignore", "Constant folding", UserWarning)
        torch.onnx.export(
            network,
            (images,),
            made,  # type: ignore[arg-type]  # the exporter without dynamo can also write to memory
            dynamo=False,
            opset_version=17,
            input_names=["image"],
            output_names=names,
        )
    write_bytes(onnx, made.getvalue())
