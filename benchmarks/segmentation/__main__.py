"""Measure segmentations of volumes nobody has tuned on: goals, ablations, and plain peers.

`python -m benchmarks.segmentation` takes twenty bags of each generator and as many scanned by rays
(seeds from 9001 on), and what is in files where they are here; peers and ablations stand for the
first five of each. Scores are kept among the temporary files, by volume, method and state of the
code, so that a run that was stopped goes on where it was. Peers on our affinities need the
dependency group `bench`.
"""

from __future__ import annotations

import argparse
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

COMPARED = 5
"""Volumes of a family that peers and ablations are measured on."""

ALIKE = {*dict(PEERS), *AFFINITY_PEERS, ours.CUTS, ours.OURS}
"""Methods that stand beside each other; the others are ours less one stage."""


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
    methods = [m for m in FINDERS if any(part in m for part in options.only)]
    tasks = [
        Task(family, (0 if family in STORED else options.first) + k, wanted)
        for family in families
        for k in range(options.count or FAMILIES[family].count)
        for wanted in (tuple(m for m in methods if _fits(m, family, k)),)
        if wanted
    ]
    reports = {family: Report() for family in families}
    # Processes of their own: threads would wait for one another in Python.
    with ProcessPoolExecutor(options.workers, mp_context=get_context("spawn")) as processes:
        jobs = [(task, processes.submit(measured, task)) for task in tasks]
        for task, job in jobs:
            _take(reports[task.family], task, job)
    measured_ones = {family: report for family, report in reports.items() if report.totals}
    parts = _overview(measured_ones)
    parts += [_text(family, report) for family, report in measured_ones.items()]
    print("\n".join(parts))
    if options.write:
        DOCUMENT.write_text("\n".join([HEAD, _explained(), *parts]))
    return 0


def _fits(method: str, family: str, place: int) -> bool:
    """Return whether a method is worth its time: cuts take minutes a volume."""
    if method == ours.OURS:
        return True
    return place < COMPARED and (method != ours.CUTS or family == "first")


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


def _overview(reports: dict[str, Report]) -> list[str]:
    parts = ["## Goals", "", markdown(against_goals(reports, ours.OURS), "volumes of"), ""]
    compared = {name: report.first(COMPARED) for name, report in reports.items()}
    less = ablations(compared, ours.OURS)
    if len(less):
        parts += ["## Ablations", "", markdown(less, "F1 / VOI"), ""]
    return parts


def _explained() -> str:
    """Return what a person wrote about the tables, which outlives their renewal."""
    text = DOCUMENT.read_text() if DOCUMENT.exists() else ""
    begin = text.find(WHY)
    end = text.find("\n## ", begin + len(WHY))
    return text[begin : end if end > 0 else None].rstrip() + "\n" if begin >= 0 else WHY + "\n"


WHY = "## What fails and why"
HEAD = """# How well segmentation does

![One slice at every stage of segmentation](gallery/bag-segmentation.png)

*The stages, which [How segmentation works](explanation/segmentation.md) explains one by one.*

`python -m benchmarks.segmentation --write` renews this page. Every peer is given our foreground and
stands with the setting that suits a family best; ours has one setting for all. Seconds are of
processor time, of one setting. Shares by kind are of objects matched at IoU > 0.5; shares by class
of objects detected with precision and recall of 50 %, sheets 20 %.
"""


def _text(family: str, report: Report) -> str:
    beside = report.first(COMPARED).of(ALIKE)
    title = f"## {FAMILIES[family].title}"
    parts = [title, "", markdown(beside.metrics(), "method"), ""]
    if family not in STORED:
        whole = report.of({ours.OURS})
        parts += [markdown(whole.by("group"), "class"), "", markdown(whole.by("kind"), "kind")]
    return "\n".join([*parts, ""])


if __name__ == "__main__":
    raise SystemExit(main())
