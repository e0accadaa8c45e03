# SPDX-License-Identifier: Apache-2.0
"""What a daemon may hold: its total (engine.memory_bytes), else the limits that it names itself (StatusReply.memory), and gRPC's; else the bounds of
daemon.py's configuration."""
from daemon import BOUNDS_MIB, MIB
from gobo.v1 import service_pb2

BASE_MIB = 192   # program, libraries, threads, built-in scenes: a daemon after its first picture


def configured_total(caller) -> int:
    status = caller.admin.GetStatus(service_pb2.StatusRequest(), timeout=10, metadata=caller.metadata)
    named = sum(h.limit for h in status.memory)
    if status.memory_limit:
        named = min(named, status.memory_limit)
    return named + (BASE_MIB + BOUNDS_MIB["rpc"]) * MIB if named else (sum(BOUNDS_MIB.values()) + BASE_MIB) * MIB
