"""Attributes that a session hands on to one of its parts, each in one line and with its type."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Generic, TypeVar, overload

if TYPE_CHECKING:
    from typing import Self

    from napari_unpack.session.session import Session

T = TypeVar("T")


class Read(Generic[T]):
    """An attribute that is read from a part.

    Parameters
    ----------
    read : callable
        Given the session, returns the value.
    """

    def __init__(self, read: Callable[[Session], T]) -> None:
        self._read = read

    @overload
    def __get__(self, session: None, owner: type[Any]) -> Self: ...
    @overload
    def __get__(self, session: Session, owner: type[Any]) -> T: ...
    def __get__(self, session: Session | None, owner: type[Any]) -> Self | T:
        return self if session is None else self._read(session)

    def __set__(self, session: Session, value: T) -> None:
        # Without this method assigning would put a value in front of the part's, unnoticed.
        raise AttributeError("this part of a session can only be read")


class Setting(Read[T]):
    """An attribute of a part that may be set.

    Parameters
    ----------
    read : callable
        Given the session, returns the value.
    write : callable
        Given the session and a value, sets it; refuses what cannot be.
    """

    def __init__(self, read: Callable[[Session], T], write: Callable[[Session, Any], None]) -> None:
        super().__init__(read)
        self._write = write

    def __set__(self, session: Session, value: Any) -> None:
        self._write(session, value)
