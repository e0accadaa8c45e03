# SPDX-License-Identifier: Apache-2.0
"""Durable jobs: renders that outlive the connection, this process and the daemon (docs/protocol.md, "Jobs")."""
from __future__ import annotations

import hashlib
import os
import uuid
from dataclasses import dataclass, field
from typing import Any, Iterable, Iterator, List, Optional, Tuple, Union, Unpack

import numpy as np

from . import errors, exr
from .blobs import Environments
from .cancellation import Cancellation, Stream, current, pause
from .fields import Builder, RequestFields, fill
from .scenes import Scene, Scenes
from .v1 import jobs_pb2, jobs_pb2_grpc, render_pb2
from .wire import Until, Wire

#: One frame, (first, last) inclusive, a range, or the fields of FrameRange.
Frames = Union[int, Tuple[int, int], range, "dict[str, Any]", None]
_ENDED = ("done", "failed", "cancelled")


@dataclass(frozen=True)
class FrameState:
    """One frame of a job."""
    frame: int
    state: str               # "queued", "running", "done", "failed", "cancelled"
    attempts: int
    progress: float
    spp: int
    error: str
    files: List[str]         # suggested names, once it is done
    seconds: float
    holder: str = ""         # who renders it, or who finished it


@dataclass(frozen=True)
class JobState:
    """A job as it was when the server answered."""
    id: str
    name: str
    state: str               # "queued", "running", "paused", "done", "failed", "cancelled"
    progress: float          # 0..1 over all frames
    frames_total: int
    frames_done: int
    frames_failed: int
    error: str
    result_bytes: int
    results_expired: bool
    frames: List[FrameState]  # empty in lists and in later events of `watch`
    changed: Optional[FrameState]  # in events of `watch`: the frame that this event is about
    message: jobs_pb2.Job
    waits_for: List[str] = field(default_factory=list)  # ids of jobs that must be done before a frame of this one starts

    @property
    def ended(self) -> bool:
        return self.state in _ENDED


@dataclass(frozen=True)
class LogEntry:
    """One thing that happened to a job, or to a frame of it."""
    sequence: int            # grows
    unix_s: float
    kind: str                # "claimed", "done", "failed", "released", "lost", "set_aside"; of the job "submitted", "paused", ..., "ended"
    frame: Optional[int]     # None: of the job
    part: Optional[int]      # of a frame that is rendered in parts
    holder: str              # who has or had it
    error: str
    seconds: float           # of "done": rendering time
    message: jobs_pb2.JobLogEntry


def _entry(e: jobs_pb2.JobLogEntry) -> LogEntry:
    return LogEntry(e.sequence, e.unix_s, jobs_pb2.JobLogEntry.Kind.Name(e.kind).lower(), e.frame if e.HasField("frame") else None,
                    e.part if e.HasField("part") else None, e.holder, e.error.message, e.seconds, e)


def _frame(f: jobs_pb2.Frame) -> FrameState:
    return FrameState(f.frame, jobs_pb2.Frame.State.Name(f.state).lower(), f.attempts, f.progress, f.spp, f.error.message, [x.name for x in f.files],
                      f.seconds, f.holder)


def _state(j: jobs_pb2.Job, changed: Optional[jobs_pb2.Frame] = None) -> JobState:
    return JobState(j.id, j.spec.name, jobs_pb2.Job.State.Name(j.state).lower(), j.progress, j.frames_total, j.frames_done, j.frames_failed,
                    j.error.message, j.result_bytes, j.results_expired, [_frame(f) for f in j.frames], _frame(changed) if changed else None, j, list(j.waits_for))


def _range(frames: Frames) -> Any:
    if isinstance(frames, bool) or frames is None:
        return None
    if isinstance(frames, range):
        if not frames or frames.step < 1:
            raise errors.InvalidArgument(f"frames = {frames}: must ascend and not be empty", field="frames")
        return {"first": frames[0], "last": frames[-1], "step": frames.step}
    if isinstance(frames, int):
        return {"first": frames, "last": frames}
    if isinstance(frames, dict):
        return frames
    try:
        first, last = frames
    except (TypeError, ValueError):
        raise errors.InvalidArgument(f"frames = {frames!r}: must be a number, (first, last), a range or a dict", field="frames") from None
    return {"first": first, "last": last}


class Job:
    """A handle of one job. The server keeps the state; nothing here goes stale but `submitted`."""

    def __init__(self, jobs: "Jobs", id: str) -> None:
        self._jobs = jobs
        self.id = id

    def state(self) -> JobState:
        """The job as it is now, with all frames."""
        return self._jobs.get(self.id)

    def watch(self, *, timeout: Optional[float] = None, cancel: Optional[Cancellation] = None) -> Stream[JobState]:
        """See `Jobs.watch`."""
        return self._jobs.watch(self.id, timeout=timeout, cancel=cancel)

    def wait(self, timeout: Optional[float] = None, *, cancel: Optional[Cancellation] = None) -> JobState:
        """Waits until the job is done and returns its last state.

        Raises:
            gobo.Error: the job failed (the class is that of its error) or was cancelled (`Cancelled`).
            gobo.DeadlineExceeded: `timeout` seconds passed; the job goes on.
            gobo.Cancelled: `cancel` was; the job goes on.
        """
        timeout = self._jobs._wire.until(timeout)
        for _ in self._jobs.watch(self.id, timeout=timeout, cancel=cancel):
            pass
        last = self._jobs.get(self.id, timeout=timeout)
        if last.state == "failed":
            code = last.message.error.code
            raise errors.make(_CODES.get(code, "UNKNOWN"), f"job {self.id} failed: {last.error}")
        if last.state == "cancelled":
            raise errors.Cancelled(f"job {self.id} was cancelled")
        return last

    def cancel(self) -> JobState:
        return self._jobs.cancel(self.id)

    def pause(self) -> JobState:
        return self._jobs.pause(self.id)

    def resume(self) -> JobState:
        return self._jobs.resume(self.id)

    def retry(self) -> JobState:
        return self._jobs.retry(self.id)

    def prioritize(self, priority: str) -> JobState:
        return self._jobs.prioritize(self.id, priority)

    def depend(self, after: Iterable[str]) -> JobState:
        return self._jobs.depend(self.id, after)

    def log(self, *, frames: Optional[Iterable[int]] = None, after: int = 0, most: int = 0) -> List[LogEntry]:
        """See `Jobs.log`."""
        return self._jobs.log(self.id, frames=frames, after=after, most=most)

    def delete(self) -> None:
        self._jobs.delete(self.id)

    def fetch(self, folder: "str | os.PathLike[str]", *, frames: Optional[Iterable[int]] = None, outputs: Optional[Iterable[str]] = None,
              timeout: Optional[float] = None) -> List[str]:
        """See `Jobs.fetch`."""
        return self._jobs.fetch(self.id, folder, frames=frames, outputs=outputs, timeout=timeout)

    def images(self, output: Optional[str] = None, *, timeout: Optional[float] = None) -> Iterator[Tuple[int, np.ndarray]]:
        """See `Jobs.images`."""
        return self._jobs.images(self.id, output, timeout=timeout)

    def __repr__(self) -> str:
        return f"<gobo.Job {self.id}>"


_CODES = {1: "CANCELLED", 2: "UNKNOWN", 3: "INVALID_ARGUMENT", 4: "DEADLINE_EXCEEDED", 5: "NOT_FOUND", 6: "ALREADY_EXISTS", 7: "PERMISSION_DENIED",
          8: "RESOURCE_EXHAUSTED", 9: "FAILED_PRECONDITION", 10: "ABORTED", 11: "OUT_OF_RANGE", 12: "UNIMPLEMENTED", 13: "INTERNAL",
          14: "UNAVAILABLE", 15: "DATA_LOSS", 16: "UNAUTHENTICATED"}


class Jobs:
    """`client.jobs`."""

    def __init__(self, wire: Wire, scenes: Scenes, environments: Environments) -> None:
        self._wire = wire
        self._environments = environments
        self._scenes = scenes
        self._stub = jobs_pb2_grpc.JobsStub(wire.channel)

    def submit(self, scene: "str | os.PathLike[str] | Scene", *, frames: Frames = None, fps: Optional[float] = None, name: str = "",
               key: Optional[str] = None, job_priority: str = "medium", deadline: Optional[float] = None, max_attempts: Optional[int] = None,
               tile_px: Optional[int] = None, after: Iterable[str] = (), out: str = "", timeout: Optional[float] = None,
               **fields: "Unpack[RequestFields]") -> Job:
        """Submits a durable job; it is on disk when this returns.

        Args:
            frames: one number, (first, last), a range, or None for one frame.
            fps: a frame's animation time is frame / fps.
            key: idempotency key: the same key and the same job give the job that is there. One is made if absent, so that a
                call repeated by this client never makes a second job.
            job_priority: "low", "medium" or "high", between jobs; all of them wait for interactive renders.
            deadline: Unix time after which it fails.
            tile_px: each frame is rendered in squares of this side, by several workers, and put together: the same bits.
            after: ids of jobs that must be done before a frame of this one starts.
            out: the daemon writes each file there too, below its jobs.out_folder, such as "shots/{name}.{frame:04}.{ext}" (docs/protocol.md, "Jobs").
            fields: the request, as for `render`; files are EXR unless `format=` says otherwise.
        """
        timeout = self._wire.until(timeout)
        request = render_pb2.RenderRequest()
        fill(request, self._environments.put_arrays(fields, timeout))
        request.scene = self._scenes.resolve(scene if scene else request.scene, timeout)
        spec = jobs_pb2.JobSpec(request=request)
        builder = Builder(spec)
        values = {"name": name, "key": key if key is not None else uuid.uuid4().hex, "priority": job_priority, "frames": _range(frames),
                  "deadline_unix_s": deadline, "max_attempts": max_attempts, "tile_px": tile_px, "after": [str(id) for id in after] or None,
                  "out": out or None}
        builder.merge(spec, {k: v for k, v in values.items() if v is not None}, "")
        if fps is not None:
            spec.frames.fps = fps
        broken = 0
        while True:   # the key makes repeating safe when the connection breaks before the answer
            try:
                return Job(self, self._wire.unary(self._stub.Submit, spec, timeout).id)
            except errors.Unavailable:
                broken += 1
                seconds = 0.1 * 2 ** broken
                if broken >= 4 or (timeout is not None and timeout.passes_in(seconds)):
                    raise
                pause(seconds, current(None))
            except (errors.PermissionDenied, errors.NotFound) as e:
                if not self._environments.mend(spec.request.environment, e, timeout):   # it has no path after that, so it is not mended again
                    raise

    def get(self, id: str, *, timeout: Optional[float] = None) -> JobState:
        """A job with all its frames."""
        return _state(self._wire.unary(self._stub.Get, jobs_pb2.GetJobRequest(id=id), timeout))

    def list(self, *, states: Iterable[str] = (), client: str = "", timeout: Optional[float] = None) -> List[JobState]:
        """Jobs, newest first; frames are left out."""
        timeout = self._wire.until(timeout)
        request = jobs_pb2.ListJobsRequest(client=client, page_size=1000)
        Builder(request).put("states", [s for s in states])
        found: List[JobState] = []
        while True:
            reply = self._wire.unary(self._stub.List, request, timeout)
            found += [_state(j) for j in reply.jobs]
            if not reply.next_page_token:
                return found
            request.page_token = reply.next_page_token

    def cancel(self, id: str, *, timeout: Optional[float] = None) -> JobState:
        """Stops a job for good; finished frames stay."""
        return _state(self._wire.unary(self._stub.Cancel, jobs_pb2.CancelJobRequest(id=id), timeout))

    def pause(self, id: str, *, timeout: Optional[float] = None) -> JobState:
        """Takes a job out of the queue; frames keep what they have."""
        return _state(self._wire.unary(self._stub.Pause, jobs_pb2.PauseJobRequest(id=id), timeout))

    def resume(self, id: str, *, timeout: Optional[float] = None) -> JobState:
        """Puts a paused job back."""
        return _state(self._wire.unary(self._stub.Resume, jobs_pb2.ResumeJobRequest(id=id), timeout))

    def retry(self, id: str, *, timeout: Optional[float] = None) -> JobState:
        """Failed and cancelled frames wait again, with all their attempts; finished ones stay."""
        return _state(self._wire.unary(self._stub.Retry, jobs_pb2.RetryJobRequest(id=id), timeout))

    def prioritize(self, id: str, priority: str, *, timeout: Optional[float] = None) -> JobState:
        """Gives a job another place between jobs: "low", "medium" or "high"."""
        request = jobs_pb2.PrioritizeJobRequest(id=id)
        Builder(request).put("priority", priority)
        return _state(self._wire.unary(self._stub.Prioritize, request, timeout))

    def depend(self, id: str, after: Iterable[str], *, timeout: Optional[float] = None) -> JobState:
        """What a job waits for from now on, in place of what it waited for: `()` is nothing, all that a job that is over may be told."""
        return _state(self._wire.unary(self._stub.Depend, jobs_pb2.DependRequest(id=id, after=list(after)), timeout))

    def log(self, id: str, *, frames: Optional[Iterable[int]] = None, after: int = 0, most: int = 0, timeout: Optional[float] = None) -> List[LogEntry]:
        """What happened to a job and its frames, oldest first.

        Args:
            frames: of these alone; what is of the job itself is left out then.
            after: entries with a greater sequence only. Of changes made at the same moment one may be seen before another with a smaller
                sequence: who follows asks again for the last seconds.
            most: of the newest; 0: 1000, at most 10000.
        """
        request = jobs_pb2.JobLogRequest(id=id, frames=list(frames or ()), after=after, most=most)
        return [_entry(e) for e in self._wire.unary(self._stub.Log, request, timeout).entries]

    def delete(self, id: str, *, timeout: Optional[float] = None) -> None:
        """Forgets an ended job and its files."""
        self._wire.unary(self._stub.Delete, jobs_pb2.DeleteJobRequest(id=id), timeout)

    def watch(self, id: str, *, timeout: Optional[float] = None, cancel: Optional[Cancellation] = None) -> Stream[JobState]:
        """The job as it is, then every change until it has ended. A stream that breaks is opened again (a daemon may restart).

        `cancel()` and `close()` of what this returns, from any thread, stop watching (see `Stream`); the job goes on. `timeout` counts from this
        call on, whether the server is there or not.
        """
        until = self._wire.until(timeout)
        return Stream(lambda own: self._watch(id, until, own), cancel)

    def _watch(self, id: str, until: Optional[Until], cancel: Cancellation) -> Iterator[JobState]:
        broken = 0
        while True:
            try:
                for event in self._wire.stream(self._stub.Watch, jobs_pb2.WatchJobRequest(id=id), until, cancel):
                    broken = 0
                    yield _state(event.job, event.frame if event.HasField("frame") else None)
                return
            except (errors.Unavailable, errors.Cancelled) as e:
                broken += 1
                self._before_another(id, e, broken, until, cancel)

    def _before_another(self, id: str, error: errors.Error, broken: int, until: Optional[Until], cancel: Optional[Cancellation]) -> None:
        """Pauses before a stream that broke is opened for the `broken`th time after its last message; raises where it is not to be."""
        # A server that is about to close cancels the calls that come too late, so that Cancelled may be its word, and not this side's.
        if cancel is not None:
            cancel.check()
        if broken > 20 or self._wire.closed:
            raise error from None
        seconds = max(min(0.1 * 2 ** broken, 3.0), (error.retry_after_ms or 0) / 1000)
        if until is not None and until.passes_in(seconds):
            raise errors.DeadlineExceeded(f"job {id}: the time is over: {error.message}") from None
        pause(seconds, cancel)

    def fetch(self, id: str, folder: "str | os.PathLike[str]", *, frames: Optional[Iterable[int]] = None,
              outputs: Optional[Iterable[str]] = None, timeout: Optional[float] = None) -> List[str]:
        """Writes the files of finished frames into `folder` and returns their paths.

        A file that is there with the right digest is not fetched again, and one that was cut off goes on where it stopped. `timeout` is of all of
        them together; the client's, without it, of each part of a file: a download may take as long as bytes arrive.
        """
        timeout = None if timeout is None else self._wire.until(timeout)
        os.makedirs(folder, exist_ok=True)
        paths = []
        for frame, file in self._files(id, frames, outputs, timeout):
            name = os.path.basename(file.name)
            if name in ("", ".", "..") or "\0" in name:   # the name comes from outside
                raise errors.DataLoss(f"job {id}: a file of the name {file.name!r}")
            paths.append(os.path.join(os.fspath(folder), name))
            self._file(id, frame, file, paths[-1], timeout)
        return paths

    def images(self, id: str, output: Optional[str] = None, *, timeout: Optional[float] = None) -> Iterator[Tuple[int, np.ndarray]]:
        """(frame, float32 array) of each finished frame: of one output, the first unless named. For EXR and raw jobs.

        `timeout` is each frame's own: what is done with the one before does not count. The client's, without it, is of each part of a frame (see `fetch`).
        """
        seen = set()
        for frame, file in self._files(id, None, [output] if output else None, timeout):
            if frame in seen:
                continue
            seen.add(frame)
            data = b"".join(self._chunks(id, frame, file, 0, timeout))
            if hashlib.sha256(data).hexdigest() != file.sha256:
                raise errors.DataLoss(f"job {id}: frame {frame}: the bytes do not have their digest")
            yield frame, _array(file, data)

    def _files(self, id: str, frames: Optional[Iterable[int]], outputs: Optional[Iterable[str]],
               timeout: Optional[float]) -> List[Tuple[int, jobs_pb2.FrameFile]]:
        job = self.get(id, timeout=timeout).message
        wanted = None if frames is None else set(frames)
        missing = sorted((wanted or set()) - {f.frame for f in job.frames})
        if missing:
            raise errors.InvalidArgument(f"frames = {missing[0]}: job {id} does not have this frame", field="frames")
        named = None if outputs is None else set(outputs)
        request = job.spec.request
        is_exr = request.encoding.format in (render_pb2.Encoding.FORMAT_UNSPECIFIED, render_pb2.Encoding.EXR)
        absent = sorted((named or set()) - ({"layers"} if is_exr and request.encoding.layers else set(request.outputs)))
        if absent:
            raise errors.InvalidArgument(f"outputs = {absent[0]!r}: job {id} has no output of that name", field="outputs")
        if job.results_expired:
            raise errors.NotFound(f"the results of {id} were removed by the daemon's limits (jobs.keep_bytes, jobs.keep_days)")
        return [(f.frame, x) for f in job.frames for x in f.files
                if (wanted is None or f.frame in wanted) and (named is None or x.output in named)]

    def _chunks(self, id: str, frame: int, file: jobs_pb2.FrameFile, offset: int, timeout: Optional[float]) -> Iterator[bytes]:
        until = self._wire.until(timeout)
        patient = timeout is None and until is not None   # the client's own is of each part, so that it ends what stands still, and nothing else
        cancel = current(None)
        broken = 0
        while offset < file.bytes:
            begun = offset
            request = jobs_pb2.FetchRequest(id=id, frames=[frame], outputs=[file.output], offset=offset)
            try:
                for reply in self._wire.stream(self._stub.Fetch, request, until, cancel):
                    if reply.WhichOneof("part") != "chunk":
                        continue
                    if reply.chunk.offset != offset or len(reply.chunk.data) > file.bytes - offset:
                        raise errors.DataLoss(f"job {id}: {file.name}: a chunk at {reply.chunk.offset} where {offset} was due")
                    offset += len(reply.chunk.data)
                    broken = 0
                    yield reply.chunk.data
                    if patient:
                        until = self._wire.until(None)
                if offset < file.bytes:
                    raise errors.DataLoss(f"job {id}: {file.name}: {offset} of {file.bytes} bytes arrived")
            except errors.DeadlineExceeded:   # the call's; what is fetched goes on at any offset
                if not patient or offset == begun:
                    raise
            except (errors.Unavailable, errors.Cancelled) as e:
                broken += 1
                self._before_another(id, e, broken, until, cancel)

    def _file(self, id: str, frame: int, file: jobs_pb2.FrameFile, path: str, timeout: Optional[float]) -> None:
        if os.path.isfile(path) and os.path.getsize(path) == file.bytes and _sha256(path) == file.sha256:
            return
        part = f"{path}.{file.sha256[:16]}.part"
        have = os.path.getsize(part) if os.path.exists(part) else 0
        if have > file.bytes:
            os.unlink(part)
            have = 0
        with open(part, "ab") as target:
            for data in self._chunks(id, frame, file, have, timeout):
                target.write(data)
        if _sha256(part) != file.sha256:
            os.unlink(part)
            raise errors.DataLoss(f"job {id}: {file.name}: the bytes do not have their digest")
        os.replace(part, path)


def _sha256(path: str) -> str:
    digest = hashlib.sha256()
    with open(path, "rb") as file:
        for piece in iter(lambda: file.read(1 << 20), b""):
            digest.update(piece)
    return digest.hexdigest()


def _array(file: jobs_pb2.FrameFile, data: bytes) -> np.ndarray:
    kinds = {render_pb2.Encoding.RAW_FLOAT: "<f4", render_pb2.Encoding.RAW_HALF: "<f2"}
    if file.format in kinds:
        return np.frombuffer(data, kinds[file.format]).reshape(file.height, file.width, -1).astype(np.float32)
    if file.format == render_pb2.Encoding.EXR:
        return exr.decode_image(data, file.name)
    raise errors.FailedPrecondition(f"{file.name} is {render_pb2.Encoding.Format.Name(file.format)}: it has no float values; use fetch",
                                    field="encoding.format")
