#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Many workers of one coordinator, simulated with the times that bench/farm_bench measured. Events, no formulas: a worker claims, renders for an
exponentially distributed time, holds its lease every third of it, sends its picture and completes; calls to the coordinator that touch the store wait for
each other (its writes are one after the other), pictures share its network and disk.

    bench/farm_simulation.py [--write-ms 1.9] [--hold-ms 1.1] [--cpu-ms 1] [--cores 2] [--picture-mb 8] [--net-mb-s 1200] [--disk-mb-s 170] [--lease-s 30]

Prints, for numbers of workers and mean render times, how many frames a second come, the share of the workers' time that is rendering, how long a claim
waits, and how late the latest renewal is (above two thirds of the lease, leases run out).
"""
import argparse
import heapq
import random


class Server:
    """Some servers behind one queue, first come first served."""

    def __init__(self, servers):
        self.free = [0.0] * servers
        heapq.heapify(self.free)
        self.busy = 0.0

    def serve(self, now, seconds):
        start = max(now, heapq.heappop(self.free))
        heapq.heappush(self.free, start + seconds)
        self.busy += seconds
        return start + seconds


def simulate(a, workers, render_s, seconds, seed):
    rng = random.Random(seed)
    store, cpu, pipe = Server(1), Server(a.cores), Server(1)
    events, number = [], 0

    def later(at, what, worker, *more):
        nonlocal number
        number += 1
        heapq.heappush(events, (at, number, what, worker, *more))

    for w in range(workers):
        later(rng.random() * min(10.0, render_s), "claim", w)
    done, rendering, waits, latest = 0, 0.0, [], 0.0
    warm = seconds / 4
    while events:
        now, _, what, worker, *more = heapq.heappop(events)
        if now > seconds:
            break
        if what == "claim":
            end = store.serve(cpu.serve(now, a.cpu_ms * 1e-3), a.write_ms * 1e-3)
            if now > warm:
                waits.append(end - now)
            takes = rng.expovariate(1 / render_s)
            over = end + takes
            if now > warm:
                rendering += max(0.0, min(over, seconds) - end)
            later(over, "put", worker)
            if takes > a.lease_s / 3:
                later(end + a.lease_s / 3, "hold", worker, over)
        elif what == "hold":
            end = store.serve(cpu.serve(now, a.cpu_ms * 1e-3), a.hold_ms * 1e-3)
            latest = max(latest, end - now)
            if end + a.lease_s / 3 < more[0]:
                later(end + a.lease_s / 3, "hold", worker, more[0])
        elif what == "put":
            later(pipe.serve(cpu.serve(now, a.cpu_ms * 1e-3), a.picture_mb / min(a.net_mb_s, a.disk_mb_s)), "complete", worker)
        else:
            end = store.serve(cpu.serve(now, a.cpu_ms * 1e-3), a.write_ms * 1e-3)
            if end > warm and end <= seconds:
                done += 1
            later(end, "claim", worker)
    span = seconds - warm
    waits.sort()
    p99 = waits[int(0.99 * len(waits))] if waits else 0.0
    return done / span, rendering / (workers * span), (waits[len(waits) // 2] if waits else 0.0), p99, latest, store.busy / seconds, pipe.busy / seconds


def main():
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("--write-ms", type=float, default=1.9, help="of a claim or a completion in the store")
    p.add_argument("--hold-ms", type=float, default=1.1, help="of a renewal")
    p.add_argument("--cpu-ms", type=float, default=1.0, help="of any call on a core of the coordinator, beside the store")
    p.add_argument("--cores", type=int, default=2)
    p.add_argument("--picture-mb", type=float, default=8)
    p.add_argument("--net-mb-s", type=float, default=1200)
    p.add_argument("--disk-mb-s", type=float, default=170)
    p.add_argument("--lease-s", type=float, default=30)
    p.add_argument("--seconds", type=float, default=1200)
    p.add_argument("--workers", default="10,100,300,1000,3000")
    p.add_argument("--render-s", default="1,10,60,600")
    a = p.parse_args()
    print("render s  workers  frames/s  of what they could  claim p50    p99  latest hold  store busy  pipe busy")
    for render_s in map(float, a.render_s.split(",")):
        for workers in map(int, a.workers.split(",")):
            rate, share, p50, p99, latest, store, pipe = simulate(a, workers, render_s, max(a.seconds, 6 * render_s), 1)
            print(f"{render_s:8g}  {workers:7d}  {rate:8.2f}  {100 * rate * render_s / workers:17.0f}%  {p50:8.3f}  {p99:6.2f}  {latest:11.2f}  {100 * min(1, store):9.0f}%  {100 * min(1, pipe):8.0f}%")


if __name__ == "__main__":
    main()
