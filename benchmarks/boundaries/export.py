"""Write a trained network as the ONNX file that the package runs.

`python -m benchmarks.boundaries.export CHECKPOINT
src/napari_unpack/segmentation/weights/boundary_network.onnx`;
of several checkpoints, each with its weight after a colon, it writes the mean (a network and one
trained on from it lie close enough: Wortsman et al., Model soups, ICML 2022).
"""

from __future__ import annotations

import sys

import numpy as np
import onnx
import torch
from onnx import TensorProto, helper, numpy_helper
from torch import Tensor, nn

from benchmarks.boundaries.network import BoundaryNetwork


class Shipped(nn.Module):
    """The network with normalised weights and probabilities as bytes."""

    def __init__(self, network: BoundaryNetwork) -> None:
        super().__init__()
        self.network = network

    def forward(self, cells: Tensor) -> Tensor:
        """Return probabilities in 255ths."""
        return (torch.sigmoid(self.network(cells)) * 255 + 0.5).to(torch.uint8)


def fold(network: nn.Module) -> None:
    """Put every normalisation into the convolution before it."""
    for part in network.modules():
        if isinstance(part, nn.Sequential) and isinstance(part[1], nn.BatchNorm3d):
            part[0] = nn.utils.fuse_conv_bn_eval(part[0], part[1])
            part[1] = nn.Identity()


def halve(model: onnx.ModelProto) -> None:
    """Store the weights in half precision; they are widened when the file is opened."""
    casts = []
    for tensor in list(model.graph.initializer):
        values = numpy_helper.to_array(tensor)
        if values.dtype != np.float32 or values.size < 64:
            continue
        name = tensor.name
        tensor.CopyFrom(numpy_helper.from_array(values.astype(np.float16), f"{name}_half"))
        casts.append(helper.make_node("Cast", [f"{name}_half"], [name], to=TensorProto.FLOAT))
    for k, node in enumerate(casts):
        model.graph.node.insert(k, node)


def mean(checkpoints: list[str]) -> dict[str, Tensor]:
    """Return the mean of the weights in files, each named as PATH or PATH:WEIGHT."""
    found = []
    for named in checkpoints:
        path, _, weight = named.partition(":")
        found.append((torch.load(path, weights_only=True)["network"], float(weight or 1)))
    one, total = found[0][0], sum(weight for _, weight in found)
    return {
        k: sum(state[k] * (weight / total) for state, weight in found)
        if v.is_floating_point()
        else v
        for k, v in one.items()
    }


def main() -> None:
    *checkpoints, path = sys.argv[1:]
    network = BoundaryNetwork()
    network.load_state_dict(mean(checkpoints))
    network.eval()
    fold(network)
    torch.onnx.export(
        Shipped(network),
        (torch.zeros(1, 8, 16, 16, 16),),
        path,
        dynamo=False,
        input_names=["cells"],
        output_names=["said"],
        dynamic_axes={"cells": {2: "z", 3: "y", 4: "x"}, "said": {2: "z", 3: "y", 4: "x"}},
        opset_version=17,
    )
    model = onnx.load(path)
    halve(model)
    model.producer_version = model.doc_string = ""
    onnx.checker.check_model(model)
    onnx.save(model, path)


if __name__ == "__main__":
    main()
