"""Step 1: from a volume, or a volume and its labels, to a session on the stage."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

from napari.layers import Image, Labels

from napari_unpack.session.errors import listed
from napari_unpack.tasks import Progress, TaskResult
from napari_unpack.widgets import notifications
from napari_unpack.widgets.contributions import LayerData, packed_bag
from napari_unpack.widgets.layer_inputs import (
    LayerInput,
    Volume,
    is_users,
    labels_of,
    names_of,
    plain,
    same_shape,
    volume_of,
)
from napari_unpack.widgets.preferences import preferences
from napari_unpack.widgets.section import Section, button, form
from napari_unpack.widgets.segment_options import SegmentOptions
from napari_unpack.widgets.session_builder import Prepared, prepare
from napari_unpack.widgets.task_progress import TaskProgress
from napari_unpack.widgets.workspace import Workspace

FIND = "Find the objects"


@dataclass(frozen=True, eq=False)
class _Order:
    image: Any
    labels: Any
    volume: Volume


class SegmentSection(Section):
    """Choose a volume, and labels if there are any, and begin.

    Parameters
    ----------
    workspace : Workspace
    """

    def __init__(self, workspace: Workspace) -> None:
        super().__init__("1", "Segment")
        self._workspace = workspace
        self._order: _Order | None = None
        self._labels_alone = False
        self._then: Callable[[], None] | None = None
        viewer = workspace.viewer
        self.volume_box = LayerInput(viewer, self._is_source, prefers=_is_volume)
        self.volume_box.setToolTip(
            "The volume to unpack: any 3D Image layer, or Labels that have none."
        )
        self.labels_box = LayerInput(viewer, self._fits, none=FIND)
        self.labels_box.setToolTip(
            "Labels you already have, of the same shape; otherwise the objects are found."
        )
        self.start = button("Segment", "", primary=True)
        self.sample = button(
            "Try a simulated bag", "Add a small packed bag with known objects to the viewer."
        )
        self.waiting = TaskProgress(
            workspace.scheduler, "Stop the work; nothing that is open changes."
        )
        self.options = SegmentOptions()
        self._arrange()

        self.start.clicked.connect(lambda: self.run())
        self.sample.clicked.connect(self._add_sample)
        self.waiting.ended.connect(self._finish)
        self.volume_box.chosen.connect(self._choose_volume)
        self.labels_box.chosen.connect(self._refresh)
        workspace.staged.connect(self._refresh)
        workspace.staged.connect(lambda: self.fold.setChecked(workspace.controller is not None))
        workspace.changed.connect(lambda news: self._refresh() if "labels" in news else None)
        viewer.layers.selection.events.active.connect(self._follow_selection)
        self._refresh()

    def _arrange(self) -> None:
        self.contents.addLayout(form(Volume=self.volume_box, Objects=self.labels_box))
        self.contents.addWidget(self.start)
        self.contents.addWidget(self.sample)
        self.contents.addWidget(self.options)
        self.contents.addWidget(self.waiting)

    def _fits(self, layer: Any) -> bool:
        image = self.volume_box.layer
        return (
            isinstance(layer, Labels)
            and is_users(layer)
            and image is not None
            and same_shape(image, layer)
        )

    def _is_source(self, layer: Any) -> bool:
        if not isinstance(layer, Labels):
            return _is_image(layer)
        images = (plain(each) for each in self._workspace.viewer.layers)
        return (
            is_users(layer)
            and layer.ndim == 3
            and not any(isinstance(each, Image) and same_shape(each, layer) for each in images)
        )

    def _choose_volume(self) -> None:
        self.labels_box.refresh()
        was_alone, self._labels_alone = self._labels_alone, _is_labels(self.volume_box.layer)
        if was_alone or self._labels_alone:
            self.labels_box.choose(self.volume_box.layer if self._labels_alone else None)
        self._refresh()

    def _follow_selection(self, _event: Any = None) -> None:
        """Take up the layer the user selects in the list, if it is one of ours to choose from."""
        layer = plain(self._workspace.viewer.layers.selection.active)
        if layer is None or self._order is not None or not is_users(layer) or not layer.visible:
            return
        if self._fits(layer):
            self.labels_box.choose(layer)
        elif self._is_source(layer) and _is_volume(layer):
            self.volume_box.choose(layer)

    def _refresh(self) -> None:
        chosen = self.labels_box.layer
        self.start.setText("Segment" if chosen is None else "Unpack these labels")
        self.start.setToolTip(
            "Find the objects in the volume and put them on the stage."
            if chosen is None
            else "Put the volume on the stage with the labels chosen above."
        )
        image = self.volume_box.layer
        self.start.setEnabled(image is not None and not self.waiting.running)
        self.sample.setVisible(image is None or not _is_volume(image))
        self.sample.setEnabled(not self.waiting.running)
        self.options.setVisible(image is not None and chosen is None and not self.waiting.running)
        for field in (self.volume_box, self.labels_box):
            field.setEnabled(image is not None and not self.waiting.running)
        session = self._workspace.session
        count = 0 if session is None else len(session.boxes.ids)
        objects = "1 object" if count == 1 else f"{count} objects"
        self.set_status("" if session is None else objects)
        self.lock(None)

    def run(self, then: Callable[[], None] | None = None) -> None:
        """Do what the button says, with the layers chosen.

        Parameters
        ----------
        then : callable, optional
            Called with nothing once the stage is open.
        """
        if self.waiting.running:
            return
        image = self.volume_box.layer
        if image is None:
            notifications.inform("Open a 3D volume first, or press Try a simulated bag.")
            return
        with notifications.spoken():
            volume = volume_of(image)
            layer = self.labels_box.layer
            labels = None if layer is None else labels_of(layer, volume)
            self._order = _Order(image, layer, volume)
            self._then = then
            self._say_alone(image)
            names = {} if layer is None else names_of(layer)
            self._begin(partial(prepare, volume, labels, names, self.options.settings()))

    def _say_alone(self, layer: Any) -> None:
        """Say why no volume is shown where one is there, but of another shape than the labels."""
        others = [plain(each) for each in self._workspace.viewer.layers]
        volumes = [each.name for each in others if _is_image(each) and _is_volume(each)]
        if _is_labels(layer) and volumes:
            notifications.inform(
                f"{layer.name!r} has another shape than {listed(map(repr, volumes))}: its objects "
                "are shown without a volume."
            )

    def _begin(self, work: Callable[[Progress], Any]) -> None:
        self.waiting.begin(work)
        self._refresh()

    def _finish(self, outcome: TaskResult[Any]) -> None:
        try:
            if not outcome.cancelled:
                with notifications.spoken():
                    self._conclude(outcome.get())
        finally:
            self._order = None
            self._refresh()

    def _conclude(self, result: Any) -> None:
        if self._order is None:
            self._show_layers(result)
            return
        self._put_on_controller(self._order, result)
        if self._then is not None:
            self._then()

    def _put_on_controller(self, order: _Order, prepared: Prepared) -> None:
        # A stage that is on hides the image: what it found before comes and goes with it.
        self._workspace.close()
        labels = order.labels
        if prepared.found is not None:
            image = order.image
            labels = plain(
                self._workspace.viewer.add_labels(
                    prepared.found,
                    name=f"{image.name} objects",
                    scale=image.scale,
                    translate=image.translate,
                    rotate=image.rotate,
                    shear=image.shear,
                    affine=image.affine,
                    units=image.units,
                    visible=image.visible,
                )
            )
        liked = preferences()
        prepared.session.backend = liked.backend
        prepared.session.take_least_occluded = liked.take_least_blocked
        self._workspace.open(
            prepared.session,
            sources=tuple(dict.fromkeys((order.image, labels))),
            seconds=liked.seconds,
            backend=liked.backend,
            recolor_at_rest=liked.recolor_at_rest,
        )

    def _add_sample(self) -> None:
        if not self.waiting.running:
            self._begin(lambda progress: packed_bag(progress=progress))

    def _show_layers(self, layers: list[LayerData]) -> None:
        for data, settings, kind in layers:
            getattr(self._workspace.viewer, f"add_{kind}")(data, **settings)

    def end(self) -> None:
        """Stop all work and all listening, for good."""
        self.waiting.stop()
        self._workspace.viewer.layers.selection.events.active.disconnect(self._follow_selection)
        self.volume_box.close_links()
        self.labels_box.close_links()


def _is_image(layer: Any) -> bool:
    return isinstance(layer, Image) and is_users(layer)


def _is_labels(layer: Any) -> bool:
    return isinstance(layer, Labels)


def _is_volume(layer: Any) -> bool:
    return _is_labels(layer) or (_is_image(layer) and layer.ndim == 3 and not layer.rgb)
