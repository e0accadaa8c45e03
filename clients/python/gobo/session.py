# SPDX-License-Identifier: Apache-2.0
"""A picture that follows edits: of many that come while one renders, the latest is rendered and the others are not."""
from __future__ import annotations

import contextlib
import logging
import threading
import time
import uuid
from typing import Any, Callable, Iterator, Mapping, Optional, TYPE_CHECKING, Tuple, Union, Unpack

from . import errors
from .cancellation import Cancellation, Stream, current
from .fields import RequestFields, fill, whole_of
from .v1 import render_pb2

if TYPE_CHECKING:
    from .result import Result

PictureCallback = Callable[["Result"], Any]
ErrorCallback = Callable[[errors.Error], Any]
_log = logging.getLogger("gobo")


class Session:
    """Renders what its edits ask for, in a thread of its own. Any thread may edit, read and close it.

    `edit` never waits. An edit that comes while a picture is made ends that render once it has shown a picture, however small (so that
    something moves while one drags), and of edits that come before that only the latest is rendered (`scheduling.session`,
    docs/live.md). Every picture shows one edit whole. The first is of the request without edits, number 0.

    Attributes:
        id: the name of the session at the server.
    """

    def __init__(self, request: render_pb2.RenderRequest, render: "Callable[[render_pb2.RenderRequest, Cancellation], Stream[Result]]",
                 on_picture: Optional[PictureCallback] = None, on_error: Optional[ErrorCallback] = None,
                 prepare: Callable[[Mapping[str, Any]], Mapping[str, Any]] = lambda fields: fields) -> None:
        self.id = request.scheduling.session or uuid.uuid4().hex
        request.scheduling.session = self.id
        self._base = request
        self._now = _copy(request)
        self._render = render
        self._on_picture = on_picture
        self._on_error = on_error
        self._prepare = prepare
        self._condition = threading.Condition()
        self._edit = 0
        self._pending: Optional[Tuple[int, render_pb2.RenderRequest]] = (0, _copy(request))
        self._running: Optional[Cancellation] = None
        self._shown = False
        self._closed = False
        self._news = 0                                     # counts pictures and errors
        self._latest: "Union[Result, errors.Error, None]" = None
        self._latest_edit = -1
        self._picture: "Optional[Result]" = None
        self._thread = threading.Thread(target=self._work, name="gobo-session", daemon=True)
        self._thread.start()

    @property
    def request(self) -> render_pb2.RenderRequest:
        """A copy of the request with all edits."""
        with self._condition:
            return _copy(self._now)

    @property
    def latest(self) -> "Optional[Result]":
        """The newest picture, or None before the first."""
        return self._picture

    def edit(self, **fields: "Unpack[RequestFields]") -> int:
        """Changes the request, on top of earlier edits, and has it rendered; returns the edit's number at once (an
        array for `env=` is sent to the server before).

        Keywords are those of `render`. Fields of lights and of other messages add up; `None` undoes (`lights={"key": None}`); `env=`, `camera=`
        and `shadows=` replace what was there as a whole, `set={"camera.yfov_deg": 40}` changes one field.

        Raises:
            gobo.InvalidArgument: a name or a kind of value is wrong; nothing has changed. Ranges are the server's to refuse: see `on_error`.
        """
        prepared = self._prepare(fields)
        return self._change(lambda now: _edited(now, prepared))

    def reset(self, **fields: "Unpack[RequestFields]") -> int:
        """The request as it was at first, with these edits alone."""
        prepared = self._prepare(fields)
        return self._change(lambda now: _edited(self._base, prepared))

    def replace(self, request: render_pb2.RenderRequest) -> int:
        """Another request in place of the first one and all edits; `reset` still goes back to the first."""
        return self._change(lambda now: _copy(request))

    def _change(self, make: Callable[[render_pb2.RenderRequest], render_pb2.RenderRequest]) -> int:
        with self._condition:
            if self._closed:
                raise errors.Cancelled("this session is closed")
            request = make(self._now)
            request.scheduling.session = self.id
            self._now = request
            self._edit += 1
            self._pending = (self._edit, _copy(request))
            if self._running is not None and self._shown:
                self._running.cancel()
            self._condition.notify_all()
            return self._edit

    def pictures(self, timeout: Optional[float] = None) -> "Pictures":
        """Iterates over pictures as they come, from the newest there is on; a slow reader misses some, never the newest. It ends when the
        session is closed. An edit that cannot be rendered raises its gobo.Error, once, and one may go on iterating; so does `timeout` (seconds)
        without news, as gobo.DeadlineExceeded.
        """
        return Pictures(self, timeout)

    def wait(self, timeout: Optional[float] = None) -> "Result":
        """Waits for the final picture of the newest edit and returns it.

        Raises:
            gobo.Error: that edit cannot be rendered; gobo.DeadlineExceeded after `timeout` seconds; gobo.Cancelled: the session was closed.
        """
        end = None if timeout is None else time.monotonic() + timeout
        with self._interruptible(), self._condition:
            while True:
                if self._closed:
                    raise errors.Cancelled("this session is closed")
                if self._latest_edit == self._edit:
                    if isinstance(self._latest, errors.Error):
                        raise self._latest
                    if self._latest is not None and self._latest.final:
                        return self._latest
                self._sleep(end)

    def close(self) -> None:
        """Ends the render that runs, and the session. Calling it again does nothing."""
        with self._condition:
            self._closed = True
            if self._running is not None:
                self._running.cancel()
            self._condition.notify_all()
        if threading.current_thread() is not self._thread:
            self._thread.join(10.0)   # a callback may wait for who called this

    def __enter__(self) -> "Session":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @contextlib.contextmanager
    def _interruptible(self) -> Iterator[None]:
        """Within the block, `_sleep` ends when the cancellation of this thread's scope does."""
        cancel = current(None)
        remove = cancel._add(self._wake) if cancel is not None else None
        try:
            yield
        finally:
            if remove is not None:
                remove()

    def _wake(self) -> None:
        with self._condition:
            self._condition.notify_all()

    def _sleep(self, end: Optional[float]) -> None:
        cancel = current(None)
        if cancel is not None:
            cancel.check()
        left = None if end is None else end - time.monotonic()
        if left is not None and left <= 0:
            raise errors.DeadlineExceeded("no picture came in time")
        self._condition.wait(left)

    def _after(self, seen: int, timeout: Optional[float]) -> "Optional[Tuple[int, Union[Result, errors.Error]]]":
        """The newest picture or error once there is one after number `seen`, with its number; None: the session is closed."""
        end = None if timeout is None else time.monotonic() + timeout
        with self._interruptible(), self._condition:
            while self._news <= seen or self._latest is None:
                if self._closed:
                    return None
                self._sleep(end)
            return None if self._closed else (self._news, self._latest)

    def _work(self) -> None:
        while True:
            with self._condition:
                while self._pending is None and not self._closed:
                    self._condition.wait()
                if self._closed or self._pending is None:
                    return
                number, request = self._pending
                self._pending = None
                self._shown = False
                stop = self._running = Cancellation()
            try:
                with self._render(request, stop) as pictures:
                    for picture in pictures:
                        picture.edit = number
                        if not self._tell(number, picture):
                            break
            except errors.Error as e:
                if isinstance(e, errors.Cancelled) and self._superseded():
                    continue
                self._tell(number, e)
            except Exception as e:   # a fault of this package must not end the session without a word
                _log.exception("gobo.Session")
                self._tell(number, errors.Internal(f"the client failed: {e!r}"))
            finally:
                with self._condition:
                    self._running = None

    def _superseded(self) -> bool:
        with self._condition:
            return self._closed or self._pending is not None

    def _tell(self, number: int, news: "Union[Result, errors.Error]") -> bool:
        """Passes a picture or an error on; whether the render that it is of goes on."""
        with self._condition:
            if self._closed:
                return False
            self._news += 1
            self._latest, self._latest_edit = news, number
            callback: Optional[Callable[[Any], Any]] = self._on_error
            if not isinstance(news, errors.Error):
                self._picture = news
                callback = self._on_picture
            self._condition.notify_all()
        if callback is not None:
            try:
                callback(news)
            except Exception:
                _log.exception("gobo.Session: a callback failed")
        with self._condition:
            self._shown = True
            return self._pending is None and not self._closed


class Pictures(Iterator["Result"]):
    """See `Session.pictures`."""

    def __init__(self, session: Session, timeout: Optional[float]) -> None:
        self._session = session
        self._timeout = timeout
        self._seen = 0

    def __iter__(self) -> "Pictures":
        return self

    def __next__(self) -> "Result":
        news = self._session._after(self._seen, self._timeout)
        if news is None:
            raise StopIteration
        self._seen, latest = news
        if isinstance(latest, errors.Error):
            raise latest
        return latest


def _copy(request: render_pb2.RenderRequest) -> render_pb2.RenderRequest:
    copy = render_pb2.RenderRequest()
    copy.CopyFrom(request)
    return copy


def _edited(request: render_pb2.RenderRequest, fields: Mapping[str, Any]) -> render_pb2.RenderRequest:
    edited = _copy(request)
    for name in whole_of(fields):
        edited.ClearField(name)
    fill(edited, fields)
    return edited
