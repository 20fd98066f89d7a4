"""Write a trained network as the ONNX file that the package runs.

`python -m benchmarks.boundaries.export CHECKPOINT
src/napari_unpack/segmentation/weights/boundary_network.onnx`
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import onnx
import torch
from onnx import TensorProto, helper, numpy_helper
from torch import Tensor, nn

from benchmarks.boundaries.network import BoundaryNetwork


class Shipped(nn.Module):
    """The network, and its probabilities as bytes."""

    def __init__(self, network: BoundaryNetwork) -> None:
        super().__init__()
        self.network = network

    def forward(self, cells: Tensor) -> Tensor:
        """Return probabilities in 255ths."""
        return (torch.sigmoid(self.network(cells)) * 255 + 0.5).to(torch.uint8)


def store_in_bytes(model: onnx.ModelProto) -> None:
    """Store weights as bytes and a scale for each channel; they are widened when it is opened.

    Parameters
    ----------
    model : onnx.ModelProto
        Changed.
    """
    widened = []
    transposed = {node.input[1] for node in model.graph.node if node.op_type == "ConvTranspose"}
    for tensor in list(model.graph.initializer):
        values = numpy_helper.to_array(tensor)
        if values.dtype != np.float32 or values.ndim < 2:
            continue
        name = tensor.name
        # Channels that come out are the second axis of what enlarges.
        own = 1 if name in transposed else 0
        others = tuple(axis for axis in range(values.ndim) if axis != own)
        scale = np.maximum(np.abs(values).max(axis=others, keepdims=True) / 127, 1e-12)
        rounded = np.rint(values / scale).astype(np.int8)
        tensor.CopyFrom(numpy_helper.from_array(rounded, f"{name}_bytes"))
        model.graph.initializer.append(
            numpy_helper.from_array(scale.astype(np.float32), f"{name}_scale")
        )
        widened += [
            helper.make_node("Cast", [f"{name}_bytes"], [f"{name}_wide"], to=TensorProto.FLOAT),
            helper.make_node("Mul", [f"{name}_wide", f"{name}_scale"], [name]),
        ]
    for k, node in enumerate(widened):
        model.graph.node.insert(k, node)


def export(checkpoint: Path, path: Path) -> None:
    """Write the mean weights of a checkpoint as the file that the package runs.

    Parameters
    ----------
    checkpoint : Path
        See `train.train`.
    path : Path
        Of the ONNX file.
    """
    network = BoundaryNetwork()
    network.load_state_dict(torch.load(checkpoint, weights_only=True)["mean"])
    sizes = {2: "z", 3: "y", 4: "x"}
    torch.onnx.export(
        Shipped(network.eval()),
        (torch.zeros(1, 8, 16, 16, 16),),
        str(path),
        dynamo=False,
        input_names=["cells"],
        output_names=["said"],
        dynamic_axes={"cells": sizes, "said": sizes},
        opset_version=17,
    )
    model = onnx.load(path)
    store_in_bytes(model)
    model.producer_version = model.doc_string = ""
    onnx.checker.check_model(model)
    onnx.save(model, path)


if __name__ == "__main__":
    export(Path(sys.argv[1]), Path(sys.argv[2]))
