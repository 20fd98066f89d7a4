"""What a session is at one moment: three frozen parts, of which undo keeps the first."""

from __future__ import annotations

from collections.abc import Mapping, Set
from dataclasses import dataclass, field, fields, replace
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from napari_unpack.appearance import Decorations, TransferFunction
from napari_unpack.appearance.tints import MODES, Mode, Rgba
from napari_unpack.geometry.axes import Matrix, Vector, fixed, number
from napari_unpack.geometry.transforms import Pose
from napari_unpack.geometry.view import GRAVITY_UP, Camera, View
from napari_unpack.rendering.object_style import ObjectStyle
from napari_unpack.segmentation.review.doubts import Answer
from napari_unpack.session.bag_cut import Cut
from napari_unpack.session.labels import Edit
from napari_unpack.session.measurements import Measurement
from napari_unpack.session.object_state import ObjectState
from napari_unpack.session.validation import checked_planes, checked_whole
from napari_unpack.unpacking import Queue, Slots
from napari_unpack.unpacking.occlusion import Rule
from napari_unpack.unpacking.queue import Group

__all__ = ["Group", "ObjectState", "Placement", "SessionState", "UnpackingRules", "ViewState"]

Flag = Literal["suspicious", "cleared"]
FLAGS: tuple[Flag, ...] = get_args(Flag)

# A reflection in a point followed by this is a reflection of right and left in the picture.
HALF_TURN = np.diag([-1.0, -1.0, 1.0])


@dataclass(frozen=True, eq=False)
class Placement:
    """How an unpacked object is kept.

    Parameters
    ----------
    slot : int
        Number of its place beside the bag.
    rotation : (3, 3) ndarray of float64
        How it is held, from (stretched) world axes to pivot axes.
    image_mm : (float, float)
        Width and height of its image at scale 1, as it was held when it left.
    direction : (3,) ndarray of float64
        The D along which it left, world.
    group : tuple of int
        The objects that left with it, itself included.
    placed : Pose, optional
        Where a person put it, in place of the slot.
    within : (float, float), optional
        Height and width in mm of the window it was put into; in another window it keeps its
        share of the way from the middle to the edge, and has the size it would have in its slot.
    turned_mm : (float, float), optional
        Width and height of its image as a person turned it.
    """

    slot: int
    rotation: Matrix
    image_mm: tuple[float, float]
    direction: Vector
    group: Group
    placed: Pose | None = None
    within: tuple[float, float] | None = None
    turned_mm: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        """Keep arrays that nobody can write to: poses that are handed out share them."""
        object.__setattr__(self, "rotation", fixed(self.rotation))
        object.__setattr__(self, "direction", fixed(self.direction))
        if self.placed is not None:
            object.__setattr__(self, "placed", self.placed.kept())

    def without(self, objects: Set[int]) -> Placement:
        """Return it as if some objects had not left with it."""
        return replace(self, group=tuple(i for i in self.group if i not in objects))

    def pose(self, slots: Slots, stretch: Matrix) -> Pose:
        """Return its pose in pivot space.

        Parameters
        ----------
        slots : Slots
            Of the window as it is now.
        stretch : (3, 3) ndarray of float64
            How the bag is stretched (`Camera.stretch`).
        """
        scale = slots.scale(*self.image_mm)
        if self.turned_mm is not None:
            # Turned by hand it may be longer than it was when it left, and stand out of its cell.
            scale = min(scale, slots.cell_mm / max(self.turned_mm))
        if self.placed is None:
            return Pose(slots.centers[self.slot], self.rotation, scale, stretch)
        placed = replace(self.placed, stretch=stretch)
        if self.within is None or self.within == slots.window_mm:
            return placed
        share = np.divide(slots.window_mm, self.within)
        # The first axis is towards the viewer, and a window has no depth.
        return replace(placed, center=placed.center * np.array([1.0, *share]), scale=scale)

    def beneath(self, slots: Slots, stretch: Matrix) -> frozenset[int]:
        """Return the slots that it lies over where a person put it; nothing where it was not moved.

        Parameters
        ----------
        slots, stretch
            See `pose`.
        """
        if self.placed is None:
            return frozenset()
        pose = self.pose(slots, stretch)
        return slots.beneath(pose.center, pose.scale * max(self.turned_mm or self.image_mm))

    def turned(self, rotation: Matrix, image_mm: tuple[float, float]) -> Placement:
        """Return it held another way; it stays in its place and fits there.

        Parameters
        ----------
        rotation : (3, 3) ndarray of float64
            From (stretched) world axes to pivot axes.
        image_mm : (float, float)
            Width and height of its image then.
        """
        placed = None if self.placed is None else replace(self.placed, rotation=rotation)
        return replace(self, rotation=rotation, placed=placed, turned_mm=image_mm)

    def mirrored(self) -> Placement:
        """Return it for a bag that is mirrored from now on, its picture mirrored likewise."""
        placed = self.placed
        if placed is not None:
            placed = replace(placed, rotation=HALF_TURN @ placed.rotation)
        return replace(self, rotation=HALF_TURN @ self.rotation, placed=placed)


@dataclass(frozen=True, eq=False)
class SessionState:
    """All that undo brings back.

    Parameters
    ----------
    transfer_function : TransferFunction
        The master's.
    hues : mapping of int to float
        By ID.
    placements : dict of int to Placement
        Objects outside the bag, in the order in which they left.
    hidden : frozenset of int
        Objects put out of sight, in the bag or outside.
    inspected : int, optional
        The object looked at alone.
    queue : Queue
        Which objects leave next.
    names : mapping of int to str
        By ID, where a person gave one.
    direction : str or (3,) tuple of float, optional
        D as it was asked for; None is the opposite of the view.
    undone : tuple of dict of int to Placement
        Removals that `commands.go_to` has taken back, the next one first: going forward again
        repeats them. Any other command that moves, hides or shows objects forgets them.
    labels_edit : Edit, optional
        The last edit of the labels; None as they were given.
    examples : frozenset of int
        Objects a person marked as examples of whole ones.
    styles : mapping of int to ObjectStyle
        By ID, how those are shown alone that have an opacity or a cut of their own.
    colors : mapping of int to (float, float, float, float)
        By ID, straight RGBA from 0 to 1, where a person gave one.
    notes : mapping of int to str
        By ID, what a person wrote of objects.
    flags : mapping of int to str
        By ID, "suspicious" or "cleared"; others are not decided yet.
    measurements : tuple of Measurement
        Lengths and angles a person measured.
    cut : Cut
        The cutting plane and the clipping box; their planes are among `ViewState.clipping`.
    answers : tuple of Answer
        What a person said of doubtful decisions.
    """

    transfer_function: TransferFunction
    hues: Mapping[int, float]
    placements: dict[int, Placement] = field(default_factory=dict)
    hidden: frozenset[int] = frozenset()
    inspected: int | None = None
    queue: Queue = field(default_factory=Queue)
    names: Mapping[int, str] = field(default_factory=dict)
    direction: str | tuple[float, float, float] | None = None
    undone: tuple[Mapping[int, Placement], ...] = ()
    labels_edit: Edit | None = None
    examples: frozenset[int] = frozenset()
    styles: Mapping[int, ObjectStyle] = field(default_factory=dict)
    colors: Mapping[int, Rgba] = field(default_factory=dict)
    notes: Mapping[int, str] = field(default_factory=dict)
    flags: Mapping[int, Flag] = field(default_factory=dict)
    measurements: tuple[Measurement, ...] = ()
    cut: Cut = field(default_factory=Cut)
    answers: tuple[Answer, ...] = ()

    @property
    def removals(self) -> tuple[Group, ...]:
        """What is out, group by group in the order in which they left."""
        return tuple(dict.fromkeys(placement.group for placement in self.placements.values()))

    def packed(self, known: frozenset[int]) -> frozenset[int]:
        """Return which of the known objects stand in the way of others.

        What is on its way back counts as being there, and so does what is inspected: it goes
        back where it was.
        """
        return known.difference(self.placements, self.hidden)

    def state(self, object_id: int) -> ObjectState:
        """Return where an object is once nothing flies any more."""
        if object_id in self.hidden:
            return ObjectState.HIDDEN
        if object_id == self.inspected:
            return ObjectState.INSPECTED
        # After hidden and inspected: both may be so outside the bag as well.
        return ObjectState.UNPACKED if object_id in self.placements else ObjectState.PACKED

    def with_changes_of(self, source: SessionState, target: SessionState) -> SessionState:
        """Return this state with what differs from `source` to `target` set as in `target`.

        Undoing a step takes back what that step changed and leaves alone what has changed
        otherwise since, such as hues renewed for another view.

        Parameters
        ----------
        source, target : SessionState
            Before and after, in the direction of the change.
        """
        changes = {
            f.name: getattr(target, f.name)
            for f in fields(self)
            # Identity: parts are exchanged and never changed, and comparing mappings takes long.
            if getattr(source, f.name) is not getattr(target, f.name)
        }
        return replace(self, **changes)


@dataclass(frozen=True, eq=False)
class ViewState:
    """How a session is looked at: nothing of it can be undone.

    Parameters
    ----------
    view : View
        As it was asked for.
    camera : Camera
        The view with nothing left open.
    canvas_size : (int, int)
        Height and width of the window in pixels.
    selected : frozenset of int
        Objects selected in the picture or in the table.
    clipping : (N, 2, 3) ndarray of float64
        Planes that cut the packed bag open, point and normal in voxels, z y x; see
        `validation.checked_planes`. Those of `SessionState.cut` are among them.
    decorations : Decorations
        Background, box and scale bar.
    tint_mode : {"perceptual", "safe", "hsv"}
        How hues become tints.
    show_unlabelled : bool
        Whether matter that belongs to no object shows.
    locked_hues : frozenset of int
        Objects whose hue recolouring leaves alone.
    hue_margin : float
        Fraction of every hue arc left empty.
    up : (3,) ndarray of float64
        Away from the scanner's table, unit vector in world.
    recolored : bool
        Whether hues were chosen for a view yet: only then is there something to keep.

    Raises
    ------
    ValueError
        If the canvas has no pixel, or the tint mode is none of the three.
    """

    view: View
    camera: Camera
    canvas_size: tuple[int, int] = (768, 1024)
    selected: frozenset[int] = frozenset()
    clipping: NDArray[np.float64] = field(default_factory=lambda: checked_planes(None))
    decorations: Decorations = field(default_factory=lambda: Decorations.of("dark"))
    tint_mode: Mode = "perceptual"
    show_unlabelled: bool = False
    locked_hues: frozenset[int] = frozenset()
    # Neighbours come out at least 0.4 / C of the circle apart, C being the number of arcs.
    hue_margin: float = 0.4
    up: Vector = field(default_factory=lambda: np.array(GRAVITY_UP))
    recolored: bool = False

    def __post_init__(self) -> None:
        """Refuse what cannot be shown; keep an up that nobody can write to."""
        object.__setattr__(self, "up", fixed(self.up))
        if min(self.canvas_size) < 1:
            raise ValueError(
                f"canvas_size must be at least (1, 1) pixels, got {self.canvas_size!r}"
            )
        if self.tint_mode not in MODES:
            raise ValueError(f"tint_mode must be one of {', '.join(MODES)}, got {self.tint_mode!r}")


@dataclass(frozen=True)
class UnpackingRules:
    """The rules by which objects may leave; a queue filled by others is worthless.

    Parameters
    ----------
    rule : str
        What counts as unpackable; see `unpacking.unpackable_ids`.
    tolerance : float
        Share of an object that may be blocked and it still counts as unpackable.
    max_group_size : int
        Interlocked groups of up to so many leave together; a larger one stays.
    take_least_occluded : bool
        What happens where nothing is unpackable: True takes the least occluded, False raises.

    Raises
    ------
    ValueError
        If there is no such rule, or a number is out of range.
    TypeError
        If one is no number, not whole, or neither True nor False.
    """

    rule: Rule = "exact"
    tolerance: float = 0.0
    # Half a bag flying out at once shows nothing.
    max_group_size: int = 4
    take_least_occluded: bool = True

    def __post_init__(self) -> None:
        """Refuse rules that cannot be."""
        if self.rule not in get_args(Rule):
            raise ValueError(f"rule must be one of {', '.join(get_args(Rule))}, got {self.rule!r}")
        # Plain numbers: they are written to files.
        object.__setattr__(self, "tolerance", number(self.tolerance, "tolerance"))
        most = checked_whole(self.max_group_size, "max_group_size")
        object.__setattr__(self, "max_group_size", most)
        if not isinstance(self.take_least_occluded, bool | np.bool_):
            raise TypeError(
                f"take_least_occluded must be True or False, got {self.take_least_occluded!r}"
            )
        object.__setattr__(self, "take_least_occluded", bool(self.take_least_occluded))
        if not 0.0 <= self.tolerance < 1.0:
            raise ValueError(f"tolerance must be in [0, 1), got {self.tolerance!r}")
        if self.max_group_size < 1:
            raise ValueError(f"max_group_size must be at least 1, got {self.max_group_size!r}")

    @property
    def terms(self) -> tuple[object, ...]:
        """All of them as a tuple, as queues carry it."""
        return (self.rule, self.tolerance, self.max_group_size, self.take_least_occluded)
