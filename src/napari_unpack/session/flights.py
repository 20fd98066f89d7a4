"""What changes with time: objects on their way out of the bag and back."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping

from napari_unpack.geometry.axes import Matrix, number
from napari_unpack.session.placement import Bag, launch
from napari_unpack.session.state import Placement, SessionState
from napari_unpack.unpacking import Flight, Slots


class FlightControl(Mapping[int, Flight]):
    """The flights in the air, by ID: starts, reverses and lands them.

    Parameters
    ----------
    clock : callable
        Returns the time in seconds by which flights go.

    Attributes
    ----------
    animated : bool
        False: nothing flies, verbs finish at once.
    seconds : float
        What one flight takes.
    version : int
        Counts the changes.
    """

    def __init__(self, clock: Callable[[], float]) -> None:
        self.clock = clock
        self.animated = False
        # Long enough to see where an object goes, short enough to unpack twenty.
        self.seconds = 1.2
        self.version = 0
        self._flights: dict[int, Flight] = {}

    def set_pace(
        self,
        animated: bool | None = None,
        seconds: float | None = None,
        clock: Callable[[], float] | None = None,
    ) -> None:
        """Exchange some of the attributes.

        Parameters
        ----------
        animated, seconds, clock
            See the class; None leaves one as it is.

        Raises
        ------
        ValueError
            If `seconds` is not positive and finite.
        TypeError
            If it is no number.
        """
        seconds = None if seconds is None else number(seconds, "seconds")
        if seconds is not None and not 0 < seconds < float("inf"):
            raise ValueError(
                f"seconds must be positive and finite, got {seconds}; animated=False does without"
            )
        self.animated = self.animated if animated is None else animated
        self.seconds = self.seconds if seconds is None else seconds
        self.clock = self.clock if clock is None else clock

    def __getitem__(self, object_id: int) -> Flight:
        return self._flights[object_id]

    def __iter__(self) -> Iterator[int]:
        # Workers may look on while objects land.
        return iter(tuple(self._flights))

    def __len__(self) -> int:
        return len(self._flights)

    def follow(
        self,
        before: SessionState,
        after: SessionState,
        bag: Bag,
        slots: tuple[Slots, Slots],
        stretch: Matrix,
    ) -> None:
        """Start and reverse flights as one state becomes another.

        Parameters
        ----------
        before, after : SessionState
        bag : Bag
        slots : (Slots, Slots)
            Where unpacked objects wait, before and after.
        stretch : (3, 3) ndarray of float64
            How the bag is stretched (`Camera.stretch`).
        """
        # What is out of sight, or alone in the middle, cannot be seen flying as well.
        self.land(i for i in self if i in after.hidden or i == after.inspected)
        out, was = after.placements, before.placements
        moved = [i for i in {**out, **was} if (i in was) != (i in out)]
        # One that began when flights were on would go on to where it does not belong any more.
        if not self.animated:
            self.land(moved)
            return
        now = self.clock()
        flights = dict(self._flights)
        starting: dict[bool, dict[int, Placement]] = {False: {}, True: {}}
        for i in moved:
            if i in before.hidden or i in after.hidden:
                continue
            back = i in was
            placement = (was if back else out)[i]
            if i not in flights:
                starting[back][i] = placement
            elif flights[i].back != back:
                # It turns round where it is.
                there = placement.pose(slots[not back], stretch)
                flights[i] = flights[i].reversed(now).toward(there, now)
        for back, placements in starting.items():
            # The last to leave returns first: the way is clear for it.
            order = reversed(list(placements.items())) if back else placements.items()
            flights |= launch(bag, dict(order), slots[not back], stretch, now, self.seconds, back)
        self._take(flights)

    def land(self, ids: Iterable[int]) -> bool:
        """End flights where they were going; return whether there was one."""
        # Nothing that is known by version is lost where nothing lands.
        gone = set(ids)
        left = {i: flight for i, flight in self._flights.items() if i not in gone}
        if len(left) == len(self._flights):
            return False
        self._take(left)
        return True

    def redirect(
        self,
        placements: Mapping[int, Placement],
        slots: Slots,
        stretch: Matrix,
        bends: bool = False,
    ) -> None:
        """Send flights to where their objects belong now.

        Parameters
        ----------
        placements : mapping of int to Placement
            Of all objects outside the bag.
        slots : Slots
        stretch : (3, 3) ndarray of float64
            How the bag is stretched (`Camera.stretch`).
        bends : bool, optional
            They turn to it from where they are; else they are at once on the way there.
        """
        now = self.clock() if bends else None
        # What flies back goes to its place in the bag, which no window moves.
        sent = {
            i: flight.toward(placements[i].pose(slots, stretch), now)
            for i, flight in self._flights.items()
            if i in placements and not flight.back
        }
        if any(flight is not self._flights[i] for i, flight in sent.items()):
            self._take({**self._flights, **sent})

    def _take(self, flights: dict[int, Flight]) -> None:
        # A new dictionary each time, so that a worker's view of one never changes size.
        self._flights = flights
        self.version += 1
