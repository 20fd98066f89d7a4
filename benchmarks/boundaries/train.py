"""Train the network of boundaries.

`python -m benchmarks.boundaries` runs it after the volumes are written; by hand,
`python -m benchmarks.boundaries.train FOLDER`. It goes on where it was stopped, and needs the
dependency group `train`. Where PyTorch finds a graphics card, it trains there, in half precision.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn
from torch.nn.functional import binary_cross_entropy_with_logits
from torch.utils.data import DataLoader, IterableDataset, get_worker_info

from benchmarks.boundaries.examples import (
    AIR_ALONE,
    APART,
    BESIDE_AIR,
    NOTHING,
    SAME,
    Source,
    examples,
)
from benchmarks.boundaries.network import BoundaryNetwork
from benchmarks.boundaries.volumes import KINDS, seeds

GROUPS = {"matter": slice(0, 8), "next": slice(8, 32), "near": slice(32, 38), "far": slice(38, 44)}
"""Channels whose losses count alike."""

KEPT_EVERY, TOLD_EVERY = 250, 50
"""Steps from one checkpoint to the next, and from one line of losses to the next."""


@dataclass(frozen=True)
class Schedule:
    """How the network is trained.

    Parameters
    ----------
    steps : int
    rate : float
        Of learning, until it falls.
    falling : float
        Share of the steps, the last ones, in which the rate falls to nothing.
    rising : int
        First steps, in which it rises.
    size : int
        Voxels of a patch along each axis.
    batch : int
        Patches of a step. One alone takes twice its time: PyTorch leaves small convolutions of
        one to a slower library.
    apart : float
        Weight of two voxels of two objects, against two of one.
    memory : float
        Of the mean over steps that is what is kept: so much of it stays at each.
    seconds : float, optional
        After which it ends, on a machine lent for a time: the rate falls by the clock then, and
        not by the steps.
    """

    steps: int = 24000
    rate: float = 1.2e-3
    falling: float = 0.3
    rising: int = 300
    size: int = 80
    batch: int = 2
    apart: float = 4.0
    memory: float = 0.999
    seconds: float | None = None

    def done(self, step: int, seconds: float) -> float:
        """Return the share of the training that is done before a step, after some seconds."""
        return step / self.steps if self.seconds is None else seconds / self.seconds

    def rate_at(self, step: int, done: float) -> float:
        """Return the rate of a step, when some share of the training is done."""
        return self.rate * max(0.0, min(1.0, (step + 1) / self.rising, (1 - done) / self.falling))

    def weights(self) -> list[float]:
        """Return how much each answer of `examples.targets` weighs."""
        told = {NOTHING: 0.0, SAME: 1.0, APART: self.apart, BESIDE_AIR: 0.2, AIR_ALONE: 1.0}
        return [told[answer] for answer in sorted(told)]


class Patches(IterableDataset[Any]):
    """Patches without end, from a seed."""

    def __init__(self, source: Source, seed: int, schedule: Schedule) -> None:
        self.source, self.seed, self.schedule = source, seed, schedule

    def __iter__(self) -> Iterator[Any]:
        torch.set_num_threads(1)
        # Each of the loader's processes makes others.
        seed = [self.seed, get_worker_info().id]
        return examples(self.source, seed, self.schedule.size)


def losses(said: Tensor, answers: Tensor, weighing: Tensor) -> dict[str, Tensor]:
    """Return the weighted cross entropy of every group of channels.

    Parameters
    ----------
    said : (N, CHANNELS, z, y, x) Tensor of float
        Logits.
    answers : Tensor of uint8
        See `examples.targets`.
    weighing : (5,) Tensor of float
        The weight of each answer.
    """
    weights = weighing[answers.int()]
    wanted = (answers == SAME).to(said.dtype)
    each = binary_cross_entropy_with_logits(said, wanted, weights, reduction="none")
    return {k: each[:, s].sum() / weights[:, s].sum().clamp(min=1) for k, s in GROUPS.items()}


def train(
    folder: Path,
    volumes: Mapping[str, range],
    schedule: Schedule,
    checkpoint: Path,
    workers: int = 1,
) -> None:
    """Train, or go on from the checkpoint; it holds the weights as `mean` when this returns.

    Parameters
    ----------
    folder : Path
        Of the volumes.
    volumes : mapping of str to range
        Seeds of each kind.
    schedule : Schedule
    checkpoint : Path
    workers : int
        Processes that make patches.
    """
    torch.manual_seed(0)
    device = torch.device("cuda" if torch.cuda.is_available() else "cpu")
    network = BoundaryNetwork().to(device, memory_format=torch.channels_last_3d)
    optimizer = torch.optim.AdamW(network.parameters(), schedule.rate, weight_decay=1e-2)
    weighing = torch.tensor(schedule.weights(), device=device)
    mean = {k: v.clone() for k, v in network.state_dict().items()}
    begun = 0
    if checkpoint.exists():
        state = torch.load(checkpoint, weights_only=True, map_location=device)
        network.load_state_dict(state["network"])
        optimizer.load_state_dict(state["optimizer"])
        mean, begun = state["mean"], state["steps"]
    # Of other patches than those before a stop.
    patches = Patches(Source(folder, volumes), begun, schedule)
    on_card = device.type == "cuda"
    # All patches are of one size: the fastest convolutions are looked for once.
    torch.backends.cudnn.benchmark = on_card
    loader = DataLoader(
        patches, schedule.batch, num_workers=workers, prefetch_factor=4, pin_memory=on_card
    )
    coming = iter(loader)
    since, told = time.time(), dict.fromkeys(GROUPS, 0.0)
    for step in range(begun, schedule.steps):
        done = schedule.done(step, time.time() - since)
        last = step + 1 == schedule.steps or done >= 1
        for group in optimizer.param_groups:
            group["lr"] = schedule.rate_at(step, done)
        cells, answers = (tensor.to(device, non_blocking=True) for tensor in next(coming))
        with torch.autocast("cuda", torch.bfloat16, enabled=on_card):
            said = network(cells.to(memory_format=torch.channels_last_3d))
        each = losses(said.float(), answers, weighing)
        optimizer.zero_grad()
        torch.stack(list(each.values())).sum().backward()
        nn.utils.clip_grad_norm_(network.parameters(), 1.0)
        optimizer.step()
        # At first the mean is that of the steps so far.
        new = max(1 - schedule.memory, 1 / (step + 1))
        torch._foreach_lerp_(list(mean.values()), list(network.state_dict().values()), new)
        for k, v in each.items():
            told[k] += (v.detach() - told[k]) * max(0.01, 1 / (step - begun + 1))
        if (step + 1) % TOLD_EVERY == 0 or last:
            text = " ".join(f"{k} {v:.4f}" for k, v in told.items())
            print(f"{step + 1} {time.time() - since:.0f} s {text}", flush=True)
        if (step + 1) % KEPT_EVERY == 0 or last:
            state = {"network": network.state_dict(), "optimizer": optimizer.state_dict()}
            part = checkpoint.with_suffix(".part")
            torch.save({**state, "mean": mean, "steps": step + 1}, part)
            part.rename(checkpoint)
        if last:
            return


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, help="of the volumes")
    parser.add_argument("--checkpoint", type=Path, help="by default checkpoint.pt in the folder")
    parser.add_argument("--steps", type=int, default=Schedule.steps)
    parser.add_argument("--rate", type=float, default=Schedule.rate)
    parser.add_argument("--batch", type=int, default=Schedule.batch, help="patches of a step")
    parser.add_argument("--seconds", type=float, help="end by the clock, before the last step")
    parser.add_argument("--workers", type=int, default=1, help="processes that make patches")
    parser.add_argument("--shorten", type=int, default=1, help="as the volumes were")
    parser.add_argument("--threads", type=int, default=2)
    options = parser.parse_args()
    torch.set_num_threads(options.threads)
    volumes = {name: seeds(kind, options.shorten) for name, kind in KINDS.items()}
    schedule = Schedule(options.steps, options.rate, batch=options.batch, seconds=options.seconds)
    checkpoint = options.checkpoint or options.folder / "checkpoint.pt"
    train(options.folder, volumes, schedule, checkpoint, options.workers)


if __name__ == "__main__":
    main()
