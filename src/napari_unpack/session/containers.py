"""An object opened: its contents, or the parts of different density in it, as a bag of its own.

The bags that objects were opened as, kept for who opens one again.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from napari_unpack.appearance.minimum_opacity import air_among
from napari_unpack.geometry.axes import Matrix
from napari_unpack.session.validation import checked_id

if TYPE_CHECKING:
    from napari_unpack.session.labels import LabelData
    from napari_unpack.session.session import Session

LEAST_SHARE = 0.004
"""Parts smaller than this share of the object are added to what is around them."""

MOST_PARTS = 40

MARGIN = 2
"""Voxels around an object that is opened."""

LEAST_SEPARATION = 0.9
"""Share of the spread of densities that lies between their classes: noise about one density has
0.81, all densities alike 0.89, and things of two or three densities nearly 1."""

LEAST_CORE = 0.1
"""Share of a part that is left a voxel below its border, as of a cube of four voxels: a part with
less is the blurred border between two densities, unless it is the densest, as wires are."""

LEAST_CONTRAST = 2.5
"""How often denser than the lightest part the densest is, above air, where no part encloses the
others: cloth in folds and pages have less, and a sole beside its shoe (2.0 to 2.2)."""

CONTRAST_INSIDE = 2.0
"""The same of a part and what it surrounds, as a tin its food."""

AIR_SHARE = 0.15
"""Of the way from the lightest to the densest in the object's box: parts below are air."""

INSIDE, ENCLOSED = 2, 3
"""Along so many of the three axes an object stands on both sides of what lies in it; of what it
encloses along all, which a thin place of its wall, or the sole of a boot, is not."""


def open_container(session: Session, object_id: int, rotation: Matrix | None = None) -> Session:
    """Return a session of what is inside an object, the object itself taken off its contents.

    Parameters
    ----------
    session : Session
        Whose object; it is not changed.
    object_id : int
        A container with contents of its own (column `parent` of `session.objects`, or objects
        that it surrounds), or any object made of parts that differ in density.
    rotation : (3, 3) ndarray of float64, optional
        How it is seen, from (stretched) world axes to pivot axes; by default as in the bag.

    Returns
    -------
    Session
        On the object's box, everything else in it air, with the parts as its objects. What
        surrounds the other parts is outside already; they leave one by one.

    Raises
    ------
    ValueError
        If it is of one piece, or there is no such object.

    Notes
    -----
    docs/paper.md, R14. A closed container and what fills it are one object, so its contents
    are found here by density: three classes by the thresholds of Otsu's method for several
    classes, connected, the smallest given to their neighbours.
    """
    object_id = checked_id(object_id, session.label_data.known)
    labels, inside, volume = _contents(session, object_id)
    parts = np.where(inside, labels, 0)
    objects, known = session.objects, len(np.unique(parts[inside])) > 1
    if not known:
        parts = parts_by_density(volume, inside)
        if not _are_things(volume, parts):
            parts = inside.astype(np.uint16)
    outer = str(objects["name"][object_id])
    ids = [int(i) for i in np.unique(parts) if i]
    if len(ids) < 2:
        raise ValueError(f"nothing is inside {outer}: it is solid, or holds nothing but air")
    import pandas as pd

    from napari_unpack.session.session import Session

    table = pd.DataFrame(index=pd.Index(ids, name="id"))
    table["name"] = [f"{outer}, part {k}" for k in range(1, len(ids) + 1)]
    if known:
        table["name"] = [str(objects["name"][i]) for i in ids]
        if "parent" in objects:
            inner_of = {session.label_of(i): i for i in ids}
            table["parent"] = [inner_of.get(objects["parent"][i], 0) for i in ids]
    shown = _alone(session, labels, inside, volume)
    inner = Session(shown, parts, session.spacing, table)
    inner.transfer_function = (
        session.style(object_id).transfer_function or session.transfer_function
    )
    camera = session.camera
    inner.look(replace(camera, rotation=camera.rotation if rotation is None else rotation))
    inner.look(inner.overview())
    # One by one: by the rule a nest would leave as the group it came as.
    inner.max_group_size, inner.take_least_occluded = 1, True
    inner.rule, inner.tolerance = session.rule, session.tolerance
    inner.assumed = session.assumed
    first = begins_at(session, object_id)
    inner.first_voxel_mm = session.first_voxel_mm + first
    if session.scanner_from_scan is not None:
        inner.scanner_from_scan = session.scanner_from_scan.copy()
        inner.scanner_from_scan[:3, 3] += session.scanner_from_scan[:3, :3] @ first
    shell = object_id if known else _shell(parts, ids)
    if shell:
        inner.force_unpack(shell)
    inner.history.clear()
    return inner


def begins_at(session: Session, object_id: int) -> NDArray[np.float64]:
    """Return where the bag that an object is opened as begins in the session's, mm z y x.

    Parameters
    ----------
    session : Session
    object_id : int
    """
    window = session.boxes.slices(object_id, MARGIN)
    return np.array([side.start for side in window]) * session.spacing


def shared_objects(session: Session, object_id: int, bag: Session) -> set[int]:
    """Return the objects of the bag that an object is opened as which have the same ID outside.

    Parameters
    ----------
    session : Session
        Whose object.
    object_id : int
    bag : Session
        Inside it.
    """
    window = session.boxes.slices(object_id, MARGIN)
    outside = {int(i) for i in np.unique(np.asarray(session.labels[window])[bag.labels > 0])}
    # Parts that were found by density are all of one object.
    return outside & bag.label_data.known if len(outside) > 1 else set()


def volume_inside(session: Session, object_id: int) -> NDArray[Any]:
    """Return the volume of the bag that an object is opened as.

    Parameters
    ----------
    session : Session
        Whose object.
    object_id : int
    """
    return _alone(session, *_contents(session, object_id))


def _contents(
    session: Session, object_id: int
) -> tuple[NDArray[np.uint16], NDArray[np.bool_], NDArray[Any]]:
    """Return labels, mask of the object with what is in it, and volume."""
    window = session.boxes.slices(object_id, MARGIN)
    labels = np.asarray(session.labels[window])
    family = _family(session, object_id) | surrounded(labels, object_id)
    return labels, np.isin(labels, list(family)), np.asarray(session.volume[window])


def _alone(
    session: Session, labels: NDArray[Any], inside: NDArray[np.bool_], volume: NDArray[Any]
) -> NDArray[Any]:
    """Return a part of the volume with air around an object: zero is water in many scans."""
    air = air_among(labels, volume)
    air = np.nanmin(session.volume) if air is None else air
    return np.where(inside, volume, volume.dtype.type(air))


def surrounded(labels: NDArray[Any], object_id: int, axes: int = INSIDE) -> set[int]:
    """Return the objects that another one surrounds.

    Parameters
    ----------
    labels : (Z, Y, X) ndarray of int
        Object IDs.
    object_id : int
        Who may surround others.
    axes : int
        Along how many it must stand on both sides.

    Returns
    -------
    set of int
        Objects of which more than half lies between parts of that one along two axes or three,
        or as many as asked for: what is in a cup that is open at the top does along two.
    """
    mine = labels == object_id
    sides = np.zeros(labels.shape, np.uint8)
    for axis in range(3):
        before = np.maximum.accumulate(mine, axis=axis)
        behind = np.flip(np.maximum.accumulate(np.flip(mine, axis), axis=axis), axis)
        sides += before & behind
    inside = np.bincount(labels[(sides >= axes) & ~mine & (labels > 0)])
    whole = np.bincount(labels.ravel(), minlength=len(inside))[: len(inside)]
    return {int(i) for i in np.flatnonzero(2 * inside > whole)}


def _shell(parts: NDArray[Any], ids: list[int], axes: int = INSIDE) -> int:
    """Return the part that surrounds all others, 0 where there is none."""
    for part in ids:
        if len(surrounded(parts, part, axes)) == len(ids) - 1:
            return part
    return 0


def parts_by_density(volume: NDArray[Any], inside: NDArray[np.bool_]) -> NDArray[np.uint16]:
    """Split an object where its density jumps.

    Parameters
    ----------
    volume : (Z, Y, X) ndarray
        Density.
    inside : (Z, Y, X) ndarray of bool
        The object.

    Returns
    -------
    (Z, Y, X) ndarray of uint16
        Parts, the largest 1; 0 outside and where there is air. All 1 where nothing differs.
    """
    from scipy import ndimage

    whole = inside.astype(np.uint16)
    known = np.asarray(volume, np.float32)[inside & np.isfinite(volume)]
    if not known.size:
        return whole
    # What is not the object's counts as its commonest density: its own edge is no jump.
    smooth = ndimage.median_filter(np.where(inside, volume, np.median(known)).astype(np.float32), 3)
    values = smooth[inside]
    values = values[np.isfinite(values)]
    spread = np.clip(values, *np.percentile(values, [0.5, 99.5]))
    cuts, separation = _classes(spread)
    if not cuts.size or separation < LEAST_SEPARATION:
        return whole
    classes = np.digitize(smooth, cuts)
    least = max(16, round(LEAST_SHARE * inside.sum()))
    seeds = np.zeros(inside.shape, np.int32)
    found: list[tuple[int, NDArray[np.bool_]]] = []
    for level in range(len(cuts) + 1):
        pieces, _ = ndimage.label(inside & (classes == level))
        sizes = np.bincount(pieces.ravel())
        core = ndimage.binary_erosion(pieces > 0, np.ones((3, 3, 3)))
        cores = np.bincount(pieces[core], minlength=len(sizes))
        # As they were scanned: smoothing makes edges as dense as the middle.
        means = ndimage.mean(volume, pieces, np.arange(len(sizes)))
        densest = (level == len(cuts)) & (means >= cuts[-1])
        found += [
            (int(sizes[k]), pieces == k)
            for k in range(1, len(sizes))
            if sizes[k] >= least and (densest[k] or cores[k] >= LEAST_CORE * sizes[k])
        ]
    for k, (_, piece) in enumerate(sorted(found, key=lambda one: -one[0])[:MOST_PARTS], start=1):
        seeds[piece] = k
    if not seeds.any():
        return whole
    nearest = ndimage.distance_transform_edt(
        seeds == 0, return_distances=False, return_indices=True
    )
    parts: NDArray[np.uint16] = np.where(inside, seeds[tuple(nearest)], 0).astype(np.uint16)
    return parts


def _classes(values: NDArray[Any]) -> tuple[NDArray[np.float64], float]:
    """Return the densities between three classes, and how well they separate, 0 to 1.

    By Otsu's criterion for several classes. scikit-image's own makes classes of empty bins where
    densities are few.
    """
    counts, edges = np.histogram(values, 256)
    centers, share = ((edges[1:] + edges[:-1]) / 2)[counts > 0], counts[counts > 0] / counts.sum()
    # Up to each bin: shares, and sums of densities from their mean on.
    offset = centers - centers @ share
    spread = float(share @ offset**2)
    whole, moment = (np.concatenate([[0.0], np.cumsum(v)]) for v in (share, share * offset))
    first, second = np.triu_indices(len(share) + 1)
    ends = np.stack([np.zeros_like(first), first, second, np.full_like(first, len(share))])
    masses, sums = np.diff(whole[ends], axis=0), np.diff(moment[ends], axis=0)
    between = np.sum(sums**2 / np.maximum(masses, 1e-12), axis=0)
    best = int(between.argmax())
    inner = {int(k) for k in (first[best], second[best]) if 0 < k < len(share)}
    cuts = np.array([(centers[k - 1] + centers[k]) / 2 for k in sorted(inner)])
    return cuts, float(between[best]) / max(spread, 1e-12)


def _are_things(volume: NDArray[Any], parts: NDArray[np.uint16]) -> bool:
    """Take air off the parts; tell whether what is left is more than one thing."""
    from scipy import ndimage

    ids = np.unique(parts[parts > 0])
    # Blurred over into air, every surface is a skin of less density.
    within = ndimage.binary_erosion(parts > 0)
    measured = np.isfinite(volume)
    low = float(volume[measured].min())
    means = ndimage.mean(np.where(measured, volume, low), parts, ids)
    air = low + AIR_SHARE * (max(means) - low)
    parts[np.isin(parts, ids[means < air])] = 0
    left, kept = ids[means >= air], means[means >= air] - low
    if len(left) < 2:
        return False
    density = {int(i): max(float(mean), 1e-12) for i, mean in zip(left, kept, strict=True)}
    if max(density.values()) >= LEAST_CONTRAST * min(density.values()):
        return True
    pairs = ((outer, inner) for outer in density for inner in surrounded(parts, outer))
    if any(abs(np.log(density[a] / density[b])) >= np.log(CONTRAST_INSIDE) for a, b in pairs):
        return True
    return bool(_shell(parts * within, list(density), ENCLOSED))


def _family(session: Session, object_id: int) -> set[int]:
    """Return an object and all that lies in it, by the column `parent`, of IDs as given."""
    family, objects = {object_id}, session.objects
    if "parent" in objects:
        while True:
            inside = objects["parent"].isin([session.label_of(i) for i in family])
            grown = family | {int(i) for i in objects.index[inside]}
            if grown == family:
                break
            family = grown
    return family


@dataclass(eq=False)
class _Opened:
    bag: Session
    # Where in the labels, and what was there.
    window: tuple[slice, slice, slice]
    made_of: NDArray[np.uint16]
    # At which revision of the labels they were compared last, and whether it was there.
    found: tuple[int, bool]
    # By which the bag was scored when it was opened last.
    given: Callable[[Any], float] | None = None
    # Whether it came from a file, where something had been done in it.
    restored: bool = False

    @property
    def worked_in(self) -> bool:
        bag = self.bag
        return self.restored or bool(bag.history.done or bag.opened_bags.worked_in(bag))

    def is_in(self, data: LabelData, object_id: int) -> bool:
        """Tell whether what the bag was made of is there unchanged."""
        revision, alike = self.found
        # Whoever asks what is unsaved asks this, and a large object has millions of voxels.
        if revision != data.revision:
            alike = (
                object_id in data.known
                and self.window == data.boxes.slices(object_id, MARGIN)
                and np.array_equal(self.made_of, data.labels[self.window])
            )
            self.found = data.revision, alike
        return alike


class OpenedBags:
    """The bags that objects of one session were opened as.

    What was done in one is still so when it is opened once more, until a repair of labels changes
    something where it was made of them, and again once the repair is undone.
    """

    def __init__(self) -> None:
        # By object, the one opened last at the end.
        self._bags: dict[int, list[_Opened]] = {}

    def open(self, session: Session, object_id: int, rotation: Matrix | None = None) -> Session:
        """Return the bag inside an object, as it was left or else from `open_container`.

        Parameters
        ----------
        session, object_id, rotation
            As for `open_container`; a bag that is known lies as it was left.

        Raises
        ------
        ValueError
            If the object is of one piece.
        """
        object_id = int(object_id)
        opened = self._known(session).get(object_id)
        known = None if opened is None else opened.bag
        if known is None:
            known = open_container(session, object_id, rotation)
            # It loads more than the panel needs to open.
            from napari_unpack.session.framing import fitted

            # In the worker that opens it: its hull is found for the first view.
            fitted(known)
        else:
            outer = session.objects["name"]
            given_inside = known.state.names
            shared = shared_objects(session, object_id, known) - given_inside.keys()
            known.annotations.take_names({i: str(outer[i]) for i in shared})
        _rate_alike(known, session)
        self._keep(session, object_id, known)
        return known

    def leave(self, session: Session, object_id: int) -> None:
        """Give objects of the bag the names that they were given inside an object: one step.

        The model of the confidence that was chosen there is the bag's as well.

        Parameters
        ----------
        session, object_id
            As for `restore`.
        """
        opened = self._known(session).get(object_id)
        if opened is None:
            return
        bag = opened.bag
        # Not the one it came in with: another may have been chosen for the bag meanwhile.
        if bag.label_editor.oracle is not opened.given:
            _rate_alike(session, bag)
        # Most bags are left without a new name, and then nothing is searched.
        if not bag.state.names:
            return
        shared = shared_objects(session, object_id, bag)
        names = {i: name for i, name in bag.state.names.items() if i in shared}
        session.annotations.name_and_color(names, {})
        # From now on they are those of the bag, and follow it.
        bag.annotations.take_names(names)

    def restore(self, session: Session, object_id: int, bag: Session) -> None:
        """Take over a bag as it was left in another session.

        Parameters
        ----------
        session : Session
            Whose object.
        object_id : int
        bag : Session
        """
        self._keep(session, object_id, bag, restored=True)

    def worked_in(self, session: Session) -> dict[int, Session]:
        """Return the bags in which something was done, by object."""
        return {i: one.bag for i, one in self._known(session).items() if one.worked_in}

    def _keep(self, session: Session, object_id: int, bag: Session, restored: bool = False) -> None:
        data = session.label_data
        window = data.boxes.slices(object_id, MARGIN)
        # A copy, which keeps no whole volume of labels alive.
        made_of, found = np.array(data.labels[window]), (data.revision, True)
        before = self._bags.get(object_id, [])
        restored |= any(one.restored for one in before if one.bag is bag)
        opened = _Opened(bag, window, made_of, found, bag.label_editor.oracle, restored)
        # Work in those of other labels there comes back with them.
        others = [one for one in before if one.bag is not bag and one.worked_in]
        self._bags[object_id] = [*others, opened]

    def _known(self, session: Session) -> dict[int, _Opened]:
        # Of labels that were repaired there: what was inside may be so no more.
        data = session.label_data
        return {i: one for i, all_ in self._bags.items() for one in all_ if one.is_in(data, i)}


def _rate_alike(session: Session, other: Session) -> None:
    """Have objects scored by the model that another bag uses."""
    oracle = other.label_editor.oracle
    if session.label_editor.oracle is not oracle:
        session.use_oracle(oracle, {})
