# SPDX-License-Identifier: Apache-2.0
"""The connection: channel, token, deadlines, retries. Thread-safe: any thread may call; an iterator belongs to one thread."""
from __future__ import annotations

import ipaddress
import os
import random
import time
from dataclasses import dataclass
from typing import Any, Callable, Iterator, List, Optional, Tuple, Union

import grpc

from . import errors
from .cancellation import Cancellation, current, pause


@dataclass(frozen=True)
class Tls:
    """How to talk TLS. Files are PEM.

    Attributes:
        ca: certificates to trust; None: the system's.
        cert: this client's certificate (mutual TLS), with `key`.
        key: this client's private key.
        server_name: name that the server's certificate must have, if it is not the address's.
    """
    ca: Optional[str] = None
    cert: Optional[str] = None
    key: Optional[str] = None
    server_name: Optional[str] = None

    def credentials(self) -> grpc.ChannelCredentials:
        def read(path: Optional[str]) -> Optional[bytes]:
            if path is None:
                return None
            with open(path, "rb") as file:
                return file.read()
        if (self.cert is None) != (self.key is None):
            raise errors.InvalidArgument("tls: cert and key go together", field="tls")
        return grpc.ssl_channel_credentials(read(self.ca), read(self.key), read(self.cert))


def default_address() -> str:
    """$GOBO_SERVER, else the socket of this user's daemon."""
    return os.environ.get("GOBO_SERVER") or f"unix:/tmp/gobo-{os.getuid()}.sock"


def _is_local(address: str) -> bool:
    if address.startswith(("unix:", "unix-abstract:")):
        return True
    host = address.rsplit(":", 1)[0].strip("[]")
    if host == "localhost":
        return True
    try:   # an address, not a name that begins like one: "127.evil.example" is anybody's
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def _check_socket(address: str) -> None:
    # The default socket lives in a folder where everybody may write: another user's socket is not our daemon.
    if not address.startswith("unix:"):
        return
    try:
        owner = os.lstat(address[len("unix:"):]).st_uid
    except OSError:
        return
    if owner not in (os.getuid(), 0):
        raise errors.PermissionDenied(f'"{address}" belongs to another user: name the server with address=')


class Until(float):
    """Seconds that all calls of one piece of work have together, counted from when this was made."""
    end: float   # by time.monotonic()

    def __new__(cls, seconds: float) -> "Until":
        own = super().__new__(cls, seconds)
        own.end = time.monotonic() + seconds
        return own

    def passes_in(self, seconds: float) -> bool:
        """Whether it is over before a pause of `seconds` is."""
        return time.monotonic() + seconds >= self.end


class Wire:
    """One channel with what every call needs."""

    def __init__(self, address: Optional[str], token: Optional[str], tls: Union[None, bool, str, Tls], timeout: Optional[float],
                 retries: int) -> None:
        if address is None and not os.environ.get("GOBO_SERVER"):
            _check_socket(default_address())
        self.address = address or default_address()
        self.timeout = timeout
        self.retries = retries
        token = token if token is not None else os.environ.get("GOBO_TOKEN")
        if tls is True:
            tls = Tls()
        elif isinstance(tls, (str, os.PathLike)):
            tls = Tls(ca=os.fspath(tls))
        if token and not tls and not _is_local(self.address):
            raise errors.InvalidArgument(f"token: it would go to {self.address} unencrypted; give tls=", field="token")
        if token and not all(0x20 < ord(c) < 0x7f for c in token):
            raise errors.InvalidArgument("token: must be printable ASCII without spaces", field="token")
        self.metadata: List[Tuple[str, str]] = [("authorization", f"Bearer {token}")] if token else []
        options: List[Tuple[str, Any]] = [("grpc.max_receive_message_length", -1), ("grpc.max_send_message_length", -1),
                                          ("grpc.enable_retries", 0), ("grpc.use_local_subchannel_pool", 1),
                                          ("grpc.initial_reconnect_backoff_ms", 200), ("grpc.max_reconnect_backoff_ms", 2000)]
        if tls:
            if tls.server_name:
                options.append(("grpc.ssl_target_name_override", tls.server_name))
            self.channel = grpc.secure_channel(self.address, tls.credentials(), options)
        else:
            self.channel = grpc.insecure_channel(self.address, options)
        self.closed = False

    def close(self) -> None:
        self.closed = True
        self.channel.close()

    def _begin(self, timeout: Optional[float]) -> Optional[float]:
        if self.closed:
            raise errors.Cancelled("this client is closed")
        until = self.until(timeout)
        return None if until is None else until.end

    def until(self, timeout: Optional[float]) -> Optional[Until]:
        """What calls that belong together get as their `timeout`: of `timeout` seconds, else this client's; None: no end. What is one stays itself."""
        seconds = timeout if timeout is not None else self.timeout
        return seconds if seconds is None or isinstance(seconds, Until) else Until(seconds)

    def _left(self, end: Optional[float]) -> Optional[float]:
        return None if end is None else max(end - time.monotonic(), 0.001)

    def _again(self, error: errors.Error, attempt: int, end: Optional[float], cancel: Optional[Cancellation]) -> bool:
        """Sleeps and says True when the server asked for another try and there is time for one."""
        if not isinstance(error, errors.ResourceExhausted) or error.retry_after_ms is None or attempt >= self.retries:
            return False
        # Never earlier than asked for; spread, so that clients that were refused together do not come back together.
        seconds = error.retry_after_ms / 1000 * (1 + 0.25 * random.random())
        if end is not None and time.monotonic() + seconds >= end:
            return False
        pause(seconds, cancel)
        return True

    def unary(self, method: Any, request: Any, timeout: Optional[float] = None, cancel: Optional[Cancellation] = None) -> Any:
        """One request, one reply. `request` may be a function that makes an iterator (client streaming)."""
        end = self._begin(timeout)
        cancel = current(cancel)
        attempt = 0
        while True:
            try:
                message = request() if callable(request) else request
                if cancel is None:
                    return method(message, timeout=self._left(end), metadata=self.metadata)
                return self._cancellable(method, message, end, cancel)
            except grpc.RpcError as e:
                error = self._error(e, cancel)
            except ValueError as e:   # grpc's answer on a closed channel
                raise errors.Cancelled(f"this client is closed: {e}") from None
            if not self._again(error, attempt, end, cancel):
                raise error from None
            attempt += 1

    def _cancellable(self, method: Any, message: Any, end: Optional[float], cancel: Cancellation) -> Any:
        cancel.check()
        call = method.future(message, timeout=self._left(end), metadata=self.metadata)
        remove = cancel._add(call.cancel)
        try:
            return call.result()
        except grpc.FutureCancelledError:
            cancel.check()
            raise errors.Cancelled("the call was cancelled") from None
        finally:
            remove()
            call.cancel()   # no effect on a call that has ended; an interrupt ends it

    def _error(self, error: grpc.RpcError, cancel: Optional[Cancellation]) -> errors.Error:
        if cancel is not None and cancel.cancelled:
            return errors.Cancelled("cancelled by this client")
        return errors.from_rpc(error, self.address)

    def stream(self, method: Callable[..., Any], request: Any, timeout: Optional[float] = None,
               cancel: Optional[Cancellation] = None) -> Iterator[Any]:
        """Events of a server stream. Closing the iterator, KeyboardInterrupt or any other exception cancels the call; so does `cancel`,
        from any thread, and iteration ends with gobo.Cancelled then."""
        end = self._begin(timeout)
        cancel = current(cancel)
        attempt = 0
        while True:
            call = None
            remove: Optional[Callable[[], None]] = None
            started = False
            try:
                if cancel is not None:
                    cancel.check()
                call = method(request, timeout=self._left(end), metadata=self.metadata)
                if cancel is not None:
                    remove = cancel._add(call.cancel)
                for event in call:
                    started = True
                    yield event
                return
            except grpc.RpcError as e:
                error = self._error(e, cancel)
            except ValueError as e:
                if started:
                    raise
                raise errors.Cancelled(f"this client is closed: {e}") from None
            finally:
                if remove is not None:
                    remove()
                if call is not None:
                    call.cancel()   # no effect on a call that has ended
            if started or not self._again(error, attempt, end, cancel):
                raise error from None
            attempt += 1
