# SPDX-License-Identifier: Apache-2.0
"""Ending calls from other threads, and iterators that can be ended so."""
from __future__ import annotations

import threading
import time
from types import TracebackType
from typing import Callable, Dict, Generic, Iterator, Optional, Type, TypeVar

from . import errors

T = TypeVar("T")


class Cancellation:
    """Ends calls from any thread: hand it to them as `cancel=`, then call `cancel`. Calls that begin later fail at once.

        stop = gobo.Cancellation()
        threading.Timer(5, stop.cancel).start()
        client.render("scene.glb", spp=1 << 20, cancel=stop)   # raises gobo.Cancelled after five seconds

    What runs on the server for them ends too. One object may end many calls.
    """

    def __init__(self, parent: "Optional[Cancellation]" = None) -> None:
        self._lock = threading.Lock()
        self._event = threading.Event()
        self._callbacks: Dict[int, Callable[[], object]] = {}
        self._next = 0
        self._leave: Callable[[], None] = parent._add(self.cancel) if parent is not None else lambda: None

    def cancel(self) -> None:
        """Ends every call that has this object. Calling it again does nothing."""
        with self._lock:
            self._event.set()
            callbacks, self._callbacks = list(self._callbacks.values()), {}
        for callback in callbacks:
            callback()

    @property
    def cancelled(self) -> bool:
        return self._event.is_set()

    def check(self) -> None:
        """Raises gobo.Cancelled after `cancel`."""
        if self._event.is_set():
            raise errors.Cancelled("cancelled by this client")

    def _add(self, callback: Callable[[], object]) -> Callable[[], None]:
        """Has `callback` called by `cancel`, at once if that has been; returns what takes it away again."""
        with self._lock:
            number = self._next
            self._next += 1
            late = self._event.is_set()
            if not late:
                self._callbacks[number] = callback
        if late:
            callback()

        def remove() -> None:
            with self._lock:
                self._callbacks.pop(number, None)
        return remove

    def _sleep(self, seconds: float) -> None:
        """Sleeps; raises gobo.Cancelled when it is cancelled meanwhile."""
        self._event.wait(seconds)
        self.check()


class _Ambient(threading.local):
    cancellation: Optional[Cancellation] = None


_ambient = _Ambient()


class scope:
    """Within the block, calls of this thread that have no `cancel=` of their own are ended by `cancellation`."""

    def __init__(self, cancellation: Optional[Cancellation]) -> None:
        self._cancellation = cancellation

    def __enter__(self) -> None:
        self._before = _ambient.cancellation
        _ambient.cancellation = self._cancellation

    def __exit__(self, *_: object) -> None:
        _ambient.cancellation = self._before


def current(cancel: Optional[Cancellation]) -> Optional[Cancellation]:
    """`cancel`, else that of the `scope` around."""
    return cancel if cancel is not None else _ambient.cancellation


def pause(seconds: float, cancel: Optional[Cancellation]) -> None:
    """Sleeps; raises gobo.Cancelled when that is cancelled meanwhile."""
    if cancel is None:
        time.sleep(seconds)
    else:
        cancel._sleep(seconds)


class Stream(Iterator[T], Generic[T]):
    """What a server sends bit by bit. Iterate it in one thread; any thread may end it.

    `cancel` ends the call, and iteration with gobo.Cancelled. `close` ends the call, and iteration quietly; so does the end of a `with`
    block, and leaving the only loop that has it. After the last item neither has an effect.
    """

    def __init__(self, make: Callable[[Cancellation], Iterator[T]], cancel: Optional[Cancellation] = None) -> None:
        """`make`: makes a generator whose calls have the Cancellation that it gets."""
        self._cancellation = Cancellation(current(cancel))
        self._items = make(self._cancellation)
        self._closed = False

    def __iter__(self) -> "Stream[T]":
        return self

    def __next__(self) -> T:
        try:
            return next(self._items)
        except errors.Cancelled:
            self._cancellation._leave()
            if self._closed:
                raise StopIteration from None
            raise
        except BaseException:
            self._cancellation._leave()
            raise

    def cancel(self) -> None:
        """Ends the call, from any thread; who iterates gets gobo.Cancelled."""
        self._cancellation.cancel()

    def close(self) -> None:
        """Ends the call, from any thread; who iterates comes to the end."""
        self._closed = True
        self._cancellation.cancel()
        self._cancellation._leave()
        try:
            self._items.close()  # type: ignore[attr-defined]
        except ValueError:
            pass   # another thread is inside: it ends there

    def __enter__(self) -> "Stream[T]":
        return self

    def __exit__(self, kind: Optional[Type[BaseException]], error: Optional[BaseException], trace: Optional[TracebackType]) -> None:
        self.close()
