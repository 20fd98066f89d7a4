"""The network of boundaries, for training; the package runs it as an ONNX file."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from napari_unpack.segmentation.learned.boundary_network import CHANNELS

WIDTHS = (24, 48, 96, 128)
"""Channels at the cells' grid and after one, two and three halvings."""

WIDE = 32
"""Channels before the head."""

DEPTHS = (1, 2, 3)
"""Blocks on the way down after one, two and three halvings; on the way up there is one each."""


def convolution(coming: int, going: int) -> nn.Conv3d:
    """Return a convolution of 3 x 3 x 3 that keeps the variance of what is rectified."""
    made = nn.Conv3d(coming, going, 3, padding=1)
    nn.init.kaiming_normal_(made.weight, nonlinearity="relu")
    nn.init.zeros_(made.bias)
    return made


class Block(nn.Module):
    """Two convolutions and what came in, which is all at first."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.one, self.two = convolution(width, width), convolution(width, width)
        nn.init.zeros_(self.two.weight)

    def forward(self, x: Tensor) -> Tensor:
        """Return as many channels as came."""
        return torch.relu(x + self.two(torch.relu(self.one(x))))


class BoundaryNetwork(nn.Module):
    """A U-Net over cells of 2 x 2 x 2 voxels, which are its channels.

    Half of the work is done at the cells' grid, most of the weights lie two and three halvings
    below it, where a whole object is in sight. Nothing is normalised: a patch holds one or two
    volumes, whose statistics are not those of the next.
    """

    def __init__(self) -> None:
        super().__init__()
        a, b, c, d = WIDTHS
        self.first, self.fine = convolution(8, a), convolution(a, a)
        self.downs = nn.ModuleList(nn.Conv3d(m, n, 2, 2) for m, n in ((a, b), (b, c), (c, d)))
        self.enter = nn.ModuleList(
            nn.Sequential(*[Block(n) for _ in range(depth)])
            for n, depth in zip((b, c, d), DEPTHS, strict=True)
        )
        self.ups = nn.ModuleList(nn.ConvTranspose3d(n, m, 2, 2) for m, n in ((b, c), (c, d)))
        self.leave = nn.ModuleList(Block(n) for n in (b, c))
        self.last_up = nn.ConvTranspose3d(b, a, 2, 2)
        self.mix, self.end = convolution(a, WIDE), convolution(WIDE, WIDE)
        nn.init.zeros_(self.end.weight)
        self.head = nn.Conv3d(WIDE, CHANNELS, 1)

    def forward(self, cells: Tensor) -> Tensor:
        """Return (N, CHANNELS, z, y, x) logits for (N, 8, z, y, x) cells."""
        fine = torch.relu(self.fine(torch.relu(self.first(cells))))
        kept = []
        x = fine
        for down, blocks in zip(self.downs, self.enter, strict=True):
            x = blocks(torch.relu(down(x)))
            kept.append(x)
        for k in (1, 0):
            x = self.leave[k](torch.relu(kept[k] + self.ups[k](x)))
        x = torch.relu(self.mix(torch.relu(fine + self.last_up(x))))
        return self.head(torch.relu(x + self.end(x)))
