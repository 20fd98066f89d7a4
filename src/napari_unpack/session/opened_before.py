"""The bags that objects were opened as, kept for who opens one again."""

from __future__ import annotations

from typing import Any
from weakref import ReferenceType, WeakKeyDictionary, ref

from napari_unpack.geometry.axes import Matrix
from napari_unpack.session.opening import opened


class OpenedBefore:
    """Opens objects; what was unpacked in one is still out when it is opened once more.

    A bag is kept as long as its outer session is, and forgotten once labels were repaired.
    """

    def __init__(self) -> None:
        self._bags: WeakKeyDictionary[Any, dict[int, tuple[ReferenceType[Any], Any]]]
        self._bags = WeakKeyDictionary()

    def open(self, session: Any, object_id: int, rotation: Matrix | None = None) -> Any:
        """Return the bag inside an object, as it was left or else from `opened`.

        Parameters
        ----------
        session, object_id, rotation
            As for `opened`; a bag that is known lies as it was left.

        Returns
        -------
        Session

        Raises
        ------
        ValueError
            If the object is of one piece.
        """
        bags = self._bags.setdefault(session, {})
        labels, bag = bags.get(object_id, (None, None))
        if labels is None or labels() is not session.labels:
            bag = opened(session, object_id, rotation)
            bags[object_id] = ref(session.labels), bag
        return bag
