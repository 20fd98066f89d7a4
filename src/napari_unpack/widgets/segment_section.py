"""Step 1: from a volume, or a volume and its labels, to a session in the 3D view."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from time import monotonic
from typing import TYPE_CHECKING, Any, TypeGuard
from weakref import WeakKeyDictionary

import numpy as np
from napari.layers import Image, Labels, Layer

from napari_unpack.geometry.length_unit import LengthUnit
from napari_unpack.io.file_data import FileData
from napari_unpack.io.labels_on_volume import laid_over
from napari_unpack.layers.compat import clash_told, unwrap
from napari_unpack.layers.levels import place_of_level
from napari_unpack.layers.placement import (
    assumed_of,
    equal_spacing,
    place_of,
    scanner_from_scan,
    set_spacing,
    spacing_of,
    was_turned,
)
from napari_unpack.session.errors import listed
from napari_unpack.tasks import Progress, TaskResult
from napari_unpack.widgets import notifications
from napari_unpack.widgets.contributions import packed_bag
from napari_unpack.widgets.index_chooser import IndexChooser
from napari_unpack.widgets.large_files import LayerData
from napari_unpack.widgets.layer_inputs import (
    LayerInput,
    Volume,
    is_users,
    labels_of,
    misfit,
    names_of,
    refusal_of,
    volume_of,
    whole_labels_of,
)
from napari_unpack.widgets.preferences import preferences
from napari_unpack.widgets.section import Section, button, form
from napari_unpack.widgets.segment_options import SegmentOptions
from napari_unpack.widgets.session_builder import BuiltSession, build
from napari_unpack.widgets.task_progress import TaskProgress
from napari_unpack.widgets.unsaved_work import UnsavedWork
from napari_unpack.widgets.voxel_size import VoxelSize
from napari_unpack.widgets.workspace import Change, Workspace

if TYPE_CHECKING:
    from napari.utils.events import Event

FIND = "Find the objects"


@dataclass(frozen=True, eq=False)
class _Order:
    """The layers of a segmentation, and which of their time points or channels it is of."""

    image: Layer
    labels: Labels | None
    volume: Volume
    index: tuple[int, ...]
    unit: LengthUnit

    @property
    def place(self) -> dict[str, Any]:
        """Where its objects stand, as arguments of a 3D layer."""
        layer = self.image if self.labels is None else self.labels
        if self.volume.whole is None:
            return place_of(layer)
        return place_of_level(self.image, self.volume.factors)


class SegmentSection(Section):
    """Choose a volume, and labels if there are any, and begin.

    Parameters
    ----------
    workspace : Workspace
    unsaved : UnsavedWork
        Asked before other objects take the place of those that are shown.
    """

    def __init__(self, workspace: Workspace, unsaved: UnsavedWork) -> None:
        super().__init__("1", "Segment")
        self._workspace, self._unsaved = workspace, unsaved
        self._begun = 0.0
        self._order: _Order | None = None
        # Of each layer, the time point or channel that was unpacked last.
        self._unpacked: WeakKeyDictionary[Layer, tuple[int, ...]] = WeakKeyDictionary()
        self._labels_alone = False
        self._then: Callable[[], None] | None = None
        viewer = workspace.viewer
        self.volume_input = LayerInput(
            viewer, self._is_source, prefers=_is_image, refusal=refusal_of
        )
        self.volume_input.setToolTip(
            "The volume to unpack: any 3D Image layer, or Labels without one."
        )
        self.volume_input.setPlaceholderText("No volume yet")
        self.index = IndexChooser()
        self.voxels = VoxelSize()
        self.labels_input = LayerInput(viewer, _is_users_labels, none=FIND, refusal=self._misfit)
        self.labels_input.setToolTip(
            "Labels that you have already, of the same shape; without them the volume is segmented."
        )
        # Beside it is the step of that name, with its table.
        self.labels_input.setAccessibleName("Labels of the objects")
        self.start = button("Segment", "", primary=True)
        self.sample = button(
            "Try a simulated bag", "Add a small packed bag with known objects to the viewer."
        )
        self.rescale = button(
            "Use the new voxel size",
            "Show the objects anew, with the voxel size that their layer has now.",
        )
        self.progress = TaskProgress(
            workspace.scheduler, "Stop the work; nothing that is open changes.", "Segment"
        )
        self.options = SegmentOptions()
        self.contents.addLayout(form(Volume=self.volume_input))
        self.contents.addWidget(self.index)
        self.contents.addLayout(form(Voxels=self.voxels, Objects=self.labels_input))
        for widget in (self.start, self.rescale, self.sample, self.options, self.progress):
            self.contents.addWidget(widget)

        self.start.clicked.connect(lambda: self.run())
        self.sample.clicked.connect(self._add_sample)
        self.rescale.clicked.connect(self._use_new_size)
        self.progress.ended.connect(self._finish)
        self.volume_input.chosen.connect(self._choose_volume)
        self.volume_input.listed.connect(self._show_voxels)
        self.volume_input.listed.connect(self._refresh)
        self.voxels.chosen.connect(self._measure_in)
        self.voxels.typed.connect(self._resize_voxels)
        self.voxels.shown.connect(self.options.show_unit)
        self.labels_input.chosen.connect(self._refresh)
        workspace.switched.connect(self._reload)
        workspace.changed.connect(lambda c: self._refresh() if Change.LABELS in c else None)
        viewer.layers.selection.events.active.connect(self._follow_selection)
        # What was in the viewer before the panel counts as if it came now.
        self._choose_volume()
        self._follow_selection()

    def _misfit(self, layer: Layer) -> str:
        image = self.volume_input.layer
        return "no volume" if image is None else misfit(image, layer)

    def _images_of(self, labels: Layer) -> list[Layer]:
        """Return the images that labels may belong to."""
        images = [unwrap(each) for each in self._workspace.viewer.layers if _is_image(each)]
        return [each for each in images if not refusal_of(each) and not misfit(each, labels)]

    def _is_source(self, layer: Layer) -> bool:
        if _is_users_labels(layer):
            return not self._images_of(layer)
        return _is_image(layer)

    def _choose_volume(self) -> None:
        layer = self.volume_input.layer
        self.index.show_axes(layer, self._workspace.viewer)
        self._show_voxels()
        # Which labels fit depends on the volume.
        self.labels_input.refresh()
        was_alone, self._labels_alone = self._labels_alone, _is_labels(layer)
        if was_alone or self._labels_alone:
            self.labels_input.choose(layer if self._labels_alone else None)
        self._refresh()

    def _follow_selection(self, _event: Event | None = None) -> None:
        """Choose the layer that the user selects in the layer list, if it can be chosen here."""
        layer = unwrap(self._workspace.viewer.layers.selection.active)
        # During a segmentation the inputs must stay as they were at its start.
        if layer is None or self._order is not None or not is_users(layer) or not layer.visible:
            return
        images = self._images_of(layer) if _is_labels(layer) else []
        if images:
            chosen = self.volume_input.layer
            self.volume_input.choose(chosen if chosen in images else images[0])
            self.labels_input.choose(layer)
        elif self._is_source(layer) and not refusal_of(layer):
            self.volume_input.choose(layer)

    def _reload(self) -> None:
        controller = self._workspace.controller
        # The step is done and makes room for the next; without a session it opens again.
        self.fold.setChecked(controller is not None)
        if controller is not None:
            controller.events.rescaled.connect(self._offer_new_size)
            # A session from a file brings layers of its own.
            if self._order is None and controller.sources:
                self.volume_input.choose(controller.sources[0])
        self._show_voxels()
        self._refresh()

    def _show_voxels(self) -> None:
        """Show the chosen volume's voxel size, in the unit of its session if it has one."""
        layer, controller = self.volume_input.layer, self._workspace.controller
        if layer is None:
            return
        if controller is not None and layer in controller.sources:
            self.voxels.show_layer(layer, controller.session.length_unit)
        else:
            self.voxels.show_layer(layer)

    def _measure_in(self, unit: LengthUnit) -> None:
        controller = self._workspace.controller
        if controller is not None and self.volume_input.layer in controller.sources:
            controller.session.length_unit = unit

    def _resize_voxels(self, spacing: tuple[float, float, float]) -> None:
        """Give the chosen volume, and the labels that lie on it, voxels of another size."""
        volume = self.volume_input.layer
        if volume is None:
            return
        before = spacing_of(volume)
        layers = [unwrap(each) for each in self._workspace.viewer.layers]
        on_it = [
            each
            for each in filter(_is_users_labels, layers)
            if not misfit(volume, each) and equal_spacing(spacing_of(each), before)
        ]
        for layer in dict.fromkeys((volume, *on_it)):
            set_spacing(layer, spacing)

    def _offer_new_size(self) -> None:
        self.fold.setChecked(False)
        self._refresh()

    def _use_new_size(self) -> None:
        """Open the labels of the session anew, under the names they have."""
        controller = self._workspace.controller
        if controller is None:
            return
        session, (volume, *labels) = controller.session, controller.sources
        objects = session.objects["name"]
        names = {session.label_of(i): str(objects[i]) for i in session.ids}
        self.volume_input.choose(volume)
        self.labels_input.choose(labels[0] if labels else volume)
        # The field beside is that of the next segmentation.
        self.run(names=names, index=self._unpacked.get(volume))

    def _refresh(self) -> None:
        image, labels = self.volume_input.layer, self.labels_input.layer
        idle = not self.progress.running
        self.start.setText("Segment" if labels is None else "Unpack these labels")
        self.start.setToolTip(
            "Find the objects in the volume and show them in the 3D view."
            if labels is None
            else "Show the volume in the 3D view with the labels chosen above."
        )
        self.start.setEnabled(image is not None and idle)
        # Offered only where there is nothing else to begin with.
        self.sample.setVisible(image is None)
        self.sample.setEnabled(idle)
        self.options.setVisible(image is not None and labels is None and idle)
        self.volume_input.setEnabled(image is not None and idle)
        self.index.setEnabled(idle)
        self.voxels.setEnabled(image is not None)
        self.voxels.size.setEnabled(idle)
        # Labels without a volume have no densities to find other objects by.
        self.labels_input.setEnabled(image is not None and idle and not _is_labels(image))
        self.rescale.setVisible(idle and self._has_other_size())
        session = self._workspace.session
        count = 0 if session is None else len(session.boxes.ids)
        objects = "1 object" if count == 1 else f"{count} objects"
        self.set_status("" if session is None else objects)
        self.lock(None)

    def _has_other_size(self) -> bool:
        controller = self._workspace.controller
        # The contents of an object are measured with the whole bag.
        if controller is None or self._workspace.is_inside or not controller.sources:
            return False
        source = controller.sources[0]
        # Its data may have become a picture, which has no voxels.
        if source.ndim < 3:
            return False
        return not equal_spacing(spacing_of(source), controller.session.spacing)

    def run(
        self,
        then: Callable[[], None] | None = None,
        names: Mapping[int, str] | None = None,
        index: tuple[int, ...] | None = None,
    ) -> None:
        """Segment the chosen volume, or take the chosen labels.

        Parameters
        ----------
        then : callable, optional
            Called with nothing once the session is shown.
        names : mapping of int to str, optional
            Of objects of the chosen labels, by ID; by default those of the layer.
        index : tuple of int, optional
            Of each axis beside z, y and x; by default the chosen one.
        """
        # Before the work, so that nobody waits to be asked.
        work = partial(self._try, then, names, index)
        self._unsaved.ask("Other objects will take its place.", partial(self._run, work))

    def _run(self, work: Callable[[], None]) -> None:
        if not self.progress.running:
            work()
        if not self.progress.running:
            self._unsaved.take_back()

    def _try(
        self,
        then: Callable[[], None] | None,
        names: Mapping[int, str] | None,
        index: tuple[int, ...] | None,
    ) -> None:
        image, labels = self.volume_input.layer, self.labels_input.layer
        if image is None:
            notifications.inform("Open a 3D volume first, or press Try a simulated bag.")
            return
        with notifications.errors_shown():
            index = self.index.index if index is None else index
            volume = volume_of(image, index)
            ids = whole = None
            if _is_labels(labels):
                ids, names = labels_of(labels, volume, index), names or names_of(labels)
                whole = whole_labels_of(labels, volume, index)
                self._explain_other_place(image, labels, volume)
            own = labels if _is_labels(labels) else None
            order = _Order(image, own, volume, index, self.voxels.unit)
            settings = self.options.settings()
            self._order, self._then, self._begun = order, then, monotonic()
            self._explain_missing_volume(image)
            self._begin(partial(build, volume, ids, names or {}, settings, whole_labels=whole))

    def _explain_missing_volume(self, layer: Layer) -> None:
        """Say why labels are shown without a volume although the viewer has one."""
        others = [unwrap(each) for each in self._workspace.viewer.layers]
        volumes = [each.name for each in others if _is_image(each) and not refusal_of(each)]
        if _is_labels(layer) and volumes:
            notifications.inform(
                f"{layer.name!r} has another shape than {listed(map(repr, volumes))}: its objects "
                "are shown without a volume."
            )

    def _explain_other_place(self, image: Layer, labels: Labels, volume: Volume) -> None:
        """Say where files do not have the labels as they lie on the image here."""
        # No voxels are read. One voxel size for both: a person may have set that of the image.
        there = FileData(
            np.broadcast_to(np.uint8(0), volume.data.shape),
            spacing=volume.spacing,
            scanner_from_scan=scanner_from_scan(image),
            turned=bool(was_turned(image)),
        )
        turned = was_turned(labels)
        own = replace(
            there,
            labels=there.volume,
            scanner_from_scan=scanner_from_scan(labels),
            # What was made in napari was made on what is seen there.
            turned=there.turned if turned is None else turned,
        )
        placed, told = laid_over(own, there)
        if told:
            notifications.inform(f"Labels {labels.name!r} {told}.")
        elif placed is not own.labels:
            notifications.inform(
                f"By their files {labels.name!r} lie mirrored or turned on {image.name!r}: they "
                "are taken voxel by voxel all the same. `napari-unpack demo SCAN --labels LABELS` "
                "turns them onto the scan."
            )

    def _begin(self, work: Callable[[Progress], Any]) -> None:
        self.progress.begin(work)
        self._refresh()

    def _finish(self, outcome: TaskResult[BuiltSession | list[LayerData]]) -> None:
        if outcome.error is not None:
            self._unsaved.take_back()
        try:
            if not outcome.cancelled:
                with notifications.errors_shown():
                    self._take(outcome.get())
        finally:
            # Only now: until then layers that are added must not change the choice.
            self._order = None
            self._refresh()

    def _take(self, result: BuiltSession | list[LayerData]) -> None:
        if not isinstance(result, BuiltSession):
            for layer in result:
                self._workspace.viewer.add_layer(Layer.create(*layer))
        elif self._order is not None:
            show = partial(self._show, self._order, result, monotonic() - self._begun)
            # Once more for what was done while the objects were found.
            keep = partial(self._keep, self._order, result)
            self._unsaved.ask("The new objects take its place.", show, cancelled=keep)

    def _show(self, order: _Order, built: BuiltSession, seconds: float) -> None:
        # An open session hides the image: the new labels must take over its real visibility.
        self._workspace.close()
        visible = order.image.visible
        image = order.image if order.volume.whole is None else self._level_layer(order, built)
        # After the image, on which they lie.
        labels = self._labels_layer(order, built, visible)
        preferred = preferences()
        built.session.backend = preferred.backend
        built.session.length_unit = order.unit
        built.session.scanner_from_scan = scanner_from_scan(order.image)
        built.session.assumed = assumed_of(order.image)
        built.session.take_least_occluded = preferred.take_least_occluded
        # Labels without a volume are both inputs at once.
        sources = [image] if labels is image else [image, labels]
        self._workspace.open(
            built.session,
            sources,
            seconds=preferred.seconds,
            backend=preferred.backend,
            recolor_at_rest=preferred.recolor_at_rest,
        )
        self._unpacked[order.image] = order.index
        if built.is_found:
            self._unsaved.found_in(seconds)
        if self._then is not None:
            self._then()

    def _keep(self, order: _Order, built: BuiltSession) -> None:
        """Have the labels of objects that are not wanted now all the same, and say where."""
        kept = self._labels_layer(order, built, order.image.visible)
        notifications.inform(
            f"The new objects are kept in the layer {kept.name!r}: step 1 unpacks them where it is "
            "chosen as Objects."
        )

    def _labels_layer(self, order: _Order, built: BuiltSession, visible: bool) -> Labels:
        """Return the layer of an order's objects, a new one where they are new."""
        image, labels = order.image, order.labels
        # Objects of one time point are labels of their own, as those that were found are, and
        # their name says of which.
        one_of_many = order.volume.name != image.name
        if labels is not None and not one_of_many:
            return labels
        viewer, name = self._workspace.viewer, f"{order.volume.name} objects"
        with clash_told(viewer):
            return unwrap(
                viewer.add_labels(built.labels, name=name, **order.place, visible=visible)
            )

    def _level_layer(self, order: _Order, built: BuiltSession) -> Layer:
        """Add the level that is unpacked as a layer, in place of all levels."""
        from napari_unpack.rendering.slice_image import object_window
        from napari_unpack.viewer.linked_slices import limits_chosen

        finest = " x ".join(map(str, order.volume.factors))
        notifications.inform(
            f"{order.image.name!r} does not fit into memory as a whole. It is shown at a coarser "
            f"level, whose voxels are {finest} of it; the table tells what was measured of all "
            "voxels."
        )
        visible, order.image.visible = order.image.visible, False
        # Of labels without an image there are no limits and no colours to keep.
        kept = ("contrast_limits", "gamma", "colormap") if _is_image(order.image) else ()
        look = {name: getattr(order.image, name) for name in kept}
        if not kept or not limits_chosen(order.image):
            # napari knows one plane of the coarsest level alone: often the air above the bag.
            look["contrast_limits"] = object_window(built.session.volume, built.session.labels)
        level = self._workspace.viewer.add_image(
            built.session.volume,
            name=order.volume.name,
            **order.place,
            **look,
            visible=visible,
            metadata=dict(order.image.metadata),
        )
        return unwrap(level)

    def _add_sample(self) -> None:
        if not self.progress.running:
            self._begin(lambda progress: packed_bag(progress=progress))

    def end(self) -> None:
        """Stop all work and listen to the viewer no longer."""
        self.progress.stop()
        self._workspace.viewer.layers.selection.events.active.disconnect(self._follow_selection)
        self.volume_input.close_links()
        self.labels_input.close_links()


def _is_image(layer: Layer) -> TypeGuard[Image]:
    return isinstance(layer, Image) and is_users(layer)


def _is_labels(layer: Layer | None) -> TypeGuard[Labels]:
    return isinstance(layer, Labels)


def _is_users_labels(layer: Layer) -> TypeGuard[Labels]:
    return isinstance(layer, Labels) and is_users(layer)
