"""Make the network of boundaries anew, in the stages in which the shipped one was trained.

`python -m benchmarks.boundaries src/napari_unpack/segmentation/weights/boundary_network.onnx`
writes the volumes to learn from, trains, and exports. Volumes and the checkpoint of every stage
are kept in a folder, so that the command goes on where it was stopped. `--shorten 100` takes a
hundredth of all, to try whether it runs. It needs the dependency group `train`.

One state of the code, one machine and one number of threads give the same weights; elsewhere sums
are taken in another order, and how far the scores of benchmarks/segmentation then differ has not
been measured.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from dataclasses import dataclass, replace
from pathlib import Path

from benchmarks.boundaries.volumes import KINDS

WIDE = {
    "bag": 0.27,
    "solids": 0.13,
    "clad": 0.07,
    "metal": 0.1,
    "bag-by-rays": 0.21,
    "solids-by-rays": 0.09,
    "large-by-rays": 0.06,
    "metal-by-rays": 0.07,
}
"""Of the patches of the last stages, by kind of volumes: large things, metal, and its streaks."""

WIDER = 0.5
"""Of the last stages in the mean of weights that ships; the rest is of the stage before them."""


@dataclass(frozen=True)
class Stage:
    """A stage of training, from the weights of the one before.

    Parameters
    ----------
    seed, steps : int
    decay : int
        Last steps, of a falling rate.
    rate : float
    ranks : int
        Processes that train together.
    solids : float
        Of the patches, from packed solids; the others are of bags.
    wide : bool
        Take patches of all kinds (`WIDE`) instead, some of them zoomed further, and leave the
        statistics of normalisations as they are.
    """

    seed: int
    steps: int
    decay: int = 0
    rate: float = 2e-3
    ranks: int = 1
    solids: float = 0.25
    wide: bool = False

    @property
    def shares(self) -> dict[str, float]:
        """Return the share of the patches of each kind of volumes."""
        return WIDE if self.wide else {"bag": 1 - self.solids, "solids": self.solids}

    def shortened(self, by: int) -> Stage:
        """Return it with its steps divided."""
        return replace(self, steps=-(-self.steps // by), decay=self.decay // by)


STAGES = (
    Stage(0, 500),
    Stage(1, 300, ranks=2),
    Stage(2, 1650, ranks=2),
    Stage(3, 1100, decay=1100, ranks=2),
    Stage(7, 1450, decay=1000, rate=1.2e-3, ranks=2, solids=0.4),
    Stage(21, 1700, rate=1.5e-3, solids=0.4),
    Stage(31, 750, decay=650, rate=1.2e-3, solids=0.4),
    Stage(900, 1800, decay=1200, rate=6e-4, ranks=2, wide=True),
    Stage(950, 4000, decay=3000, rate=8e-4, ranks=2, wide=True),
)
"""Those without decay were stopped before they came to it."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("file", type=Path, help="where to write the network (.onnx)")
    parser.add_argument("--folder", type=Path, default=Path("network-training"))
    parser.add_argument("--shorten", type=int, default=1, help="divides seeds and steps")
    options = parser.parse_args()
    shorter, folder = options.shorten, options.folder
    folder.mkdir(parents=True, exist_ok=True)
    for name, kind in KINDS.items():
        seeds = kind.seeds[: -(-len(kind.seeds) // shorter)]
        made = (folder / f"{name}{seed}-density.npy" for seed in seeds)
        missing = next((n for n, path in zip(seeds, made, strict=True) if not path.exists()), None)
        if missing is not None:
            _run(["volumes", str(folder), name, str(missing), str(seeds.stop)])
    before: Path | None = None
    usual: Path | None = None
    for stage in (whole.shortened(shorter) for whole in STAGES):
        # With its steps: a trial's are none of the training's.
        checkpoint = folder / f"seed{stage.seed}-steps{stage.steps}.pt"
        if not checkpoint.exists():
            train(stage, folder, checkpoint, before)
        before = checkpoint
        usual = usual if stage.wide else checkpoint
    _run(["export", f"{usual}:{1 - WIDER}", f"{before}:{WIDER}", str(options.file)])


def train(stage: Stage, folder: Path, checkpoint: Path, before: Path | None) -> None:
    """Run the processes of one stage; its checkpoint is there once it has ended.

    Parameters
    ----------
    stage : Stage
    folder : Path
        Of the volumes.
    checkpoint : Path
        Where its weights go.
    before : Path, optional
        The checkpoint to go on from.
    """
    unfinished, meet = folder / "unfinished.pt", folder / "meet"
    meet.unlink(missing_ok=True)
    told = {
        "steps": stage.steps,
        "decay": stage.decay,
        "rate": stage.rate,
        "seed": stage.seed,
        "ranks": stage.ranks,
        "meet": meet.absolute(),
    }
    command = ["train", str(folder), str(unfinished)]
    command += [f"--{name}={value}" for name, value in told.items()]
    command += ["--shares", *(f"{kind}={share}" for kind, share in stage.shares.items())]
    if stage.wide:
        command += ["--far", "--still"]
    if before is not None:
        command += ["--start", str(before)]
    print(f"seed {stage.seed}: {stage.steps} steps", flush=True)
    others = [_begin([*command, f"--rank={n}"]) for n in range(1, stage.ranks)]
    try:
        _run(command)
        if any(other.wait() for other in others):
            raise SystemExit("one of the processes that train together failed")
    finally:
        for other in others:
            other.kill()
    unfinished.rename(checkpoint)


def _begin(command: list[str]) -> subprocess.Popen[bytes]:
    name, *arguments = command
    return subprocess.Popen([sys.executable, "-m", f"benchmarks.boundaries.{name}", *arguments])


def _run(command: list[str]) -> None:
    if _begin(command).wait():
        raise SystemExit(f"{' '.join(command)} failed")


if __name__ == "__main__":
    main()
