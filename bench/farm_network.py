#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""A farm over a network: a coordinator, and workers each in a network namespace of its own, joined by a bridge. While they render, workers and the coordinator
are killed with -9, workers are frozen for longer than their leases or cut off from the network for as long, packets are lost, the coordinator's disk is full,
and its PostgreSQL is killed and started again. In the end every frame must be there once, with the bits of a render by one process.

    bench/farm_network.py [--build build] [--faults 100] [--workers 4] [--seed 1] [--loss PERCENT] [--postgres]

Needs root (namespaces, a mount), iproute2 and, for --loss, nftables. Nothing of it is seen outside the namespaces that it makes for itself.
"""
import argparse
import os
import pathlib
import pwd
import random
import shutil
import subprocess
import sys
import tempfile
import time

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
import farm_kill  # noqa: E402

DISK = 48 << 20   # bytes of the coordinator's folder


def run(*words, **more):
    return subprocess.run([str(w) for w in words], check=True, **more)


class Postgres:
    """A server of this run's own, as a user who is not root."""

    def __init__(self, folder):
        self.folder = pathlib.Path(folder)
        self.user = pwd.getpwnam("postgres" if "postgres" in [p.pw_name for p in pwd.getpwall()] else "nobody")
        self.programs = sorted(pathlib.Path("/usr/lib/postgresql").glob("*/bin"))[-1]
        os.chown(self.folder, self.user.pw_uid, self.user.pw_gid)
        self.command("initdb", "-D", "data", "-U", "gobo", "-A", "trust", "-E", "UTF8", "--no-locale").wait()
        self.process = None
        self.start()

    def command(self, program, *words):
        log = open(self.folder / "postgres.log", "ab")
        return subprocess.Popen([str(self.programs / program), *words], cwd=self.folder, stdout=log, stderr=log, user=self.user.pw_uid, group=self.user.pw_gid)

    def uri(self):
        return f"postgresql://gobo@/postgres?host={self.folder}"

    def start(self):
        self.process = self.command("postgres", "-D", "data", "-k", str(self.folder), "-c", "listen_addresses=", "-c", "max_connections=200")
        while subprocess.run([self.programs / "pg_isready", "-q", "-h", self.folder], check=False).returncode:
            time.sleep(0.05)

    def kill(self):
        self.process.kill()
        self.process.wait()
        time.sleep(0.3)     # its children notice
        (self.folder / "data/postmaster.pid").unlink(missing_ok=True)

    def end(self):
        self.process.terminate()
        self.process.wait(30)


class NetworkFarm(farm_kill.Farm):
    def __init__(self, build, folder, store=""):
        super().__init__(build, folder, store)
        self.address = "10.77.0.1:7001"
        toml = self.folder / "gobod.toml"
        text = toml.read_text().replace(f"unix:{self.folder}/c.sock", self.address).replace('folder = "jobs"', 'folder = "disk/jobs"')
        toml.write_text("allow_remote = true\n" + text)
        (self.folder / "disk").mkdir()
        run("mount", "-t", "tmpfs", "-o", f"size={DISK}", "none", self.folder / "disk")
        run("ip", "link", "add", "name", "br0", "type", "bridge")
        run("ip", "addr", "add", "10.77.0.1/24", "dev", "br0")
        for device in ("lo", "br0"):
            run("ip", "link", "set", device, "up")
        self.places = {}

    def hire(self, number):
        if number not in self.places:
            place = subprocess.Popen(["unshare", "-n", "sleep", "infinity"])
            while os.readlink(f"/proc/{place.pid}/ns/net") == os.readlink("/proc/self/ns/net"):
                time.sleep(0.01)
            run("ip", "link", "add", "name", f"h{number}", "type", "veth", "peer", "name", "eth0", "netns", place.pid)
            run("ip", "link", "set", f"h{number}", "master", "br0", "up")
            inside = ["nsenter", "-t", place.pid, "-n"]
            run(*inside, "ip", "addr", "add", f"10.77.0.{10 + number}/24", "dev", "eth0")
            run(*inside, "ip", "link", "set", "eth0", "up")
            self.places[number] = place
        log = open(self.folder / f"w{number}.log", "ab")
        self.workers[number] = subprocess.Popen(
            ["nsenter", "-t", str(self.places[number].pid), "-n", str(self.build / "server/gobod"), "--worker", self.address, "--worker-name", f"w{number}",
             "--threads", "1", "--tmp", str(self.folder)], stdout=log, stderr=log, stdin=subprocess.DEVNULL)

    def cut(self, number, seconds):
        run("ip", "link", "set", f"h{number}", "down")
        time.sleep(seconds)
        run("ip", "link", "set", f"h{number}", "up")

    def lose(self, percent):
        chains = "".join(f"chain {name} {{ type filter hook {hook} priority 0; {which} \"br0\" numgen random mod 100 < {percent} drop; }}\n"
                         for name, hook, which in (("inward", "input", "iifname"), ("outward", "output", "oifname")))
        run("nft", "-f", "-", input=f"table inet lossy {{\n{chains}}}\n".encode())

    def fill(self, seconds):
        free = shutil.disk_usage(self.folder / "disk").free
        filler = self.folder / "disk/filler"
        with open(filler, "wb") as file:
            os.posix_fallocate(file.fileno(), 0, max(4096, free - 4096))
        time.sleep(seconds)
        filler.unlink()

    def end(self):
        super().end()
        for place in self.places.values():
            place.kill()
            place.wait()
        run("umount", self.folder / "disk")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--build", default="build")
    parser.add_argument("--faults", type=int, default=100)
    parser.add_argument("--workers", type=int, default=4)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--loss", type=int, default=0, help="percent of the packets, each way, all the time")
    parser.add_argument("--postgres", action="store_true", help="the job store is one; it is killed, too")
    parser.add_argument("--inside", action="store_true", help=argparse.SUPPRESS)
    args = parser.parse_args()
    if not args.inside:   # nothing of this is to be seen by anybody else, and nothing outlives it
        return subprocess.run(["unshare", "-n", "-m", "-p", "-f", "--mount-proc", "--propagation", "private", sys.executable, *sys.argv, "--inside"],
                              check=False).returncode
    random_ = random.Random(args.seed)
    with tempfile.TemporaryDirectory(prefix="gobo-network-", ignore_cleanup_errors=True) as folder, \
            tempfile.TemporaryDirectory(prefix="gobo-pg-", ignore_cleanup_errors=True) as database:
        server = Postgres(database) if args.postgres else None
        farm = NetworkFarm(args.build, folder, server.uri() if server else "")
        farm.start()
        for n in range(args.workers):
            farm.hire(n)
        if args.loss:
            farm.lose(args.loss)
        kinds = ["worker", "worker", "coordinator", "freeze", "cut", "disk"] + (["database"] if server else [])
        jobs, counts, begun = [], dict.fromkeys(kinds, 0), time.monotonic()
        for fault in range(args.faults):
            if fault % 8 == 0:
                jobs.append(farm.submit(f"shot-{len(jobs)}", 6, random_.choice([256, 512, 1024]), more=() if len(jobs) % 2 else ("--tile-px", "16")))
            time.sleep(random_.uniform(0.02, 0.6))
            kind, number = random_.choice(kinds), random_.choice(list(farm.workers))
            counts[kind] += 1
            print(f"{time.monotonic() - begun:.1f} s: {kind} {number}", file=sys.stderr)
            if kind == "worker":
                farm.workers[number].kill()
                farm.workers[number].wait()
                farm.hire(number)
            elif kind == "coordinator":
                farm.coordinator.kill()
                farm.coordinator.wait()
                farm.start()
            elif kind == "freeze":
                farm.workers[number].send_signal(19)
                time.sleep(random_.uniform(0.5, 3))
                farm.workers[number].send_signal(18)
            elif kind == "cut":
                farm.cut(number, random_.uniform(0.5, 4))
            elif kind == "disk":
                farm.fill(random_.uniform(0.5, 2))
            else:
                server.kill()
                time.sleep(random_.uniform(0, 1))
                server.start()
        told, bad = farm_kill.verdict(farm, jobs, begun)
        farm.end()
        if server:
            server.end()
    print(f"{args.workers} workers in namespaces of their own, {args.loss} % of packets lost, {'PostgreSQL' if args.postgres else 'SQLite'}: "
          f"{', '.join(f'{n} {kind}' for kind, n in counts.items())}; {told}")
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
