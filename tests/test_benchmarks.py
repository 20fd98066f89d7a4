"""The benchmarks can be told what to measure, and their table can be read."""

import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

sys.path.insert(0, str(Path(__file__).parents[1]))

from benchmarks import plots, table
from benchmarks.__main__ import main
from benchmarks.packing import pack
from benchmarks.row import Row, ms
from benchmarks.rows import ORDER, chosen
from benchmarks.segmentation import affinity_peers, keeping, ours
from benchmarks.segmentation.bags import Case
from benchmarks.segmentation.goals import ablations, against_goals
from benchmarks.segmentation.report import Report, markdown, scored

from napari_unpack.segmentation.learned import method


def test_every_row_can_be_chosen_by_a_part_of_its_name() -> None:
    assert [name for name, _ in chosen([])] == list(ORDER)
    assert [name for name, _ in chosen(["tinted", "gpu"])] == ["tinted_cpu", "tinted_gl", "gpu"]
    files = Path(__file__).parents[1] / "benchmarks" / "rows"
    assert {p.stem for p in files.glob("*.py")} == {*ORDER, "__init__"}


def test_an_unknown_row_is_named(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["teapot"])
    assert "no row is called 'teapot'; there are tinted_cpu" in capsys.readouterr().err


def test_the_table_prints_a_measured_row(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["recolouring", "--quick"]) == 0
    out = capsys.readouterr().out
    assert "QUICK" in out
    assert "recolouring 200 objects" in out
    assert "networkx" in out


def test_long_cells_wrap_and_times_are_rounded() -> None:
    text = table.text(Row("what", "word " * 20, "1 ms", met=True))
    assert len(text.splitlines()) > 1
    assert text.splitlines()[0].endswith("met")
    assert [ms(0.1234), ms(12.3), ms(1234)] == ["0.12 ms", "12 ms", "1.23 s"]
    assert "| 1 ms |" in table.markdown([Row("a", "b", "1 ms")])


def test_a_packing_has_as_many_objects_as_cells() -> None:
    packing = pack((24, 24, 36), (2, 2, 3))
    assert list(np.unique(packing.labels)) == list(range(13))
    assert packing.volume[packing.labels == 0].max() < 200
    assert packing.volume[packing.labels > 0].min() > 600
    assert 0.25 < (packing.labels > 0).mean() < 0.5


def test_the_plot_marks_every_step_at_which_the_queue_was_asked() -> None:
    rows = [
        {"asked": a, "occlusion_ms": t, "interference_ms": "3"}
        for a, t in (("1", "9"), ("0", "8"), ("1", "7"))
    ]
    assert plots.svg(rows).count("<circle") == 2


def test_the_segmentation_report_takes_each_method_at_its_best_setting() -> None:
    labels = np.repeat([1, 2, 3, 4], 4).reshape(1, 1, -1)
    kinds = pd.Series(["box", "box", "rod", "rod"], index=[1, 2, 3, 4])
    case = Case("one", labels, labels, (1.0, 1.0, 1.0), kinds, kinds)
    report = Report()
    report.add(scored("cut", "cut fine", case, np.arange(16).reshape(1, 1, -1), 1.0))
    report.add(scored("cut", "cut coarse", case, np.minimum(labels, 3), 2.0))
    report.add(scored("truth", "truth", case, labels, 3.0))
    assert report.best() == {"cut": "cut coarse", "truth": "truth"}
    assert report.metrics().loc["cut coarse", "f1"] == pytest.approx(2 * 2 / 7)
    assert report.metrics().loc["truth", "seconds"] == 3.0
    by_kind = report.by("kind")
    assert by_kind.loc["rod"].tolist() == [2, 0.0, 1.0]
    assert by_kind.loc["box"].tolist() == [2, 1.0, 1.0]
    assert "| rod | 2 | 0.00 | 1.00 |" in markdown(by_kind, "kind")


def test_every_goal_stands_beside_what_is_reached() -> None:
    labels = np.repeat([1, 2, 3, 4], 4).reshape(1, 1, -1)
    groups = pd.Series(["metal", "metal", "bulk", "bulk"], index=[1, 2, 3, 4])
    case = Case("one", labels, labels, (1.0, 1.0, 1.0), groups, groups)
    # Both of metal and one of the others as one: one of two found is right, of four that there are.
    found = scored("ours", "ours", case, np.maximum(labels, 3), 3.0)
    less = scored("without borders", "without borders", case, np.ones_like(labels), 2.0)
    report = Report()
    report.add(found)
    report.add(less)
    row = against_goals({"projection": report}, "ours").loc["Bags scanned by rays"]
    assert row["F1"] == "0.33 (goal 0.85, missed)"
    assert row["VOI"] == "1.19 (goal 0.30, missed)"
    assert row["metal found"] == "0.00 (goal 0.70, missed)"
    assert row["volumes"] == 1
    table = ablations({"projection": report}, "ours")
    assert table.index.tolist() == ["borders"]
    assert table["Bags scanned by rays"].tolist() == ["-0.333 / +0.811"]
    assert "| 1 | 0.33 (goal" in markdown(against_goals({"projection": report}, "ours"), "family")


def test_coins_that_were_not_found_are_excused_and_nothing_else() -> None:
    labels = np.repeat([1, 2, 3, 4], 4).reshape(1, 1, -1)
    kinds = pd.Series(["coin", "coin", "box", "box"], index=[1, 2, 3, 4])

    def reached(*found: list[int]) -> str:
        report = Report()
        for n, names in enumerate(found):
            case = Case(str(n), labels, labels, (1.0, 1.0, 1.0), kinds, kinds)
            report.add(scored("ours", "ours", case, np.array(names)[labels], 3.0))
        table = against_goals({"first": report}, "ours")
        return str(table.loc["Bags of the package's generator", "F1, coins excused"])

    coins_as_one, boxes_as_one, nothing = [0, 1, 1, 3, 4], [0, 1, 2, 3, 3], [0] * 5
    # Two of three found are right, of the two true ones that are left, or of all four.
    assert reached(coins_as_one) == "0.80"
    assert reached(boxes_as_one) == "0.57"
    assert reached(nothing) == "0.00"
    assert reached(coins_as_one, boxes_as_one) == "0.69"


def test_what_is_to_be_ignored_costs_nothing() -> None:
    truth = np.repeat([1, 0, 0], 4).reshape(1, 1, -1)
    kinds = pd.Series(["box"], index=[1])
    found = np.repeat([1, 2, 0], 4).reshape(1, 1, -1)
    case = Case("one", truth, truth, (1.0, 1.0, 1.0), kinds, kinds, found == 2)
    assert scored("a", "a", case, found, 1.0).totals[0]["f1"] == 1.0


def test_a_stage_is_out_while_it_is_measured_and_back_after(monkeypatch) -> None:
    seen = []
    monkeypatch.setattr(ours, "segment", lambda volume, spacing: pytest.fail("nothing asked"))
    for name, stage in ours.STAGES.items():
        before = getattr(stage.module, stage.name)

        def segmented(volume, spacing, stage=stage):
            seen.append(getattr(stage.module, stage.name) is stage.instead)
            return ours.pipeline.Segmentation(volume, pd.DataFrame())

        monkeypatch.setattr(ours, "segment", segmented)
        assert [setting for setting, _ in ours.without(name, np.ones(3), None)] == [
            f"without {name}"
        ]
        assert getattr(stage.module, stage.name) is before
    assert seen == [True] * len(ours.STAGES)


def test_scores_are_kept_and_not_measured_again(monkeypatch, tmp_path) -> None:
    labels = np.repeat([1, 2], 8).reshape(1, 1, -1)
    kinds = pd.Series(["box", "rod"], index=[1, 2])
    case = Case("one", labels, labels, (1.0, 1.0, 1.0), kinds, kinds)
    asked = []

    def finder(volume, spacing):
        asked.append(1)
        yield "truth", labels

    monkeypatch.setattr(keeping, "KEPT", tmp_path / "kept")
    monkeypatch.setattr(keeping, "FINDERS", {"truth": finder, "none": lambda v, s: iter(())})
    monkeypatch.setattr(keeping, "cases", lambda *where: iter([case]))
    task = keeping.Task("first", 1, ("truth", "none"))
    first, second = keeping.measured(task), keeping.measured(task)
    assert len(asked) == 1
    assert [kept for _, _, kept in first + second] == [False, False, True, True]
    assert first[0][1].totals == second[0][1].totals
    pd.testing.assert_frame_equal(first[0][1].objects, second[0][1].objects, check_names=False)
    assert first[1][1].totals == second[1][1].totals == []


def test_peers_on_the_affinities_have_no_classifier_after_them(monkeypatch) -> None:
    volume = np.zeros((32, 36, 40), np.uint16)
    volume[4:28, 6:30, 4:18], volume[4:28, 6:30, 20:36] = 900, 1400
    monkeypatch.setattr(method, "merge_parts", lambda *_, **__: pytest.fail("parts were merged"))
    linked = []
    kept = method.mean_affinity_linkage

    def linkage(affinities, sizes, threshold, *more, **named):
        linked.append(threshold.at(1000))
        return kept(affinities, sizes, threshold, *more, **named)

    monkeypatch.setattr(method, "mean_affinity_linkage", linkage)
    found = dict(affinity_peers.ours(volume, (1.0, 1.0, 1.0)))
    assert list(found) == [f"linkage alone {bar:g}" for bar in affinity_peers.BARS]
    # Each at its own bar.
    assert linked == list(affinity_peers.BARS)
    assert all(labels.max() >= 2 for labels in found.values())
