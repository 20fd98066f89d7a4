"""Measure segmentations of volumes nobody has tuned on: goals, ablations, and plain peers.

`python -m benchmarks.segmentation` takes twenty bags of each generator and as many scanned by rays
(seeds from 9001 on), and what is in files where they are here; peers stand for the first of each.
Ablations choose what stays, and so are measured on volumes that are for choosing. Scores are kept
among the temporary files, by volume, method and state of the code, so that a run that was stopped
goes on where it was. Peers on our affinities need the dependency group `bench`.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

from benchmarks.segmentation import ours
from benchmarks.segmentation.affinity_peers import AFFINITY_PEERS
from benchmarks.segmentation.bags import HELD_OUT, STORED
from benchmarks.segmentation.goals import FAMILIES, ablations, against_goals
from benchmarks.segmentation.keeping import FINDERS, Task, measured
from benchmarks.segmentation.peers import PEERS
from benchmarks.segmentation.report import Report, Scored, markdown

DOCUMENT = Path(__file__).parents[2] / "docs" / "segmentation.md"

ABLATED_COUNT = 5
"""Volumes of a family that ours without a stage is measured on."""

ABLATED = {"first": 1600, "second": 8600, "projection": 1600}
"""Seeds of the first volumes that ablations are measured on; of those in files their place is 0."""

ALIKE = (*dict(PEERS), *AFFINITY_PEERS, ours.CUTS, ours.OURS)
"""Methods that stand beside each other."""

ABLATIONS = (ours.OURS, *(m for m in FINDERS if m not in ALIKE))
"""Ours, and ours less one stage."""


def main(arguments: list[str] | None = None) -> int:
    """Measure and print; return the exit status."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.segmentation", description=__doc__)
    parser.add_argument("families", nargs="*", help=f"of {', '.join(FAMILIES)}; by default all")
    parser.add_argument("--count", type=int, help="volumes of each family")
    parser.add_argument("--first", type=int, default=HELD_OUT, help="seed of the first bag")
    parser.add_argument("--only", nargs="+", default=[""], help="parts of methods' names")
    parser.add_argument("--workers", type=int, default=2, help="volumes measured at once")
    parser.add_argument("--write", action="store_true", help=f"also write {DOCUMENT.name}")
    options = parser.parse_args(arguments)
    families = options.families or list(FAMILIES)
    for family in families:
        if family not in FAMILIES:
            parser.error(f"no family is called {family!r}; there are {', '.join(FAMILIES)}")
    whole, ablated = ({family: Report() for family in families} for _ in range(2))
    few = min(ABLATED_COUNT, options.count or ABLATED_COUNT)
    wanted = [m for m in FINDERS if any(part in m for part in options.only)]
    # Processes of their own: threads would wait for one another in Python.
    with ProcessPoolExecutor(options.workers, mp_context=get_context("spawn")) as processes:
        jobs = [
            (reports, task, processes.submit(measured, task))
            for family in families
            for reports, first, count, methods in (
                (whole, options.first, options.count or FAMILIES[family].count, ALIKE),
                (ablated, ABLATED.get(family, 0), few, ABLATIONS),
            )
            for task in _tasks(family, first, count, [m for m in methods if m in wanted])
        ]
        for reports, task, job in jobs:
            _take(reports[task.family], task, job)
    parts = _overview(whole, ablated, options.first, few)
    parts += [_text(family, report) for family, report in whole.items() if report.totals]
    print("\n".join(parts))
    if options.write:
        DOCUMENT.write_text("\n".join([HEAD, *_explained(), *parts]))
    return 0


def _tasks(family: str, first: int, count: int, methods: list[str]) -> Iterator[Task]:
    """Yield what is measured of a family, volume by volume."""
    stored = STORED.get(family, ())
    for place in range(min(count, len(stored)) if stored else count):
        worth = [m for m in methods if _fits(m, family, place)]
        if worth:
            yield Task(family, place if stored else first + place, tuple(worth))


def _fits(method: str, family: str, place: int) -> bool:
    """Return whether a method is worth its time: cuts and large volumes take minutes."""
    if method in ABLATIONS:
        return True
    return place < FAMILIES[family].compared and (method != ours.CUTS or family == "first")


def _take(report: Report, task: Task, job: Future[list[tuple[str, Scored, bool]]]) -> None:
    try:
        found = job.result()
    except FileNotFoundError as error:
        print(f"{FAMILIES[task.family].title}: skipped, {error}\n")
        return
    for method, scores, kept in found:
        report.add(scores)
        for row in scores.totals if not kept else []:
            numbers = f"F1 {row['f1']:.2f} VOI {row['voi']:.2f} {row['seconds']:.0f} s"
            print(f"{task.family} {task.seed} {method}: {row['setting']} {numbers}", flush=True)


def _overview(
    whole: dict[str, Report], ablated: dict[str, Report], first: int, few: int
) -> list[str]:
    reached = {family: report for family, report in whole.items() if report.totals}
    unseen = f"Means of seeds from {first}, by which nothing was chosen, and of what is in files"
    seen = (
        f"{unseen}: the bags of the public simulator were looked at when choosing. Coins, which "
        "lie on each other in pouches, need not be found; beside F1 stands what it is if those "
        "that were not found are left out."
    )
    goals = markdown(against_goals(reached, ours.OURS), "volumes of")
    parts = ["## Goals", "", seen, "", goals, ""]
    less = ablations({f: r for f, r in ablated.items() if r.totals}, ours.OURS)
    if len(less):
        seeds = ", ".join(str(first) for first in ABLATED.values())
        volumes = f"{few} volumes of a family (seeds from {seeds})"
        told = f"F1 / VOI without one stage, on {volumes}."
        parts += ["## Ablations", "", told, "", markdown(less, "without"), ""]
    return parts


def _explained() -> list[str]:
    """Return what is in the page and not measured here, which outlives its renewal."""
    sections = DOCUMENT.read_text().split("\n## ") if DOCUMENT.exists() else []
    told = {f"## {text.partition(chr(10))[0]}": f"## {text.rstrip()}\n" for text in sections}
    return [told.get(title, f"{title}\n") for title in TOLD]


TOLD = ("## Families left out", "## What fails and why")
"""Sections that a person writes, or `left_out` prints."""

HEAD = """# How well segmentation does

![One slice at every stage of segmentation](gallery/bag-segmentation.png)

*The stages, which [How segmentation works](explanation/segmentation.md) explains one by one.*

`python -m benchmarks.segmentation --write` renews this page. Every peer is given our foreground and
stands with the setting that suits a family best; ours has one setting for all. Peers stand for one
volume of a family. Seconds are of processor time, of one setting. Shares by kind are of objects
matched at IoU > 0.5; shares by class of objects detected with precision and recall of 50 %, sheets
20 %.
"""


def _text(family: str, report: Report) -> str:
    beside = report.first(FAMILIES[family].compared or FAMILIES[family].count)
    title = f"## {FAMILIES[family].title}"
    parts = [title, "", markdown(beside.metrics(), "method"), ""]
    if family not in STORED:
        own = report.of({ours.OURS})
        parts += [markdown(own.by("group"), "class"), "", markdown(own.by("kind"), "kind")]
    return "\n".join([*parts, ""])


if __name__ == "__main__":
    raise SystemExit(main())
