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

BAGS, SOLIDS = (100, 234), (0, 260)


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
    share : float
        Of the patches from solids.
    """

    seed: int
    steps: int
    decay: int = 0
    rate: float = 2e-3
    ranks: int = 1
    share: float = 0.25

    def shortened(self, by: int) -> Stage:
        """Return it with its steps divided."""
        return replace(self, steps=-(-self.steps // by), decay=self.decay // by)


STAGES = (
    Stage(0, 500),
    Stage(1, 300, ranks=2),
    Stage(2, 1650, ranks=2),
    Stage(3, 1100, decay=1100, ranks=2),
    Stage(7, 1450, decay=1000, rate=1.2e-3, ranks=2, share=0.4),
    Stage(21, 1700, rate=1.5e-3, share=0.4),
    Stage(31, 750, decay=650, rate=1.2e-3, share=0.4),
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
    bags, solids = (
        (first, first + -(-(last - first) // shorter)) for first, last in (BAGS, SOLIDS)
    )
    for (first, last), kind in ((bags, "bag"), (solids, "solids")):
        missing = next(
            (n for n in range(first, last) if not (folder / f"{kind}{n}-density.npy").exists()),
            last,
        )
        if missing < last:
            volumes = ["volumes", str(folder), str(missing), str(last)]
            _run([*volumes, *(["--solids"] if kind == "solids" else [])])
    before: Path | None = None
    for stage in (whole.shortened(shorter) for whole in STAGES):
        # With its steps: a trial's are none of the training's.
        checkpoint = folder / f"seed{stage.seed}-steps{stage.steps}.pt"
        if not checkpoint.exists():
            train(stage, folder, checkpoint, before, (bags, solids))
        before = checkpoint
    _run(["export", str(before), str(options.file)])


def train(
    stage: Stage,
    folder: Path,
    checkpoint: Path,
    before: Path | None,
    seeds: tuple[tuple[int, int], tuple[int, int]],
) -> None:
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
    seeds : ((int, int), (int, int))
        First and last of the bags, and of the solids.
    """
    unfinished, meet = folder / "unfinished.pt", folder / "meet"
    meet.unlink(missing_ok=True)
    told = {
        "steps": stage.steps,
        "decay": stage.decay,
        "rate": stage.rate,
        "seed": stage.seed,
        "share": stage.share,
        "ranks": stage.ranks,
        "meet": meet.absolute(),
    }
    command = ["train", str(folder), str(unfinished)]
    command += [f"--{name}={value}" for name, value in told.items()]
    for name, (first, last) in zip(("bags", "solids"), seeds, strict=True):
        command += [f"--{name}", str(first), str(last)]
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
