"""Make the network of boundaries anew.

`python -m benchmarks.boundaries src/napari_unpack/segmentation/weights/boundary_network.onnx`
writes the volumes to learn from, trains, and exports. Volumes and checkpoint are kept in a folder,
so that the command goes on where it was stopped. `--shorten 100` takes a hundredth of all, to try
whether it runs. It needs the dependency group `train`.

What else is given goes to the training (`train.py`): with a graphics card and many cores,
`--batch 8 --rate 1.5e-3 --workers 14` takes minutes.

One state of the code, one machine and one number of threads give the same weights if nothing stops
it; elsewhere sums are taken in another order.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from pathlib import Path

STEPS = 24000
"""Of two patches each; seven hours on two cores."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("file", type=Path, help="where to write the network (.onnx)")
    parser.add_argument("--folder", type=Path, default=Path("network-training"))
    parser.add_argument("--shorten", type=int, default=1, help="divides volumes and steps")
    options, more = parser.parse_known_args()
    folder, shorten = str(options.folder), str(options.shorten)
    parts = [
        _begin("volumes", folder, "--shorten", shorten, "--part", str(part), "2")
        for part in range(2)
    ]
    _ended(*parts)
    steps = -(-STEPS // options.shorten)
    # With its steps: a trial's is none of the training's.
    checkpoint = options.folder / f"checkpoint-{steps}.pt"
    told = ["--checkpoint", str(checkpoint), "--steps", str(steps), "--shorten", shorten]
    _ended(_begin("train", folder, *told, *more))
    _ended(_begin("export", str(checkpoint), str(options.file)))


def _begin(name: str, *arguments: str) -> subprocess.Popen[bytes]:
    return subprocess.Popen([sys.executable, "-m", f"benchmarks.boundaries.{name}", *arguments])


def _ended(*processes: subprocess.Popen[bytes]) -> None:
    try:
        if any(process.wait() for process in processes):
            raise SystemExit(f"{' '.join(map(str, processes[0].args))} failed")
    finally:
        for process in processes:
            process.kill()


if __name__ == "__main__":
    main()
