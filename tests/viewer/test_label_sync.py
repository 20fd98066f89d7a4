"""Strokes of a brush and the session's labels, with a scheduler that is moved by hand."""

from collections.abc import Callable, Sequence
from typing import Any

import dask.array
import numpy as np
import pytest
import zarr
from napari.layers import Labels
from napari.utils.colormaps import DirectLabelColormap, label_colormap

from bells import BELL, CUBE, SLAB, bells
from manual_scheduler import ManualScheduler
from napari_unpack.session import ObjectState, Session
from napari_unpack.tasks import no_progress
from napari_unpack.viewer.label_sync import QUIET_MS, LabelSync, with_sharing
from napari_unpack.viewer.slice_sync import SliceHues
from napari_unpack.viewer.view_colors import give_back, put_on


class Brush:
    """A session, and a layer of its labels that is followed; tasks wait until they are run."""

    def __init__(
        self,
        painted: Any = None,
        *,
        factor: int = 1,
        others: Sequence[Labels] = (),
        layer: Labels | None = None,
    ) -> None:
        volume, labels = bells()
        given = labels.astype(np.int32) * factor
        self.session = Session(volume, given)
        shown = given.copy() if painted is None else painted
        self.layer = Labels(shown, name="found") if layer is None else layer
        self.layer.n_edit_dimensions = 3
        self.told: list[str] = []
        self.asked: list[tuple[Any, ...]] = []
        self.hues = SliceHues(self.session, [self.layer])
        self.hues.paint()
        self.scheduler = ManualScheduler()
        self.sync = LabelSync(
            self.session,
            self.scheduler,
            with_sharing([self.layer], others),
            lambda *asked: self.asked.append(asked) or True,
            self.told.append,
            lambda: self.hues.painting,
        )

    def run(self) -> None:
        """Run what has been asked for until now, once the brush is quiet."""
        self.scheduler.finish_tasks()
        self.scheduler.advance(QUIET_MS)
        asked, self.asked[:] = list(self.asked), []
        for task, take, refused in asked:
            try:
                edited = task.run(no_progress)
            except ValueError as error:
                refused(error)
            else:
                take(edited)
        self.scheduler.finish_tasks()

    def is_in_step(self) -> bool:
        """Return whether the layer shows the session's labels."""
        given = np.array([0, *map(self.session.label_of, range(1, 1 + self.session.ids[-1]))])
        return bool(np.array_equal(given[self.session.labels], self.layer.data))


@pytest.mark.parametrize("factor", [1, 100_000])
def test_a_stroke_between_the_labels_copy_and_the_3d_view_is_an_edit(factor: int) -> None:
    painted = bells()[1].astype(np.int32) * factor
    painted[35:38, 0:3, 0:3] = CUBE * factor
    brush = Brush(painted.copy(), factor=factor)
    assert isinstance(brush.layer.colormap, DirectLabelColormap)
    before = brush.session.labels
    brush.run()
    assert np.array_equal(brush.layer.data, painted)
    assert brush.is_in_step()
    assert (brush.session.labels == CUBE).sum() == (before == CUBE).sum() + 27
    brush.layer.paint((36, 36, 60), SLAB * factor)
    brush.run()
    assert brush.session.labels[36, 36, 60] == SLAB
    brush.session.undo()
    brush.session.undo()
    assert np.array_equal(brush.session.labels, before)
    assert brush.is_in_step()
    assert brush.told == []


def test_a_layer_that_is_as_the_session_makes_no_step() -> None:
    brush = Brush()
    brush.run()
    assert not brush.session.history.done
    assert not brush.sync.pending


def test_a_stroke_on_labels_that_change_meanwhile_is_compared_again() -> None:
    brush = Brush()
    brush.run()
    brush.layer.paint((36, 2, 2), CUBE)
    brush.scheduler.advance(QUIET_MS)
    ((task, take, _),) = brush.asked
    brush.asked.clear()
    edited = task.run(no_progress)
    brush.session.delete([SLAB])
    take(edited)
    assert brush.session.labels[36, 2, 2] == 0
    assert brush.sync.pending
    brush.run()
    assert brush.session.labels[36, 2, 2] == CUBE
    assert brush.session.ids == (BELL, CUBE)
    assert brush.is_in_step()


def test_a_stroke_on_an_object_that_has_left_meanwhile_costs_no_other_stroke() -> None:
    brush, first = Brush(), bells()[1]
    brush.run()
    brush.layer.paint((38, 36, 60), SLAB)
    brush.layer.paint((8, 20, 64), SLAB)
    brush.scheduler.advance(QUIET_MS)
    ((task, take, _),) = brush.asked
    brush.asked.clear()
    edited = task.run(no_progress)
    # On whom the second was.
    brush.session.force_unpack(CUBE)
    take(edited)
    brush.run()
    wanted = first.copy()
    wanted[np.logical_and(brush.layer.data != first, first != CUBE)] = SLAB
    assert np.array_equal(brush.session.labels, wanted)
    assert brush.session.labels[38, 36, 60] == SLAB
    assert brush.session.labels[8, 20, 64] == CUBE
    assert brush.is_in_step()
    (said,) = brush.told
    assert said.endswith("The strokes on those outside are taken back, all others count.")


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda layer: layer.paint((36, 2, 2), 70_000), "got 70000"),
        (lambda layer: layer.fill((8, 20, 64), 70_000), "got 70000"),
        (lambda layer: (layer.data.fill(0), layer.refresh()), "at least one object must be left"),
    ],
    ids=["paint", "fill", "erase all"],
)
def test_what_cannot_be_taken_over_is_taken_back_and_later_strokes_and_undo_work(
    change: Callable[[Labels], Any], reason: str
) -> None:
    brush, first = Brush(), bells()[1]
    brush.run()
    change(brush.layer)
    brush.run()
    (said,) = brush.told
    assert said.startswith("What was painted is taken back: ")
    assert reason in said
    assert np.array_equal(brush.layer.data, first)
    brush.layer.paint((36, 36, 60), SLAB)
    brush.run()
    assert brush.session.labels[36, 36, 60] == SLAB
    assert brush.is_in_step()
    brush.session.undo()
    brush.hues.paint()
    brush.run()
    assert np.array_equal(brush.session.labels, first)
    assert np.array_equal(brush.layer.data, first)
    assert brush.told == [said]


def test_other_colours_are_no_stroke() -> None:
    brush = Brush()
    brush.run()
    heard: list[Any] = []
    brush.layer.events.set_data.connect(heard.append)
    # Written without a word, so that no comparison has met it yet.
    brush.layer.data[brush.layer.data == CUBE] = 0
    brush.session.select([BELL])
    brush.hues.paint()
    brush.hues.close()
    assert heard
    assert not brush.sync.pending


def test_a_colormap_that_was_chosen_meanwhile_stays_the_layers_own() -> None:
    brush = Brush()
    first, second = (label_colormap(49, seed=seed) for seed in (0.3, 0.4))
    brush.layer.colormap = first
    brush.hues.paint()
    assert brush.layer.colormap is not first
    brush.hues.paint()
    brush.hues.close()
    assert brush.layer.colormap is first
    again = SliceHues(brush.session, [brush.layer])
    again.paint()
    brush.layer.colormap = second
    again.close()
    assert brush.layer.colormap is second


def test_hues_of_a_view_chosen_meanwhile_give_way_to_the_layers_own() -> None:
    brush = Brush()
    own = brush.layer.colormap = label_colormap(49, seed=0.3)
    brush.hues.paint()
    put_on(brush.layer, label_colormap(49, seed=0.4))
    brush.hues.close()
    assert brush.layer.colormap is not own
    assert give_back(brush.layer)
    assert brush.layer.colormap is own


@pytest.mark.parametrize("first", [0, 1])
def test_a_layer_of_two_viewers_gets_its_own_colormap_back(first: int) -> None:
    brush = Brush()
    own = brush.layer.colormap = label_colormap(49, seed=0.3)
    brush.hues.paint()
    both = [brush.hues, SliceHues(brush.session, [brush.layer])]
    both[1].paint()
    both[0].paint()
    both.pop(first).close()
    both[0].paint()
    assert brush.layer.colormap is not own
    both[0].close()
    assert brush.layer.colormap is own


def test_a_layer_of_two_viewers_is_followed_by_the_session_that_had_it_first() -> None:
    first = Brush()
    second = Brush(layer=first.layer)
    assert "open in another window" in second.told[-1]
    first.run()
    second.run()
    second.session.unpack(SLAB)
    first.session.merge([CUBE, SLAB])
    first.layer.paint((36, 2, 2), BELL)
    for _ in range(3):
        first.run()
        second.run()
    assert len(first.session.ids) == 2
    assert first.session.labels[36, 2, 2] == BELL
    assert first.is_in_step()
    assert len(second.session.ids) == 3
    assert second.session.states[SLAB] is ObjectState.UNPACKED
    second.session.undo()
    second.session.merge([CUBE, BELL])
    first.run()
    assert first.is_in_step()
    assert len(first.session.ids) == 2


def test_looking_at_another_slice_is_no_stroke_that_is_not_known_yet() -> None:
    brush = Brush()
    brush.run()
    brush.layer.refresh()
    brush.layer.events.set_data()
    assert brush.sync.pending
    assert not brush.sync.has_stroke
    brush.layer.paint((36, 2, 2), BELL)
    assert brush.sync.has_stroke
    brush.run()
    assert not brush.sync.has_stroke


def test_labels_that_take_the_place_of_the_followed_are_told_once() -> None:
    brush, labels = Brush(), bells()[1].astype(np.int32)
    brush.run()
    brush.layer.data = dask.array.from_array(labels, chunks=20)
    brush.layer.paint((36, 2, 2), CUBE)
    brush.session.merge([BELL, CUBE])
    (said,) = brush.told
    assert "found changes no object, and repairs are not shown there" in said
    assert "piece by piece" in said
    brush.session.undo()
    # Back in memory it is followed as before.
    brush.layer.data = labels.copy()
    brush.layer.paint((36, 36, 60), SLAB)
    brush.run()
    assert brush.session.labels[36, 36, 60] == SLAB
    brush.layer.data = labels[:24].copy()
    brush.layer.paint((20, 2, 2), CUBE)
    brush.run()
    assert len(brush.told) == 2
    assert "its labels are 24 x 40 x 72 now and those of the objects 40 x 40 x 72" in brush.told[1]


def test_labels_of_another_shape_at_the_start_are_told() -> None:
    brush = Brush(bells()[1][:24].astype(np.int32))
    assert brush.asked == []
    (said,) = brush.told
    assert "found changes no object" in said


def test_labels_in_several_resolutions_are_left_alone() -> None:
    finest = bells()[1]
    brush = Brush([finest, finest[::2, ::2, ::2]])
    brush.session.delete([CUBE])
    brush.run()
    assert brush.asked == []
    assert brush.told == []
    assert np.array_equal(brush.layer.data[0], bells()[1])


@pytest.mark.parametrize(
    "stored",
    [
        lambda labels: dask.array.from_array(labels, chunks=20),
        lambda labels: zarr.array(labels, chunks=(20, 20, 20)),
    ],
    ids=["dask", "zarr"],
)
def test_strokes_on_labels_that_stay_on_disk_are_refused_in_words(
    stored: Callable[[np.ndarray], Any],
) -> None:
    brush = Brush(stored(bells()[1]))
    assert brush.told == []
    brush.layer.paint((12, 20, 16), CUBE)
    brush.layer.paint((12, 20, 18), CUBE)
    (said,) = brush.told
    assert "found" in said
    assert "in memory" in said
    assert not brush.sync.pending
    assert brush.asked == []
    brush.sync.close()


def test_another_time_point_and_a_flipped_view_stay_as_they_are() -> None:
    first = bells()[1].astype(np.int32)
    series = Labels(np.stack([first, np.roll(first, 3, axis=2)]))
    other, flipped = Labels(series.data[1]), Labels(series.data[0][::-1])
    brush = Brush(series.data[0], others=[series, other, flipped])
    brush.run()
    brush.session.delete([SLAB])
    brush.scheduler.finish_tasks()
    assert np.array_equal(other.data, np.roll(first, 3, axis=2))
    # Of a series that is followed as a whole all the same.
    both = with_sharing([series, Labels(series.data[0])], [series, other])
    assert other not in both
    assert flipped not in with_sharing([Labels(series.data[0])], [series, flipped])
    assert np.array_equal(flipped.data, series.data[0][::-1])


def test_a_stroke_on_the_time_series_of_a_followed_time_point_is_an_edit_at_once() -> None:
    first = bells()[1].astype(np.int32)
    series, other = Labels(np.stack([first, first])), Labels(first.copy())
    series.n_edit_dimensions = 3
    brush = Brush(series.data[1], others=[other, series])
    brush.run()
    series.paint((1, 36, 36, 60), SLAB)
    brush.run()
    assert brush.session.labels[36, 36, 60] == SLAB
    assert brush.is_in_step()
    # Of another time point, and of labels that are nobody's here.
    series.paint((0, 36, 36, 62), SLAB)
    other.paint((36, 36, 60), SLAB)
    brush.run()
    assert len(brush.session.history.done) == 1
    brush.session.undo()
    assert np.array_equal(series.data[1], first)
    assert series.data[0, 36, 36, 62] == SLAB
    assert brush.told == []


def test_sessions_of_one_array_in_two_layers_change_nothing_of_each_other() -> None:
    given = bells()[1].astype(np.int32)
    first, second = Brush(given), Brush(given)
    assert first.told == []
    (said,) = second.told
    assert "found is also that of labels that are open in another window" in said
    for brush in (first, second):
        brush.run()
    first.session.merge([BELL, CUBE])
    second.layer.paint((36, 36, 60), SLAB)
    for brush in (second, first):
        brush.run()
    assert second.session.ids == (BELL, CUBE, SLAB)
    assert second.session.labels[36, 36, 60] == SLAB
    assert first.session.labels[36, 36, 60] == 0
    assert first.is_in_step()
    assert second.is_in_step()
    # Of a session that is closed nothing can be overwritten any more.
    first.sync.close()
    third = Brush(given)
    assert third.layer.data is given
    assert third.told == []
