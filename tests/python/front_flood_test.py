# SPDX-License-Identifier: Apache-2.0
"""Floods of calls before the front (front.py). What is counted needs the machine for itself: ctest runs this file beside no other."""
import os
import sys
import threading
import time
import unittest

import grpc

from front import FrontTest, TOKENS, http2
from gobo.v1 import service_pb2, service_pb2_grpc
from support import SMALL


class Floods(FrontTest):
    def test_too_many_calls_have_a_hint(self):   # the last one by its name: the bucket of this address takes seconds to fill again
        channel, metadata = self.raw()
        with channel:
            stub = service_pb2_grpc.AdminStub(channel)
            calls = [stub.GetStatus.future(service_pb2.StatusRequest(), metadata=metadata, timeout=30) for _ in range(600)]
            refused = [c for c in calls if c.code() == grpc.StatusCode.RESOURCE_EXHAUSTED]
            self.assertGreater(len(calls) - len(refused), 150)
            self.assertGreater(len(refused), 0, "nothing was refused")
            self.assertIn(("retry-after-ms", "500"), [(k, v) for k, v in refused[0].trailing_metadata()])

    def test_rapid_reset(self):
        """8 s of requests that are taken back at once, from another address: the daemon does not grow, a victim renders."""
        with self.connect() as client:
            client.render("cornell", **SMALL)
            before, times = self.rss(), []
            attack = http2.RapidReset("127.0.0.1", self.port, "/gobo.v1.Admin/GetStatus", TOKENS["lighting"], os.path.join(self.certs, "ca.pem"),
                                      os.path.join(self.certs, "lighting.pem"), os.path.join(self.certs, "lighting.key"), source="127.0.0.2")
            thread = threading.Thread(target=attack.run, args=(8,))
            thread.start()
            while thread.is_alive():
                begun = time.monotonic()
                client.render("cornell", **SMALL, seed=len(times))
                times.append(time.monotonic() - begun)
                time.sleep(0.02)   # below the address's 100 calls a second on any machine: the next test has its bucket
            thread.join()
            grown = self.rss() - before
        print(f"rapid reset: {attack.sent} streams over {attack.connections} connections; gobod grew by {grown / 2**20:.0f} MiB; "
              f"{len(times)} pictures beside, the slowest {max(times):.2f} s", file=sys.stderr)
        self.assertGreater(attack.sent, 1000, "there was no attack")
        self.assertLess(grown, 200 << 20)
        self.assertGreater(len(times), 8)
        self.assertLess(max(times), 5)


if __name__ == "__main__":
    unittest.main()
