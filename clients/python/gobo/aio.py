# SPDX-License-Identifier: Apache-2.0
"""The client for asyncio: the same calls, awaited; `task.cancel()` and `asyncio.wait_for` end them on the server too.

    async with gobo.aio.connect() as client:
        r = await client.render("scene.glb", spp=64)
        async for snapshot in client.render_progressive("cornell", spp=256):
            ...

Each call that is awaited has a thread while it lasts, in which the plain client does the work: everything that holds for the one holds for the other.
"""
from __future__ import annotations

import asyncio
import os
import threading
from typing import Any, AsyncIterator, Callable, Dict, Generic, Iterable, List, Mapping, Optional, Sequence, Tuple, TypeVar, Union, Unpack

import numpy as np

from . import client as _client
from . import errors
from .cancellation import Cancellation, Stream, scope
from .fields import Light, RequestFields
from .jobs import Frames, Job, JobState, LogEntry
from .result import Result
from .scenes import Scene
from .session import Session
from .v1 import render_pb2, service_pb2

T = TypeVar("T")
Source = Union[str, "os.PathLike[str]", Scene, None]
ProgressCallback = Callable[[render_pb2.Progress], Any]

__all__ = ["AsyncClient", "AsyncJobs", "AsyncScenes", "AsyncSession", "AsyncStream", "connect", "local", "relight"]


async def _call(work: Callable[[], T], stop: Optional[Cancellation] = None) -> T:
    """`work` in a thread of its own. When this is cancelled, so are the calls that `work` makes (or what `stop` ends)."""
    loop = asyncio.get_running_loop()
    future: "asyncio.Future[T]" = loop.create_future()
    own = stop if stop is not None else Cancellation()

    def settle(value: Any, error: Optional[BaseException]) -> None:
        if future.done():
            return   # nobody waits any more
        if error is not None:
            future.set_exception(error)
        else:
            future.set_result(value)

    def run() -> None:
        value: Any = None
        error: Optional[BaseException] = None
        try:
            with scope(own):
                value = work()
        except BaseException as e:
            error = e
        try:
            loop.call_soon_threadsafe(settle, value, error)
        except RuntimeError:
            pass   # the loop is closed
    threading.Thread(target=run, name="gobo-aio", daemon=True).start()
    try:
        return await future
    except asyncio.CancelledError:
        own.cancel()
        raise


def _progress(callback: Optional[ProgressCallback]) -> Optional[ProgressCallback]:
    """`callback`, called in the loop instead of the call's thread."""
    if callback is None:
        return None
    loop, call = asyncio.get_running_loop(), callback

    def post(progress: render_pb2.Progress) -> None:
        try:
            loop.call_soon_threadsafe(call, progress)
        except RuntimeError:
            pass
    return post


_END: Any = object()


class AsyncStream(AsyncIterator[T], Generic[T]):
    """What a server sends bit by bit, for `async for`. The call begins with the first item, and ends when the task that waits for one is
    cancelled, by `cancel` (who iterates gets gobo.Cancelled), by `close`, or at the end of an `async with` block.
    """

    def __init__(self, make: Callable[[Cancellation], Stream[T]]) -> None:
        self._make = make
        self._stop = Cancellation()
        self._stream: Optional[Stream[T]] = None
        self._closed = False

    def _next(self) -> T:
        if self._stream is None:
            self._stream = self._make(self._stop)
        return next(self._stream, _END)

    def __aiter__(self) -> "AsyncStream[T]":
        return self

    async def __anext__(self) -> T:
        if self._closed:
            raise StopAsyncIteration
        try:
            item = await _call(self._next, self._stop)
        except errors.Cancelled:
            if self._closed:
                raise StopAsyncIteration from None
            raise
        if item is _END:
            raise StopAsyncIteration
        return item

    def cancel(self) -> None:
        """Ends the call; who iterates gets gobo.Cancelled. From any thread."""
        self._stop.cancel()

    def close(self) -> None:
        """Ends the call; who iterates comes to the end. From any thread."""
        self._closed = True
        self._stop.cancel()

    async def aclose(self) -> None:
        """`close`, as generators of asyncio have it."""
        self.close()

    async def __aenter__(self) -> "AsyncStream[T]":
        return self

    async def __aexit__(self, *_: object) -> None:
        self.close()


class AsyncSession:
    """A `Session` in a loop: `edit` and `reset` return at once, pictures are awaited."""

    def __init__(self, session: Session) -> None:
        self.session = session

    def edit(self, **fields: "Unpack[RequestFields]") -> int:
        """See `Session.edit`."""
        return self.session.edit(**fields)

    def reset(self, **fields: "Unpack[RequestFields]") -> int:
        """See `Session.reset`."""
        return self.session.reset(**fields)

    @property
    def latest(self) -> Optional[Result]:
        return self.session.latest

    async def pictures(self, timeout: Optional[float] = None) -> AsyncIterator[Result]:
        """The newest pictures as they come, until the session is closed: see `Session.pictures`. An error ends this iteration, not the session."""
        pictures = self.session.pictures(timeout)
        while True:
            news = await _call(lambda: next(pictures, None))
            if news is None:
                return
            yield news

    async def wait(self, timeout: Optional[float] = None) -> Result:
        """See `Session.wait`."""
        return await _call(lambda: self.session.wait(timeout))

    async def close(self) -> None:
        await _call(self.session.close)

    async def __aenter__(self) -> "AsyncSession":
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.close()


class AsyncScenes:
    """`Scenes`, awaited."""

    def __init__(self, client: "AsyncClient") -> None:
        self._client = client

    async def open(self, source: "str | os.PathLike[str]", name: str = "", *, timeout: Optional[float] = None) -> Scene:
        """See `Scenes.open`."""
        return await self._client._do(lambda c: c.scenes.open(source, name, timeout=timeout))

    async def upload(self, source: "str | os.PathLike[str] | bytes", name: str = "", *, extension: str = "", timeout: Optional[float] = None) -> Scene:
        """See `Scenes.upload`."""
        return await self._client._do(lambda c: c.scenes.upload(source, name, extension=extension, timeout=timeout))

    async def list(self, *, timeout: Optional[float] = None) -> List[Scene]:
        """See `Scenes.list`."""
        return await self._client._do(lambda c: c.scenes.list(timeout=timeout))

    async def builtin(self, *, timeout: Optional[float] = None) -> "List[str]":
        """See `Scenes.builtin`."""
        return await self._client._do(lambda c: c.scenes.builtin(timeout=timeout))

    async def inspect(self, scene: Union[str, Scene], *, timeout: Optional[float] = None) -> Scene:
        """See `Scenes.inspect`."""
        return await self._client._do(lambda c: c.scenes.inspect(scene, timeout=timeout))

    async def patch(self, scene: Union[str, Scene], *, materials: Optional[Mapping[str, Mapping[str, Any]]] = None,
                    instances: Optional[Mapping[str, Union[Sequence[float], np.ndarray, Mapping[str, Any]]]] = None, lights: Optional[Mapping[str, Light]] = None,
                    timeout: Optional[float] = None) -> Scene:
        """See `Scenes.patch`."""
        return await self._client._do(lambda c: c.scenes.patch(scene, materials=materials, instances=instances, lights=lights, timeout=timeout))

    async def unload(self, scene: Union[str, Scene], *, timeout: Optional[float] = None) -> None:
        """See `Scenes.unload`."""
        await self._client._do(lambda c: c.scenes.unload(scene, timeout=timeout))


class AsyncJobs:
    """`Jobs`, awaited; jobs are named by their id."""

    def __init__(self, client: "AsyncClient") -> None:
        self._client = client

    async def submit(self, scene: "str | os.PathLike[str] | Scene", *, frames: Frames = None, fps: Optional[float] = None, name: str = "",
                     key: Optional[str] = None, job_priority: str = "medium", deadline: Optional[float] = None, max_attempts: Optional[int] = None,
                     tile_px: Optional[int] = None, after: Iterable[str] = (), out: str = "", timeout: Optional[float] = None,
                     **fields: "Unpack[RequestFields]") -> str:
        """Submits a job and returns its id: see `Jobs.submit`."""
        needs = list(after)

        def work(c: _client.Client) -> str:
            return c.jobs.submit(scene, frames=frames, fps=fps, name=name, key=key, job_priority=job_priority, deadline=deadline,
                                 max_attempts=max_attempts, tile_px=tile_px, after=needs, out=out, timeout=timeout, **fields).id
        return await self._client._do(work)

    async def get(self, id: str, *, timeout: Optional[float] = None) -> JobState:
        """See `Jobs.get`."""
        return await self._client._do(lambda c: c.jobs.get(id, timeout=timeout))

    async def list(self, *, states: Iterable[str] = (), client: str = "", timeout: Optional[float] = None) -> List[JobState]:
        """See `Jobs.list`."""
        return await self._client._do(lambda c: c.jobs.list(states=states, client=client, timeout=timeout))

    def watch(self, id: str, *, timeout: Optional[float] = None) -> AsyncStream[JobState]:
        """See `Jobs.watch`."""
        return self._client._stream(lambda c, stop: c.jobs.watch(id, timeout=timeout, cancel=stop))

    async def wait(self, id: str, timeout: Optional[float] = None) -> JobState:
        """See `Job.wait`."""
        return await self._client._do(lambda c: Job(c.jobs, id).wait(timeout))

    async def cancel(self, id: str, *, timeout: Optional[float] = None) -> JobState:
        """See `Jobs.cancel`."""
        return await self._client._do(lambda c: c.jobs.cancel(id, timeout=timeout))

    async def pause(self, id: str, *, timeout: Optional[float] = None) -> JobState:
        """See `Jobs.pause`."""
        return await self._client._do(lambda c: c.jobs.pause(id, timeout=timeout))

    async def resume(self, id: str, *, timeout: Optional[float] = None) -> JobState:
        """See `Jobs.resume`."""
        return await self._client._do(lambda c: c.jobs.resume(id, timeout=timeout))

    async def retry(self, id: str, *, timeout: Optional[float] = None) -> JobState:
        """See `Jobs.retry`."""
        return await self._client._do(lambda c: c.jobs.retry(id, timeout=timeout))

    async def prioritize(self, id: str, priority: str, *, timeout: Optional[float] = None) -> JobState:
        """See `Jobs.prioritize`."""
        return await self._client._do(lambda c: c.jobs.prioritize(id, priority, timeout=timeout))

    async def depend(self, id: str, after: Iterable[str], *, timeout: Optional[float] = None) -> JobState:
        """See `Jobs.depend`."""
        needs = list(after)
        return await self._client._do(lambda c: c.jobs.depend(id, needs, timeout=timeout))

    async def log(self, id: str, *, frames: Optional[Iterable[int]] = None, after: int = 0, most: int = 0,
                  timeout: Optional[float] = None) -> "List[LogEntry]":
        """See `Jobs.log`."""
        wanted = None if frames is None else list(frames)
        return await self._client._do(lambda c: c.jobs.log(id, frames=wanted, after=after, most=most, timeout=timeout))

    async def delete(self, id: str, *, timeout: Optional[float] = None) -> None:
        """See `Jobs.delete`."""
        await self._client._do(lambda c: c.jobs.delete(id, timeout=timeout))

    async def fetch(self, id: str, folder: "str | os.PathLike[str]", *, frames: Optional[Iterable[int]] = None,
                    outputs: Optional[Iterable[str]] = None, timeout: Optional[float] = None) -> "List[str]":
        """See `Jobs.fetch`."""
        return await self._client._do(lambda c: c.jobs.fetch(id, folder, frames=frames, outputs=outputs, timeout=timeout))

    async def images(self, id: str, output: Optional[str] = None, *, timeout: Optional[float] = None) -> "Dict[int, np.ndarray]":
        """Every finished frame's array by its number: see `Jobs.images`."""
        return await self._client._do(lambda c: dict(c.jobs.images(id, output, timeout=timeout)))


class AsyncClient:
    """A `Client` in a loop. Its calls begin when they are awaited; tasks and loops may share it.

    Attributes:
        client: the plain client, or None before the first call of a client that is not connected yet.
        scenes: `AsyncScenes`.
        jobs: `AsyncJobs`.
    """

    def __init__(self, client: "_client.Client | Callable[[], _client.Client]") -> None:
        self.client = client if isinstance(client, _client.Client) else None
        self._make: Optional[Callable[[], _client.Client]] = None if isinstance(client, _client.Client) else client
        self._lock = threading.Lock()
        self.scenes = AsyncScenes(self)
        self.jobs = AsyncJobs(self)

    def _get(self) -> _client.Client:
        with self._lock:
            if self.client is None:
                if self._make is None:
                    raise errors.Cancelled("this client is closed")
                self.client = self._make()
            return self.client

    async def _do(self, work: Callable[[_client.Client], T]) -> T:
        return await _call(lambda: work(self._get()))

    def _stream(self, make: Callable[[_client.Client, Cancellation], Stream[T]]) -> AsyncStream[T]:
        return AsyncStream(lambda stop: make(self._get(), stop))

    async def render(self, scene: Source = None, *, timeout: Optional[float] = None, on_progress: Optional[ProgressCallback] = None,
                     **fields: "Unpack[RequestFields]") -> Result:
        """See `Client.render`; `on_progress` is called in the loop."""
        post = _progress(on_progress)
        return await self._do(lambda c: c.render(scene, timeout=timeout, on_progress=post, **fields))

    def render_progressive(self, scene: Source = None, *, timeout: Optional[float] = None, **fields: "Unpack[RequestFields]") -> AsyncStream[Result]:
        """See `Client.render_progressive`."""
        return self._stream(lambda c, stop: c.render_progressive(scene, timeout=timeout, cancel=stop, **fields))

    async def relight(self, render_id: Union[str, Result], *, timeout: Optional[float] = None, on_progress: Optional[ProgressCallback] = None,
                      **fields: "Unpack[RequestFields]") -> Result:
        """See `Client.relight`; `on_progress` is called in the loop."""
        post = _progress(on_progress)
        return await self._do(lambda c: c.relight(render_id, timeout=timeout, on_progress=post, **fields))

    def relight_progressive(self, render_id: Union[str, Result], *, timeout: Optional[float] = None,
                            **fields: "Unpack[RequestFields]") -> AsyncStream[Result]:
        """See `Client.relight_progressive`."""
        return self._stream(lambda c, stop: c.relight_progressive(render_id, timeout=timeout, cancel=stop, **fields))

    async def session(self, scene: Source = None, *, timeout: Optional[float] = None, **fields: "Unpack[RequestFields]") -> AsyncSession:
        """See `Client.session`."""
        return AsyncSession(await self._do(lambda c: c.session(scene, timeout=timeout, **fields)))

    async def plan(self, scene: Source = None, *, timeout: Optional[float] = None, **fields: "Unpack[RequestFields]") -> service_pb2.PlanReply:
        """See `Client.plan`."""
        return await self._do(lambda c: c.plan(scene, timeout=timeout, **fields))

    async def status(self, *, timeout: Optional[float] = None) -> service_pb2.StatusReply:
        """See `Client.status`."""
        return await self._do(lambda c: c.status(timeout=timeout))

    async def drop_caches(self, disk: bool = False, *, type: str = "", scene: str = "", keys: Sequence[str] = (), pinned: bool = False,
                          timeout: Optional[float] = None) -> int:
        """See `Client.drop_caches`."""
        return await self._do(lambda c: c.drop_caches(disk, type=type, scene=scene, keys=keys, pinned=pinned, timeout=timeout))

    async def list_terms(self, *, type: str = "", scene: str = "", keys: Sequence[str] = (), pinned: bool = False,
                         timeout: Optional[float] = None) -> service_pb2.ListTermsReply:
        """See `Client.list_terms`."""
        return await self._do(lambda c: c.list_terms(type=type, scene=scene, keys=keys, pinned=pinned, timeout=timeout))

    async def pin_terms(self, *, type: str = "", scene: str = "", keys: Sequence[str] = (), unpin: bool = False,
                        timeout: Optional[float] = None) -> service_pb2.PinTermsReply:
        """See `Client.pin_terms`."""
        return await self._do(lambda c: c.pin_terms(type=type, scene=scene, keys=keys, unpin=unpin, timeout=timeout))

    async def shutdown(self, *, timeout: Optional[float] = None) -> None:
        """See `Client.shutdown`."""
        await self._do(lambda c: c.shutdown(timeout=timeout))

    async def close(self) -> None:
        """Closes the connection and stops the daemon if this client started it."""
        with self._lock:
            client, self._make = self.client, None
        if client is not None:
            await _call(client.close)

    async def __aenter__(self) -> "AsyncClient":
        await _call(self._get)
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.close()


def connect(*args: Any, **options: Any) -> AsyncClient:
    """`gobo.connect` for asyncio, with the same arguments; it connects at the first call or at `async with`."""
    return AsyncClient(lambda: _client.connect(*args, **options))


def local(**options: Any) -> AsyncClient:
    """`gobo.local` for asyncio, with the same arguments; the daemon starts at the first call or at `async with`."""
    return AsyncClient(lambda: _client.local(**options))


async def relight(result: Result, **fields: "Unpack[RequestFields]") -> Result:
    """`result.relight(...)`, awaited."""
    return await _call(lambda: result.relight(**fields))
