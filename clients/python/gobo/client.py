# SPDX-License-Identifier: Apache-2.0
"""The client: rendering, relighting, and the way to scenes and jobs."""
from __future__ import annotations

import os
from typing import Any, Callable, Iterator, Optional, Sequence, Union, Unpack

from . import errors
from .blobs import Blobs, Environments
from .cancellation import Cancellation, Stream, current, scope
from .daemon import Daemon
from .fields import RequestFields, fill, whole_of
from .jobs import Jobs
from .pictures import Assembly
from .result import Result
from .scenes import Scene, Scenes
from .session import ErrorCallback, PictureCallback, Session
from .v1 import render_pb2, service_pb2, service_pb2_grpc
from .wire import Tls, Wire

ProgressCallback = Callable[[render_pb2.Progress], Any]


class Progressive(Stream[Result]):
    """Snapshots of one render, each with more samples; the last item is the final result (`final` is True).

    Iterate it in one thread. Leaving the loop early, `close()`, Ctrl-C or the end of a `with` block ends the render; so do `close()` and
    `cancel()` in any other thread (see `Stream`).
    """

    def __enter__(self) -> "Progressive":
        return self

    def __iter__(self) -> "Progressive":
        return self


class Client:
    """A connection to a gobod. Threads may share it; use it as a context manager or call `close`.

    Attributes:
        scenes: `Scenes`.
        jobs: `Jobs`.
        blobs: `Blobs`, files for a server that cannot open them; scenes and environments use it by themselves.
        address: where the server is.
    """

    def __init__(self, wire: Wire, daemon: Optional[Daemon] = None, upload_limit: int = 512 << 20) -> None:
        self._wire = wire
        self._daemon = daemon
        self._render = service_pb2_grpc.RenderStub(wire.channel)
        self._admin = service_pb2_grpc.AdminStub(wire.channel)
        self.blobs = Blobs(wire)
        self._environments = Environments(self.blobs)
        self.scenes = Scenes(wire, upload_limit, self.blobs)
        self.jobs = Jobs(wire, self.scenes, self._environments)

    @property
    def address(self) -> str:
        return self._wire.address

    def close(self) -> None:
        """Closes the connection and stops the daemon if this client started it."""
        self._wire.close()
        if self._daemon is not None:
            self._daemon.close()

    def __enter__(self) -> "Client":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def render(self, scene: "str | os.PathLike[str] | Scene | None" = None, *, timeout: Optional[float] = None,
               on_progress: Optional[ProgressCallback] = None, cancel: Optional[Cancellation] = None,
               **fields: "Unpack[RequestFields]") -> Result:
        """Renders a scene: a file, the id of a loaded scene, a built-in name, or a `Scene`.

        A .glb or .gltf, or an environment's .hdr or .exr, that the server cannot open is sent to it. `env` may also be an array (height, width, 3) of linear
        radiance, a lat-long map. Keywords are fields of the request (`RequestFields`); those of
        nested messages as dicts, by `set={"integrator.max_bounces": 2}`, or as `integrator__max_bounces=2`:

            r = client.render("scene.glb", env="studio.hdr", size=(640, 480), spp=256, lights={"key": {"color": (1, 0.5, 0.2)}})

        Args:
            timeout: seconds for everything, waiting for the server included; None: the client's.
            on_progress: called with `Progress` messages (stage, fraction of the pass, spp, elapsed_ms) while it renders.
            cancel: ends it from another thread (gobo.Cancelled).

        Raises:
            gobo.Error: see its subclasses. KeyboardInterrupt cancels the render and goes on.
        """
        timeout = self._wire.until(timeout)
        request = self._request(scene, fields, timeout, cancel)
        method = self._render.Render if on_progress is None else self._render.RenderProgressive
        if not request.scheduling.HasField("ladder"):
            request.scheduling.ladder = False  # nobody sees early pictures
        return self._last(self._stream(method, request, timeout, cancel), on_progress)

    def render_progressive(self, scene: "str | os.PathLike[str] | Scene | None" = None, *, timeout: Optional[float] = None,
                           on_progress: Optional[ProgressCallback] = None, cancel: Optional[Cancellation] = None,
                           **fields: "Unpack[RequestFields]") -> Progressive:
        """Like `render`, but yields valid pictures on the way. A slow consumer misses snapshots, never the last one. `timeout` counts from this call on.

            for snapshot in client.render_progressive("cornell", spp=256):
                print(snapshot.samples, snapshot.image.mean())
        """
        timeout = self._wire.until(timeout)
        return self._snapshots(self._request(scene, fields, timeout, cancel), timeout, on_progress, cancel)

    def plan(self, scene: "str | os.PathLike[str] | Scene | None" = None, *, timeout: Optional[float] = None, cancel: Optional[Cancellation] = None,
             **fields: "Unpack[RequestFields]") -> service_pb2.PlanReply:
        """What `render` of the same would do, without doing it: `plan` (nodes with expected ms and rays, results that are there already), `ms`, `rays`,
        `pinned_bytes`, the beauty's error to be expected from pictures rendered before (`rmse`, `standard_error`, `error_from`; 0 and empty where nothing
        is known), where `ms` was learned (`time_from`), and `resolved`, the request with every default filled in.
        """
        timeout = self._wire.until(timeout)
        request = self._request(scene, fields, timeout, cancel)
        try:
            return self._wire.unary(self._render.Plan, request, timeout, cancel)
        except (errors.PermissionDenied, errors.NotFound) as e:
            if not self._mend(request.environment, e, timeout, cancel):
                raise
        return self._wire.unary(self._render.Plan, request, timeout, cancel)

    def relight(self, render_id: Union[str, Result], *, timeout: Optional[float] = None, on_progress: Optional[ProgressCallback] = None,
                cancel: Optional[Cancellation] = None, **fields: "Unpack[RequestFields]") -> Result:
        """Renders an earlier request again with changes; the server recomputes what they change and nothing else.

        Keywords are those of `render`. `lights={"key": None}` undoes an edit of that light. `env=` replaces the environment as a
        whole; `set={"environment.rotation_deg": 90}` turns the one that is there.
        """
        timeout = self._wire.until(timeout)
        request = self._relight(render_id, fields, timeout, cancel)
        request.progressive = on_progress is not None
        return self._last(self._stream(self._render.Relight, request, timeout, cancel), on_progress)

    def relight_progressive(self, render_id: Union[str, Result], *, timeout: Optional[float] = None, on_progress: Optional[ProgressCallback] = None,
                            cancel: Optional[Cancellation] = None, **fields: "Unpack[RequestFields]") -> Progressive:
        """Like `relight`, but yields valid pictures on the way, as `render_progressive` does."""
        timeout = self._wire.until(timeout)
        request = self._relight(render_id, fields, timeout, cancel)
        request.progressive = True
        return Progressive(lambda own: self._results(self._stream(self._render.Relight, request, timeout, own), on_progress), cancel)

    def session(self, scene: "str | os.PathLike[str] | Scene | None" = None, *, on_picture: Optional[PictureCallback] = None,
                on_error: Optional[ErrorCallback] = None, timeout: Optional[float] = None, **fields: "Unpack[RequestFields]") -> Session:
        """A picture that follows edits, for sliders and drags: see `Session`.

            with client.session("scene.glb", size=(640, 480), spp=64) as s:
                s.edit(lights={"key": {"intensity": 3}})
                for picture in s.pictures():
                    ...

        Args:
            on_picture: called with each picture, in the session's thread.
            on_error: called with each gobo.Error of a render, in the session's thread.
            timeout: seconds that each render may take, and what is sent before the first one.
        """
        return Session(self._request(scene, fields, self._wire.until(timeout)), lambda request, stop: self._snapshots(request, timeout, None, stop),
                       on_picture, on_error, lambda edits: self._environments.put_arrays(edits, timeout))

    def status(self, *, timeout: Optional[float] = None) -> service_pb2.StatusReply:
        """Version, uptime, memory, what runs and waits."""
        return self._wire.unary(self._admin.GetStatus, service_pb2.StatusRequest(), timeout)

    def drop_caches(self, disk: bool = False, *, type: str = "", scene: str = "", keys: Sequence[str] = (), pinned: bool = False,
                    timeout: Optional[float] = None) -> int:
        """Empties the server's term store, for every client; returns the bytes freed. `type`, `scene`, `keys`: of these terms alone, as in `list_terms`.
        Pinned terms stay unless `pinned`."""
        request = service_pb2.DropCachesRequest(disk=disk, pinned=pinned, which=_selector(type, scene, keys))
        return self._wire.unary(self._admin.DropCaches, request, timeout).bytes

    def list_terms(self, *, type: str = "", scene: str = "", keys: Sequence[str] = (), pinned: bool = False,
                   timeout: Optional[float] = None) -> service_pb2.ListTermsReply:
        """What the server's term store holds, in memory and on disk: `terms` (all pages), `totals` by type, bounds. Without the admin right `terms` is empty
        (`totals_only`).

        Args:
            type: kind of node that makes them; `*` stands for any letters: "*transfer*".
            scene: id of the scene for which they were made.
            keys: digests, or their first 6 digits or more.
            pinned: pinned ones alone.
        """
        timeout = self._wire.until(timeout)
        request = service_pb2.ListTermsRequest(which=_selector(type, scene, keys), pinned=pinned, page_size=1000)
        whole = self._wire.unary(self._admin.ListTerms, request, timeout)
        page = whole
        while page.next_page_token:
            request.page_token = page.next_page_token
            page = self._wire.unary(self._admin.ListTerms, request, timeout)
            whole.terms.extend(page.terms)
        whole.next_page_token = ""
        return whole

    def pin_terms(self, *, type: str = "", scene: str = "", keys: Sequence[str] = (), unpin: bool = False,
                  timeout: Optional[float] = None) -> service_pb2.PinTermsReply:
        """Keeps terms from being evicted for room, or no longer; chosen as in `list_terms`, and something must be given. Pins of terms that are on disk
        outlive the server; `memory_only` counts the others. Errors: FailedPrecondition beyond half of the store."""
        return self._wire.unary(self._admin.PinTerms, service_pb2.PinTermsRequest(which=_selector(type, scene, keys), unpin=unpin), timeout)

    def shutdown(self, *, timeout: Optional[float] = None) -> None:
        """Asks the server to drain and stop (Unix socket only)."""
        self._wire.unary(self._admin.Shutdown, service_pb2.ShutdownRequest(), timeout)

    def _relight(self, render_id: Union[str, Result], fields: Any, timeout: Optional[float], cancel: Optional[Cancellation]) -> render_pb2.RelightRequest:
        request = render_pb2.RelightRequest(render_id=render_id.render_id if isinstance(render_id, Result) else render_id)
        with scope(current(cancel)):
            fields = self._environments.put_arrays(fields, timeout)
        builder = fill(request.patch, fields)
        mask = builder.mask(whole_of(fields))
        if not request.patch.encoding.format:
            request.patch.encoding.format = render_pb2.Encoding.RAW_FLOAT
            if not {"encoding", "encoding.format"} & set(mask):
                mask.append("encoding.format")
        request.mask.extend(mask)
        return request

    def _snapshots(self, request: render_pb2.RenderRequest, timeout: Optional[float], on_progress: Optional[ProgressCallback],
                   cancel: Optional[Cancellation]) -> Progressive:
        return Progressive(lambda own: self._results(self._stream(self._render.RenderProgressive, request, timeout, own), on_progress), cancel)

    def _stream(self, method: Callable[..., Any], request: Any, timeout: Optional[float], cancel: Optional[Cancellation]) -> Iterator[render_pb2.RenderEvent]:
        timeout = self._wire.until(timeout)   # of a session it is each render's own
        relight = isinstance(request, render_pb2.RelightRequest)
        try:
            yield from self._wire.stream(method, request, timeout, cancel)
            return
        except (errors.PermissionDenied, errors.NotFound) as e:   # before the first event
            if not self._mend(request.patch.environment if relight else request.environment, e, timeout, cancel):
                raise
        if relight and "environment.path" in request.mask:
            request.mask.append("environment.digest")
        yield from self._wire.stream(method, request, timeout, cancel)

    def _mend(self, settings: render_pb2.EnvironmentSettings, error: errors.Error, timeout: Optional[float], cancel: Optional[Cancellation]) -> bool:
        with scope(current(cancel)):
            return self._environments.mend(settings, error, timeout)

    def _request(self, scene: Any, fields: Any, timeout: Optional[float], cancel: Optional[Cancellation] = None) -> render_pb2.RenderRequest:
        request = render_pb2.RenderRequest()
        with scope(current(cancel)):
            fill(request, self._environments.put_arrays(fields, timeout))
        if not request.encoding.format:
            request.encoding.format = render_pb2.Encoding.RAW_FLOAT
        if scene is None:
            scene = request.scene
        if not scene:
            raise errors.InvalidArgument("scene: name a file, a loaded scene or a built-in one", field="scene")
        request.scene = self.scenes.resolve(scene, timeout, cancel)
        return request

    def _results(self, events: Iterator[render_pb2.RenderEvent], on_progress: Optional[ProgressCallback],
                 snapshots: bool = True) -> Iterator[Result]:
        assembly: Optional[Assembly] = None
        final = False
        try:
            for event in events:
                kind = event.WhichOneof("event")
                if kind == "progress":
                    if on_progress is not None:
                        on_progress(event.progress)
                elif kind in ("snapshot", "reply"):
                    final = kind == "reply"
                    assembly = Assembly(event.reply if final else event.snapshot)
                elif kind == "chunk":
                    if assembly is None:
                        raise errors.DataLoss("the server's answer is damaged: a chunk before any picture")
                    assembly.add(event.chunk)
                else:
                    continue   # events of later versions
                if assembly is not None and not final and snapshots and kind != "progress" and assembly.complete:
                    yield Result(self, assembly, False)
                    assembly = None
            if assembly is None or not final:
                raise errors.DataLoss("the server's answer is damaged: it ended without a reply")
            yield Result(self, assembly, True)
        finally:
            events.close()  # type: ignore[attr-defined]

    def _last(self, events: Iterator[render_pb2.RenderEvent], on_progress: Optional[ProgressCallback]) -> Result:
        *_, last = self._results(events, on_progress, snapshots=False)
        return last


def _selector(type: str, scene: str, keys: Sequence[str]) -> Optional[service_pb2.TermSelector]:
    return service_pb2.TermSelector(type=type, scene=scene, key=keys) if type or scene or keys else None


def connect(address: Optional[str] = None, token: Optional[str] = None, tls: Union[None, bool, str, Tls] = None, *, start: bool = False,
            timeout: Optional[float] = None, retries: int = 8, upload_limit: int = 512 << 20) -> Client:
    """Connects to a gobod.

    Args:
        address: "unix:PATH" or "HOST:PORT"; None: $GOBO_SERVER, else unix:/tmp/gobo-UID.sock.
        token: sent as `authorization: Bearer TOKEN`; None: $GOBO_TOKEN. Refused without `tls` unless the server is on this machine.
        tls: True (the system's certificates), the path of a CA certificate, or `Tls(...)` for mutual TLS.
        start: start a private daemon instead (`local`).
        timeout: seconds that each call may take, with all that it sends and asks for, unless it says otherwise; of `jobs.fetch` and `jobs.images` each part
            of a file; None: any.
        retries: how often a call that found the server busy is tried again, never earlier than the server asked for.
        upload_limit: bytes of the largest scene file that is uploaded without being asked for.

    Raises:
        gobo.Unavailable: nobody listens there.
    """
    if start:
        return local(timeout=timeout, retries=retries, upload_limit=upload_limit)
    client = Client(Wire(address, token, tls, timeout, retries), None, upload_limit)
    try:
        client.status(timeout=20.0 if timeout is None else timeout)
    except BaseException:
        client.close()
        raise
    return client


def local(*, roots: Optional[Sequence["str | os.PathLike[str]"]] = None, threads: int = 0, cache: "str | os.PathLike[str] | None" = None,
          jobs: "str | os.PathLike[str] | None" = None, config: "str | os.PathLike[str] | None" = None, gobod: Optional[str] = None,
          args: Sequence[str] = (), timeout: Optional[float] = None, retries: int = 8, upload_limit: int = 512 << 20) -> Client:
    """Starts a private gobod on a socket of its own and connects to it; `close` stops it, and so does the end of this process.

    It may open any file that you may, unless `roots` or a `config` file say otherwise; `config` and `args` go to gobod as they are.
    `jobs` is the folder of durable jobs, `cache` that of the disk cache; both may be used again by a later daemon.
    """
    if roots is None:
        roots = () if config is not None else ("/",)
    daemon = Daemon(roots=roots, threads=threads, cache=cache, jobs=jobs, config=config, gobod=gobod, args=args)
    try:
        return Client(Wire(daemon.address, None, None, timeout, retries), daemon, upload_limit)
    except BaseException:
        daemon.close()
        raise
