# SPDX-License-Identifier: Apache-2.0
"""Errors: one class per gRPC code, with the field or file that the server named.

Every error of this package is a `gobo.Error`. Those with a natural builtin parent have it too (`InvalidArgument` is a
`ValueError`, `NotFound` a `LookupError`, `DeadlineExceeded` a `TimeoutError`).
"""
from __future__ import annotations

import re
from typing import Dict, Optional, Type

import grpc

_FIELD = re.compile(r"^(?P<field>[a-z_][\w\-]*(?:[.\[][^\s=]*)?) = (?P<value>.*?): ", re.IGNORECASE | re.DOTALL)
_PLACE = re.compile(r" \(at (?P<place>[^()]*(?:\([^()]*\)[^()]*)*)\)$")


class Error(Exception):
    """What a call failed with.

    Attributes:
        code: gRPC code name, such as "NOT_FOUND".
        message: the server's text.
        field: path of the request field that is at fault ("integrator.max_bounces"), or None.
        place: where in which file ("scene.gltf: /meshes/0"), or the field as the server wrote it, or None.
        value: the value at fault as text, or None.
        retry_after_ms: the server's hint when trying again may help, else None.
    """

    code: str = "UNKNOWN"

    def __init__(self, message: str, *, field: Optional[str] = None, place: Optional[str] = None, value: Optional[str] = None,
                 retry_after_ms: Optional[float] = None) -> None:
        super().__init__(message)
        self.message = message
        self.field = field
        self.place = place
        self.value = value
        self.retry_after_ms = retry_after_ms

    def __str__(self) -> str:
        return f"{self.code}: {self.message}"


class InvalidArgument(Error, ValueError):
    """A field is out of range, unknown or malformed, or a file is damaged."""
    code = "INVALID_ARGUMENT"


class NotFound(Error, LookupError):
    """No such scene, render, job or file."""
    code = "NOT_FOUND"


class AlreadyExists(Error):
    """The name is taken."""
    code = "ALREADY_EXISTS"


class PermissionDenied(Error):
    """A path outside the server's roots, or a call that this client may not make."""
    code = "PERMISSION_DENIED"


class Unauthenticated(Error):
    """The server wants a token (or another one)."""
    code = "UNAUTHENTICATED"


class FailedPrecondition(Error):
    """The state does not allow it: another scene hash, a plan that can never fit, a job that has ended."""
    code = "FAILED_PRECONDITION"


class ResourceExhausted(Error):
    """Busy (`retry_after_ms` is set) or larger than a limit (it is None: trying again does not help)."""
    code = "RESOURCE_EXHAUSTED"


class OutOfRange(Error, ValueError):
    """Beyond what this call can carry."""
    code = "OUT_OF_RANGE"


class Unavailable(Error, ConnectionError):
    """No server there, or it is shutting down."""
    code = "UNAVAILABLE"


class Cancelled(Error):
    """The call was cancelled."""
    code = "CANCELLED"


class DeadlineExceeded(Error, TimeoutError):
    """The deadline passed, waiting time in the server's queue included."""
    code = "DEADLINE_EXCEEDED"


class Aborted(Error):
    """Something else changed the same thing at the same time."""
    code = "ABORTED"


class Unimplemented(Error):
    """The server does not know this call: it is older than this client."""
    code = "UNIMPLEMENTED"


class Internal(Error):
    """A fault of the server."""
    code = "INTERNAL"


class DataLoss(Error):
    """What arrived is not what was sent."""
    code = "DATA_LOSS"


_CLASSES: Dict[str, Type[Error]] = {
    c.code: c for c in (InvalidArgument, NotFound, AlreadyExists, PermissionDenied, Unauthenticated, FailedPrecondition, ResourceExhausted,
                        OutOfRange, Unavailable, Cancelled, DeadlineExceeded, Aborted, Unimplemented, Internal, DataLoss)}


def make(code: str, message: str, retry_after_ms: Optional[float] = None) -> Error:
    """The error of a code name with a server's message: field, value and place are taken from the text."""
    found = _FIELD.match(message)
    at = _PLACE.search(message)
    field = found.group("field") if found else None
    value = found.group("value") if found else None
    place = at.group("place") if at else None
    if field is None and place is not None and re.fullmatch(r"[a-z_][\w\-.\[\]:]*", place):
        field = place
    if field is not None and field.startswith("request."):
        field = field[len("request."):]
    error = _CLASSES.get(code, Error)(message, field=field, place=place, value=value, retry_after_ms=retry_after_ms)
    if type(error) is Error:
        error.code = code
    return error


def from_rpc(error: grpc.RpcError, address: str) -> Error:
    """A gRPC error as ours; one without a connection says where the server was looked for."""
    status = error.code() if callable(getattr(error, "code", None)) else None
    code = status.name if status is not None else "UNKNOWN"
    message = (error.details() if callable(getattr(error, "details", None)) else None) or ""
    if not message:
        message = f"gobod at {address} does not know this call: it is another version" if code == "UNIMPLEMENTED" else f"no details from gobod at {address}"
    hint: Optional[float] = None
    trailers = error.trailing_metadata() if callable(getattr(error, "trailing_metadata", None)) else None
    for key, value in trailers or ():
        if key == "retry-after-ms":
            try:
                hint = float(value)
            except ValueError:
                pass
    if code == "UNAVAILABLE" and "shutting down" not in message:
        message = (f"cannot reach gobod at {address}: {message}; start it with `gobod --root DIR`, name another with address= or "
                   "GOBO_SERVER, or use gobo.local()")
    return make(code, message, hint)
