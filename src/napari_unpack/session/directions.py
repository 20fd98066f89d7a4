"""Which way objects leave: D, the survey of 26 directions, and the least that frees an object."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from dataclasses import dataclass, replace

from napari_unpack.geometry.axes import Vector, fixed
from napari_unpack.geometry.occlusion_counts import OcclusionCounts
from napari_unpack.geometry.view import Camera
from napari_unpack.session.errors import NoTableError
from napari_unpack.session.occlusion import OcclusionKey, OcclusionResult
from napari_unpack.tasks import Progress
from napari_unpack.unpacking import towards_viewer
from napari_unpack.unpacking.direction_survey import (
    DIRECTIONS_26,
    DirectionalBlocking,
    RevealPlan,
    reveal_plans,
)

# Rays along one side of a survey's picture: it only proposes, and what leaves is asked anew at
# the voxel pitch.
MOST_SURVEY_RAYS = 512


def resolved(
    wanted: str | tuple[float, float, float] | None, camera: Camera, bag_up: Callable[[], Vector]
) -> Vector:
    """Return D, unit vector in world (Li et al. 2012, section 5.1).

    Parameters
    ----------
    wanted : str or (3,) tuple of float, optional
        `SessionState.direction`.
    camera : Camera
        The user's.
    bag_up : callable
        Returns the bag's up.
    """
    if wanted is None:
        return fixed(towards_viewer(camera))
    # Worked out only where it is wanted: it looks at every voxel of the bag.
    return bag_up() if isinstance(wanted, str) else fixed(wanted)


@dataclass(frozen=True)
class SurveyKey:
    """What a survey depends on: not on the view, so that turning the bag asks nothing anew.

    Parameters
    ----------
    revision : int
        Of the labels.
    tolerance : float
    packed : frozenset of int
        Objects in the bag.
    """

    revision: int
    tolerance: float
    packed: frozenset[int]

    def covers(self, wanted: SurveyKey) -> bool:
        """Tell whether a result under this key serves.

        Taking objects out takes their rows and columns out of its tables and changes no other,
        but that with a tolerance whom it exempts depends on all that is packed.
        """
        alike = replace(self, packed=wanted.packed) == wanted
        return alike and wanted.packed <= self.packed and (self == wanted or not self.tolerance)


@dataclass(frozen=True, eq=False)
class DirectionSurvey:
    """What blocks what along every direction of the 26.

    Parameters
    ----------
    directions : tuple of DirectionalBlocking
        Empty where there are too many objects for a table.
    """

    directions: tuple[DirectionalBlocking, ...]


def find_survey(
    key: SurveyKey, counts: Callable[[Vector], OcclusionCounts], progress: Progress
) -> DirectionSurvey:
    """Look along all directions; runs on any thread.

    Parameters
    ----------
    key : SurveyKey
    counts : callable
        Given D, casts the rays along it.
    progress : callable

    Notes
    -----
    A ray looked along the other way meets the same objects in the opposite order, so half of
    the directions are cast. With a tolerance, what is unpackable within it is counted along each
    direction, and all of them are cast.
    """
    halved = key.tolerance == 0.0
    directions = DIRECTIONS_26[: len(DIRECTIONS_26) // 2] if halved else DIRECTIONS_26
    found: list[DirectionalBlocking] = []
    for k, direction in enumerate(directions):
        progress(k / len(directions), "Looking for a way out")
        met = counts(direction)
        blocking = DirectionalBlocking.of(direction, met, key.packed, key.tolerance)
        if blocking is None:
            # There are too many objects for a table, whichever way one looks.
            break
        found += [blocking, blocking.opposite()] if halved else [blocking]
    return DirectionSurvey(tuple(found))


# Each takes as long as a question of who blocks whom.
MOST_PROPOSALS = 4
"""Directions of the survey that are looked along for a buried object."""


@dataclass(frozen=True)
class RevealKey:
    """What the plan that frees a buried object depends on.

    Parameters
    ----------
    target : int
        The buried object.
    near : OcclusionKey
        With D, which takes part and wins ties.
    """

    target: int
    near: OcclusionKey


@dataclass(frozen=True, eq=False)
class RevealResult:
    """How a buried object is freed, and what was learnt on the way.

    Parameters
    ----------
    plan : RevealPlan
        What must leave along which direction, as the voxels say.
    learnt : tuple of (key, result)
        The survey, and the occlusion along D and along the directions that it proposed.
    """

    plan: RevealPlan
    learnt: tuple[tuple[Hashable, object], ...]


def find_reveal_plan(
    key: RevealKey,
    survey: tuple[SurveyKey, DirectionSurvey],
    along: Callable[[Vector], tuple[OcclusionKey, OcclusionResult]],
) -> RevealResult:
    """Find the least that must leave for a buried object to leave; runs on any thread.

    Parameters
    ----------
    key : RevealKey
    survey : (SurveyKey, DirectionSurvey)
        That proposes a direction.
    along : callable
        Given a direction, looks closely along it.

    Raises
    ------
    NoTableError
        If there are too many objects, or the rule has no table of blockers.

    Notes
    -----
    Rays rank the directions, and count what touches by a corner of a voxel: in 9 of 322 simulated
    cases a diagonal that they overrated would have freed the object with fewer. To sweep all 26
    took five to seven times as long, seconds in a large volume.
    """
    target, packed, near = key.target, key.near.packed, fixed(key.near.direction)
    # Too many objects for tables: nothing can be proposed.
    if not survey[1].directions:
        raise NoTableError.of(len(packed))
    learnt: list[tuple[OcclusionKey, OcclusionResult]] = []

    def exact(direction: Vector) -> RevealPlan:
        learnt.append(along(direction))
        blocking = learnt[-1][1].blocking
        if blocking is None:
            raise NoTableError.of(len(packed))
        return RevealPlan(target, direction, frozenset(blocking.among(packed).needed(target)))

    # The survey is coarse and only proposes; the voxels decide, along D and along its best. Where
    # they want more of it than it said, the next best may be better. Ties go to D.
    least = exact(near)
    proposed = reveal_plans(survey[1].directions, packed, target, near)
    for k, said in enumerate(proposed[:MOST_PROPOSALS]):
        if k and len(said.ids) >= len(least.ids):
            break
        least = min(least, exact(said.direction), key=lambda plan: len(plan.ids))
    return RevealResult(least, (survey, *learnt))
