#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""How soon a picture of first hits comes while a big render has the machine: bench/beside.py BUILD [--size WxH] [--count N] [SCENE...].

On a daemon of its own: N depth pictures, each of another view (so that nothing is reused), first alone, then while a render of each class that never
ends runs. Milliseconds from sending a request until its bytes are here, over HTTP: median and worst. Reports; decides nothing."""
import argparse
import http.client
import statistics
import threading
import time

import live


def depth_pictures(daemon, scene, size, count, turn):
    times = []
    for i in range(count):
        body = {"scene": scene["id"], "width": size[0], "height": size[1], "outputs": ["depth"], "encoding": {"format": "RAW_HALF"},
                "camera": live.camera(scene, turn + 0.01 * i)}
        begun = time.perf_counter()
        connection, answer = daemon.post("/v1/render", body)
        answer.read()
        times.append(1e3 * (time.perf_counter() - begun))
        connection.close()
    return times


def read_all(answer):
    try:
        for _ in answer.pictures():
            pass
    except http.client.HTTPException:
        pass  # the daemon was stopped


def big_render(daemon, scene, priority):
    body = {"scene": scene["id"], "width": 1280, "height": 720, "halt": {"spp": 1 << 18}, "encoding": {"format": "JPEG"}, "scheduling": {"priority": priority}}
    answer = daemon.stream("/v1/render/stream", body)
    threading.Thread(target=read_all, args=(answer,), daemon=True).start()
    while not daemon.json("/v1/status").get("running"):
        time.sleep(0.01)
    time.sleep(1)
    return answer


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("build")
    parser.add_argument("scenes", nargs="*", default=["cornell", "atrium"])
    parser.add_argument("--size", default="640x480")
    parser.add_argument("--count", type=int, default=20)
    options = parser.parse_args()
    size = tuple(int(n) for n in options.size.split("x"))
    print("scene | beside | median ms | worst ms")
    for name in options.scenes or ["cornell", "atrium"]:
        for priority in (None, "BATCH", "NORMAL", "INTERACTIVE"):
            with live.Daemon(options.build, []) as daemon:
                scene = daemon.json("/v1/scenes", {"source": name})
                depth_pictures(daemon, scene, size, 2, 3)  # builds what all views share
                if priority:
                    _ = big_render(daemon, scene, priority)
                times = depth_pictures(daemon, scene, size, options.count, 0)
                print(f"{name} | {priority or 'nothing'} | {statistics.median(times):.0f} | {max(times):.0f}", flush=True)


if __name__ == "__main__":
    main()
