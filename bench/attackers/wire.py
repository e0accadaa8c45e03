# SPDX-License-Identifier: Apache-2.0
"""Calls by hand: channels that share nothing, a token, messages with more bytes than their schema knows."""
import itertools

import grpc

from gobo.v1 import jobs_pb2_grpc, render_pb2, service_pb2, service_pb2_grpc

_numbers = itertools.count()


class Caller:
    """One TCP connection with a token."""

    def __init__(self, address: str, token: str, ca: str = "", cert: str = "", key: str = "") -> None:
        options = [("grpc.use_local_subchannel_pool", 1), ("gobo.caller", next(_numbers)), ("grpc.max_receive_message_length", -1),
                   ("grpc.max_send_message_length", -1), ("grpc.initial_reconnect_backoff_ms", 100), ("grpc.max_reconnect_backoff_ms", 500)]
        read = lambda path: open(path, "rb").read() if path else None
        if ca:
            self.channel = grpc.secure_channel(address, grpc.ssl_channel_credentials(read(ca), read(key), read(cert)), options)
        else:
            self.channel = grpc.insecure_channel(address, options)
        self.metadata = (("authorization", f"Bearer {token}"),) if token else ()
        self.render = service_pb2_grpc.RenderStub(self.channel)
        self.scenes = service_pb2_grpc.ScenesStub(self.channel)
        self.admin = service_pb2_grpc.AdminStub(self.channel)
        self.jobs = jobs_pb2_grpc.JobsStub(self.channel)

    def raw(self, method: str, stream: bool = False):
        """Takes and gives bytes."""
        make = self.channel.unary_stream if stream else self.channel.unary_unary
        return make(f"/gobo.v1.{method}")

    def picture(self, request, timeout: float) -> bytes:
        """The picture of a Render stream; raises grpc.RpcError, ValueError for one that is cut short."""
        data, expected = [], 0
        for event in self.render.Render(request, timeout=timeout, metadata=self.metadata):
            kind = event.WhichOneof("event")
            if kind == "reply":
                expected = sum(i.bytes for i in event.reply.images)
            elif kind == "chunk":
                data.append(event.chunk.data)
        whole = b"".join(data)
        if not expected or len(whole) != expected:
            raise ValueError(f"{len(whole)} bytes of a picture of {expected}")
        return whole

    def upload(self, data: bytes, timeout: float, name: str = "", extension: str = ".glb"):
        def pieces():
            for at in range(0, len(data), 1 << 20):
                message = service_pb2.UploadSceneRequest(data=data[at:at + (1 << 20)])
                if at == 0:
                    message.name, message.extension, message.total_bytes = name, extension, len(data)
                yield message
        return self.scenes.Upload(pieces(), timeout=timeout, metadata=self.metadata)

    def close(self) -> None:
        self.channel.close()


def request(scene="cornell", width=160, height=120, spp=4, seed=0, priority=render_pb2.Scheduling.INTERACTIVE, client=""):
    r = render_pb2.RenderRequest(scene=scene, width=width, height=height, seed=seed)
    r.halt.spp = spp
    r.encoding.format = render_pb2.Encoding.RAW_FLOAT
    r.scheduling.priority = priority
    if client:
        r.scheduling.client = client
    return r


def unknown(count: int, field: int = 15000) -> bytes:
    """A length-delimited field that no schema has."""
    def varint(n):
        out = b""
        while n > 127:
            out += bytes([n & 127 | 128])
            n >>= 7
        return out + bytes([n])
    return varint(field << 3 | 2) + varint(count) + b"u" * count
