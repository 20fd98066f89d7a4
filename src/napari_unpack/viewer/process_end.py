"""The end of the process: in order, and although a worker is in a library's code."""

from __future__ import annotations

import atexit
import gc
import os
import sys
import threading
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import cache
from time import monotonic, sleep
from typing import NoReturn
from weakref import WeakMethod

from qtpy import PYQT6
from qtpy.compat import isalive
from qtpy.QtCore import QCoreApplication, QIODevice, QObject, QSettings

# The name that threads of this package begin with.
OURS = "unpack"

# Most work stops at its next report, within this; the window has closed by then.
GRACE_SECONDS = 0.5

LOOK_SECONDS = 0.05


_ends: list[WeakMethod[Callable[[], None]]] = []


def end_with_process(end: Callable[[], None]) -> None:
    """Have a method called before Python ends, after those that were given before.

    Parameters
    ----------
    end : callable
        Bound, and does nothing a second time; not called where its object is gone, or where Qt
        has deleted it.

    Notes
    -----
    A script may end without closing the viewer. Qt then deletes the windows in an order of its
    own, in which what one of ours still hears of finds others gone: that aborts the process.
    So what Python owns is not deleted any more, but for what writes when it is.
    """
    _ends[:] = [each for each in _ends if each() is not None]
    _ends.append(WeakMethod(end))
    _register()


@cache
def _register() -> None:
    _before_threads_end(_end_all)
    if PYQT6:
        # Called before PyQt's, which was registered earlier.
        atexit.register(_give_to_qt)


def _give_to_qt() -> None:
    # PyQt deletes what Python owns while it walks its table of wrappers. Deleting one frees
    # wrappers, and calls code that makes new ones: the walk then reads freed memory.
    from PyQt6 import sip

    left = (QCoreApplication, QSettings, QIODevice)
    for each in gc.get_objects():
        # The type, since proxies tell the class of what they stand for, which may be gone.
        if not issubclass(type(each), QObject) or issubclass(type(each), left):
            continue
        if not sip.isdeleted(each) and sip.ispyowned(each):
            sip.transferto(each, None)  # type: ignore[arg-type]


def _before_threads_end(call: Callable[[], None]) -> None:
    """Have something called before Python waits for its threads, which may take long.

    Raises
    ------
    RuntimeError
        If it waits already.
    """
    # Its public `atexit` comes only after.
    getattr(threading, "_register_atexit", atexit.register)(call)


def _end_all() -> None:
    for each in list(_ends):
        end = each()
        owner = getattr(end, "__self__", None)
        if end is not None and (not isinstance(owner, QObject) or isalive(owner)):
            end()


def end_despite_workers() -> None:
    """Let the process end soon after its main thread, where only our threads hold it up.

    Notes
    -----
    Python waits for its threads: for a step of a segmentation half a minute, for a kernel that is
    being compiled longer. What they work on is of no use any more, and files are written whole or
    not at all. Threads of others are waited for as ever, and the functions of `atexit` are called.
    The exit status is 1 after an error, else what `sys.exit` is given from now on, also where that
    is caught; a `SystemExit` that is raised by hand is told to nobody, and counts as 0.
    """
    # Python ends already, of a script, with its exit status: it waits for them.
    with suppress(RuntimeError):
        _watch_at_end()


@cache
def _watch_at_end() -> None:
    given: list[object] = []
    _before_threads_end(lambda: _end_before_workers(given))
    leave = sys.exit

    def leave_noted(status: object = None, /) -> NoReturn:
        given.append(status)
        leave(status)  # type: ignore[arg-type]

    sys.exit = leave_noted


def _end_before_workers(given: Sequence[object]) -> None:
    since = monotonic()
    while any(_is_ours(thread) for thread in _waited_for()):
        if monotonic() - since > GRACE_SECONDS:
            # As Python would, but for its threads; here, since Qt hears from the main one alone.
            _end_all()
            atexit._run_exitfuncs()
            threading.Thread(target=_leave, args=(given,), name=f"{OURS}-end", daemon=True).start()
            return
        sleep(LOOK_SECONDS)


def _leave(given: Sequence[object]) -> None:
    while not all(_is_ours(thread) for thread in _waited_for()):
        sleep(LOOK_SECONDS)
    sys.stdout.flush()
    sys.stderr.flush()
    # Without the end that Python makes: it would not come while they run.
    os._exit(_exit_status(given))


def _waited_for() -> list[threading.Thread]:
    main = threading.main_thread()
    return [thread for thread in threading.enumerate() if thread is not main and not thread.daemon]


def _is_ours(thread: threading.Thread) -> bool:
    return thread.name.startswith(OURS)


def _exit_status(given: Sequence[object]) -> int:
    # An error ends a script, though an exit was caught before.
    if hasattr(sys, "last_value"):
        return 1
    status = given[-1] if given else None
    return status if isinstance(status, int) else int(status is not None)
