"""Train the network of boundaries.

`python -m benchmarks.boundaries` runs it for every stage of the shipped network; by hand, of other
volumes (`benchmarks.boundaries.volumes`), `python -m benchmarks.boundaries.train DATA CHECKPOINT`.
It needs the dependency group `train`.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import torch
from torch import distributed, nn
from torch.nn.functional import binary_cross_entropy_with_logits
from torch.utils.data import DataLoader, IterableDataset

from benchmarks.boundaries.examples import Source, examples
from benchmarks.boundaries.network import BoundaryNetwork

GROUPS = {"matter": slice(0, 8), "next": slice(8, 32), "near": slice(32, 38), "far": slice(38, 44)}


class Patches(IterableDataset[Any]):
    """Patches by seed; every loading process has its own seeds."""

    def __init__(self, source: Source, seed: int, size: int, apart: float) -> None:
        self.source, self.seed, self.size, self.apart = source, seed, size, apart

    def __iter__(self) -> Iterator[Any]:
        worker = torch.utils.data.get_worker_info()
        torch.set_num_threads(1)
        return examples(
            self.source, self.seed + (worker.id if worker else 0), self.size, self.apart
        )


def losses(said: torch.Tensor, wanted: torch.Tensor, weights: torch.Tensor) -> dict[str, Any]:
    """Return the weighted cross entropy of every group of channels."""
    each = binary_cross_entropy_with_logits(said, wanted, weights, reduction="none")
    return {k: each[:, s].sum() / weights[:, s].sum().clamp(min=1) for k, s in GROUPS.items()}


def share(tensors: list[torch.Tensor], ranks: int) -> None:
    """Replace tensors by their means over all processes."""
    flat = torch.cat([t.reshape(-1) for t in tensors])
    distributed.all_reduce(flat)
    for tensor, part in zip(tensors, flat.split([t.numel() for t in tensors]), strict=True):
        tensor.copy_((part / ranks).view_as(tensor))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("data", type=Path)
    parser.add_argument("checkpoint", type=Path)
    parser.add_argument("--start", type=Path, help="a checkpoint to go on from")
    parser.add_argument("--steps", type=int, default=3000)
    parser.add_argument("--decay", type=int, default=800, help="last steps, of a falling rate")
    parser.add_argument("--rate", type=float, default=2e-3)
    parser.add_argument("--size", type=int, default=80)
    parser.add_argument("--batch", type=int, default=1)
    parser.add_argument("--apart", type=float, default=4.0)
    parser.add_argument("--bags", type=int, nargs=2, default=(100, 300))
    parser.add_argument("--solids", type=int, nargs=2, default=(0, 260))
    parser.add_argument("--share", type=float, default=0.4, help="of the patches from solids")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--minutes", type=float, default=1e9)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--ranks", type=int, default=1, help="processes that train together")
    parser.add_argument("--rank", type=int, default=0, help="which of them this one is")
    parser.add_argument("--meet", default="", help="a new file's path through which they meet")
    options = parser.parse_args()
    if options.ranks > 1:
        distributed.init_process_group(
            "gloo", f"file://{options.meet}", rank=options.rank, world_size=options.ranks
        )
    torch.set_num_threads(options.threads)
    torch.manual_seed(options.seed)
    network = BoundaryNetwork().to(memory_format=torch.channels_last_3d)
    optimizer = torch.optim.AdamW(network.parameters(), options.rate, weight_decay=1e-3)
    if options.start:
        state = torch.load(options.start, weights_only=True)
        network.load_state_dict(state["network"])
        optimizer.load_state_dict(state["optimizer"])
    bags, solids = range(*options.bags), range(*options.solids)
    source = Source(options.data, bags, solids, options.share)
    patches = Patches(source, 1000 * options.seed + 100 * options.rank, options.size, options.apart)
    loader = iter(DataLoader(patches, options.batch, num_workers=1, prefetch_factor=4))
    begun, mean = time.time(), dict.fromkeys(GROUPS, 0.0)
    network.train()
    for step in range(options.steps):
        left = options.steps - step
        rate = options.rate * min(1, (step + 1) / 50, left / max(options.decay, 1))
        for group in optimizer.param_groups:
            group["lr"] = rate
        if left == options.decay // 2:
            # Learn on with the statistics that will be used: patches differ from each other.
            for part in network.modules():
                if isinstance(part, nn.BatchNorm3d):
                    part.eval()
        cells, wanted, weights = next(loader)
        with torch.autocast("cpu", torch.bfloat16):
            said = network(cells.to(memory_format=torch.channels_last_3d))
        each = losses(said.float(), wanted, weights)
        loss = sum(each.values())
        optimizer.zero_grad()
        loss.backward()
        nn.utils.clip_grad_norm_(network.parameters(), 5.0)
        optimizer.step()
        # Seldom, so that no process waits for the other's every step (local SGD).
        if options.ranks > 1 and (step % 20 == 19 or left == 1):
            share([p.data for p in network.parameters()], options.ranks)
            share([b for b in network.buffers() if b.is_floating_point()], options.ranks)
        for k, v in each.items():
            mean[k] += (float(v.detach()) - mean[k]) * max(0.02, 1 / (step + 1))
        if step % 25 == 0 or left == 1:
            told = " ".join(f"{k} {v:.4f}" for k, v in mean.items())
            print(f"{step} {time.time() - begun:.0f} s {told}", flush=True)
        if (step % 100 == 99 or left == 1) and options.rank == 0:
            state = {"network": network.state_dict(), "optimizer": optimizer.state_dict()}
            torch.save(state, options.checkpoint.with_suffix(".part"))
            options.checkpoint.with_suffix(".part").rename(options.checkpoint)
        if time.time() - begun > 60 * options.minutes:
            break


if __name__ == "__main__":
    main()
