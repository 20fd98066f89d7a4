"""The longest time for which the window does not answer in a story, ours and napari's own."""

from __future__ import annotations

import os
from pathlib import Path

from benchmarks.on_screen import failure, run_script, screen_environment
from benchmarks.row import Row
from benchmarks.scenes import Scenes

WHAT = "longest stall of a story"
GOALS = {"sample": 100, "backpack": 200}
BACKPACK = (
    Path(os.environ.get("UNPACK_DATA", Path(__file__).parents[3] / "shared" / "data"))
    / "backpack.npz"
)
_SCRIPT = "import sys; from benchmarks.story import main; main(sys.argv[1:])"
# Making the panel comes before the story that is to be without stalls.
_BEFORE = "open_the_panel"


def measure(scenes: Scenes) -> list[Row]:
    if screen_environment() is None:
        return [Row.not_measured(WHAT, "sample bag", "no screen", "<= 100 ms in our code")]
    rows = [_row("sample", [])]
    if BACKPACK.exists() and not scenes.quick:
        rows.append(_row("backpack", [str(BACKPACK)]))
    return rows


def _row(name: str, volume: list[str]) -> Row:
    goal = f"<= {GOALS[name]} ms in our code"
    work = f"{name}: open, Segment, unpack, fast N, turn, save, open, a container and back, slices"
    told = run_script(_SCRIPT, *volume)
    ours = _stalls(told.stdout)
    if not ours:
        return Row.not_measured(WHAT, work, failure(told), goal)
    alone = _stalls(run_script(_SCRIPT, "--alone", *volume).stdout)
    phase, worst = max(ours.items(), key=lambda item: item[1][1] * (item[0] != _BEFORE))
    whole = max(numbers[0] for name, numbers in ours.items() if name != _BEFORE)
    own = ", ".join(f"{name.replace('_', ' ')} {n[0]} ms" for name, n in alone.items())
    return Row(
        WHAT,
        work,
        f"{worst[1]} ms in our code ({phase.replace('_', ' ')}; {worst[2]} ms of the processor); "
        f"{whole} ms with napari's own",
        f"napari alone: {own}",
        "",
        goal,
        worst[1] <= GOALS[name],
    )


def _stalls(printed: str) -> dict[str, tuple[int, int, int]]:
    """Return the longest stall of each phase, ours, and ours on the processor, ms."""
    found = {}
    for line in printed.splitlines():
        words = line.split()
        if words[:1] == ["stall"] and len(words) > 4:
            found[words[1]] = int(words[2]), int(words[3]), int(words[4])
    return found
