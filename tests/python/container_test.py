# SPDX-License-Identifier: Apache-2.0
"""What deploy/Containerfile promises: its command with its file and with another, environment variables over the file and below flags, a user, a health check,
folders to write in; and its last stage run as a container: by bubblewrap, since what it is made from lies in a registry, with this machine's libraries in the base's
place and, from what the build installs, the files that the stage copies."""
import glob
import json
import os
import pathlib
import re
import shutil
import signal
import subprocess
import tempfile
import unittest
import time
import urllib.request

import private_root
from support import gltf

SOURCE = pathlib.Path(__file__).resolve().parents[2]
GOBOD = os.environ["GOBO_GOBOD"]


class Container(unittest.TestCase):
    def setUp(self):
        self.folder = pathlib.Path(tempfile.mkdtemp(prefix="gobo-container-"))
        self.addCleanup(shutil.rmtree, self.folder, ignore_errors=True)
        lines = (SOURCE / "deploy/Containerfile").read_text(encoding="utf-8").replace("\\\n", " ").splitlines()
        final = max(i for i, line in enumerate(lines) if line.startswith("FROM "))
        self.steps = [line.split(None, 1) for line in lines[final:] if line and not line.startswith("#")]

    def step(self, name):
        return next((rest for word, rest in self.steps if word == name), None)

    def command(self):
        """The image's words after the program, with the image's places inside the test's folder."""
        words = json.loads(self.step("ENTRYPOINT")) + json.loads(self.step("CMD") or "[]")
        self.assertEqual(words[0], "/usr/bin/gobod")
        return [w.replace("/etc/gobo", str(self.folder)) for w in words[1:]]

    def config(self, text=None):
        if text is None:
            text = (SOURCE / "deploy/container.toml").read_text(encoding="utf-8")
            for place in ("/run/gobo", "/var/cache/gobo"):
                text = text.replace(place, str(self.folder / place.strip("/").replace("/", "-")))
            text = text.replace("127.0.0.1:9464", "127.0.0.1:0")
            (self.folder / "run-gobo").mkdir()
        (self.folder / "gobod.toml").write_text(text, encoding="utf-8")

    def ready(self, *arguments, env=None):
        """Addresses of a daemon that is started with these words; it is stopped again."""
        with subprocess.Popen([GOBOD, *arguments], stdout=subprocess.PIPE, stderr=subprocess.PIPE, env={**os.environ, **(env or {})}) as process:
            line = process.stdout.readline().decode()
            health = None
            for port in re.findall(r"http://127\.0\.0\.1:(\d+)", line)[:1]:
                with urllib.request.urlopen(f"http://127.0.0.1:{port}/ready", timeout=10) as answer:
                    health = answer.status
            process.terminate()
            _, said = process.communicate(timeout=20)
        self.assertIn("ready on", line, said.decode())
        return line, health

    def test_the_command_with_the_image_s_file(self):
        self.config()
        line, health = self.ready(*self.command())
        self.assertIn(f"unix:{self.folder}/run-gobo/gobo.sock", line)
        self.assertEqual(health, 200)
        self.assertTrue((self.folder / "var-cache-gobo").is_dir())

    def test_the_command_listens_where_a_mounted_file_says(self):
        self.config(f'listen = ["unix:{self.folder}/other.sock", "127.0.0.1:0"]\n')
        line, _ = self.ready(*self.command())
        self.assertIn("other.sock", line)
        self.assertRegex(line, r"other\.sock, 127\.0\.0\.1:\d+ ")
        self.assertNotIn("http://", line)   # nor does it listen for HTTP where the file says nothing of it

    def test_the_environment_over_the_file_and_below_flags(self):
        self.config(f'listen = ["unix:{self.folder}/file.sock"]\n')
        line, _ = self.ready(*self.command(), env={"GOBO_LISTEN": f"unix:{self.folder}/env.sock,127.0.0.1:0", "GOBO_WEB": "127.0.0.1:0", "GOBO_HTTP": "127.0.0.1:0"})
        self.assertIn("env.sock", line)
        self.assertNotIn("file.sock", line)
        self.assertEqual(len(re.findall(r"http://", line)), 2)
        line, _ = self.ready(*self.command(), "--listen", f"unix:{self.folder}/flag.sock", env={"GOBO_LISTEN": f"unix:{self.folder}/env.sock"})
        self.assertIn("flag.sock", line)
        self.assertNotIn("env.sock", line)
        line, _ = self.ready(env={"GOBO_CONFIG": str(self.folder / "gobod.toml")})
        self.assertIn("file.sock", line)
        for name, value in (("GOBO_THREADS", "-7"), ("GOBO_THREADS", "x"), ("GOBO_STORE", "4 apples"), ("GOBO_LOG", "loud"), ("GOBO_LISTEN", "nowhere")):
            done = subprocess.run([GOBOD, "--check"], env={**os.environ, name: value}, capture_output=True, text=True, timeout=20)
            self.assertEqual(done.returncode, 2, (name, done.stdout, done.stderr))
            self.assertTrue(value in done.stderr or name.split("_")[1].lower() in done.stderr.lower(), (name, done.stderr))

    def test_user_health_and_folders(self):
        self.assertRegex(self.step("USER"), r"^[1-9]\d*$")
        self.assertIn("http://127.0.0.1:9464/ready", self.step("HEALTHCHECK"))
        self.assertNotIn("--http", self.step("ENTRYPOINT"))   # it would go before GOBO_HTTP and the file
        self.assertIn('[http]\nlisten = "127.0.0.1:9464"', (SOURCE / "deploy/container.toml").read_text(encoding="utf-8"))
        volumes = json.loads(self.step("VOLUME"))
        text = (SOURCE / "deploy/container.toml").read_text(encoding="utf-8")
        written = re.findall(r'"(?:unix:)?(/[^"]+)"', text) + [re.search(r"TMPDIR=(\S+)", self.step("ENV"))[1]]
        self.assertGreater(len(written), 2)
        for place in written:   # a read-only root: /run/gobo is a tmpfs
            self.assertTrue(any(place.startswith(v) for v in [*volumes, "/run/gobo"]), place)
        copied = [rest for word, rest in self.steps if word == "COPY"]
        self.assertTrue(any("deploy/container.toml" in c for c in copied))

    # bubblewrap's words for the image: what the last stage copies, what it installs (curl, libraries, drivers' data), /etc of its own; all of it read-only.
    def words(self, installed, folder):
        host = [w for place in ("/usr/lib/x86_64-linux-gnu", "/usr/lib64", "/usr/share", "/etc/alternatives", "/etc/ld.so.cache", "/etc/ssl", *glob.glob("/usr/lib/lib*.so*")) if os.path.exists(place)
                for w in ("--ro-bind", place, place)]
        mine = []
        for word, rest in self.steps:
            if word == "COPY" and "/out/packages" not in rest:
                *sources, target = [w for w in rest.split() if not w.startswith("--")]
                for source in sources:
                    place = target + os.path.basename(source) if target.endswith("/") else target
                    mine += ["--ro-bind", installed + place if target.startswith("/usr/") else str(SOURCE / source), place]
        user = self.step("USER")
        (folder / "passwd").write_text(f"gobo:x:{user}:{user}::/var/lib/gobo:/usr/sbin/nologin\n", encoding="utf-8")
        written = [w for place in ("/run/gobo", "/tmp", *json.loads(self.step("VOLUME"))) for w in ("--perms", "0700", "--tmpfs", place)]
        env = [w for pair in self.step("ENV").split() for w in ("--setenv", *pair.split("=", 1))]
        return ["bwrap", "--unshare-all", "--die-with-parent", "--as-pid-1", "--cap-drop", "ALL", "--uid", user, "--gid", user, *host, "--symlink", "usr/lib", "/lib", "--symlink", "usr/lib64", "/lib64",
                "--ro-bind", "/usr/bin/curl", "/usr/bin/curl", *mine, "--ro-bind", str(folder / "passwd"), "/etc/passwd", "--ro-bind", str(folder / "scenes"), "/srv/scenes",
                "--proc", "/proc", "--dev", "/dev", *written, "--remount-ro", "/", "--clearenv", "--setenv", "PATH", "/usr/bin", *env]

    def test_the_last_stage_as_a_container(self):
        private_root.need_build()
        for tool in ("bwrap", "nsenter", "curl", "setpriv"):
            if not shutil.which(tool):
                private_root.missing_here(f"{tool} is not installed (deploy/install-deps)")
        if os.geteuid() != 0:
            private_root.missing_here("entering the container to ask it needs root's rights")
        user = self.step("USER")
        become = ["setpriv", "--reuid", user, "--regid", user, "--clear-groups"]   # really that user: nothing of root's is left to be given up
        tried = subprocess.run([*become, "bwrap", "--unshare-all", "--ro-bind", "/", "/", "--proc", "/proc", "true"], capture_output=True, text=True, timeout=60, check=False)
        if tried.returncode != 0:
            private_root.missing_here(f"bubblewrap does not work here: {tried.stderr}")
        folder = pathlib.Path(private_root.folder(type(self)))
        installed = str(folder / "image")
        private_root.run(["cmake", "--install", private_root.BUILD, "--prefix", installed + "/usr", "--component", "gobo", "--strip"])
        (folder / "scenes").mkdir()
        gltf(folder / "scenes")
        private_root.radiance(folder / "scenes/map.hdr")
        inner, outer = os.pipe()
        command = [*become, *self.words(installed, folder), "--info-fd", str(outer), *json.loads(self.step("ENTRYPOINT"))]
        container = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, pass_fds=[outer], env={}, cwd="/")
        os.close(outer)
        try:
            with os.fdopen(inner, encoding="utf-8") as info:
                line = container.stdout.readline()
                self.assertIn("ready on unix:/run/gobo/gobo.sock, http://127.0.0.1:9464", line, None if line else container.stderr.read())
                first = json.loads(info.read())["child-pid"]
            inside = pathlib.Path(f"/proc/{first}")
            enter = ["nsenter", "-t", str(first), "-m", "-n", "-p", "-i", "-u", "-S", user, "-G", user, "--wd=/"]   # as `podman exec`
            env = dict(pair.split("=", 1) for pair in self.step("ENV").split())

            def within(*words, code=0):
                return private_root.run([*enter, *words], code=code, env={"PATH": "/usr/bin:/usr/sbin:/bin", **env})

            status = dict(line.split(":\t", 1) for line in (inside / "status").read_text(encoding="utf-8").splitlines() if ":\t" in line)
            self.assertEqual(set(status["Uid"].split() + status["Gid"].split()), {user})
            self.assertEqual((int(status["CapEff"], 16), int(status["CapBnd"], 16), status["NoNewPrivs"], status["NSpid"].split()[-1]), (0, 0, "1", "1"))
            links = [line.split(":")[0].strip() for line in (inside / "net/dev").read_text(encoding="utf-8").splitlines()[2:]]
            self.assertEqual(links, ["lo"])
            mounts = {line.split()[1]: line.split()[3].split(",")[0] for line in (inside / "mounts").read_text(encoding="utf-8").splitlines()}
            writable = {place for place, how in mounts.items() if how == "rw" and not place.startswith(("/proc", "/dev"))}
            self.assertEqual(writable, {"/run/gobo", "/tmp", *json.loads(self.step("VOLUME"))})

            self.assertEqual(within(*json.loads(self.step("HEALTHCHECK").split(" CMD ", 1)[1])).strip(), "ready")
            small = ["--size", "32x24", "--spp", "1"]
            within("gobo", "render", "cornell", "-o", "/tmp/box.exr", *small)
            within("gobo", "render", "/srv/scenes/tri.gltf", "-o", "/tmp/tri.png", "--env", "/srv/scenes/map.hdr", *small)   # by the image's reader and codec
            self.assertTrue((inside / "root/tmp/tri.png").read_bytes().startswith(b"\x89PNG"))
            self.assertTrue(list((inside / "root/var/cache/gobo").iterdir()))
            within("gobo", "render", "cornell", "-o", "/usr/box.png", *small, code=2)
            self.assertFalse((inside / "root/usr/box.png").exists())

            # SIGTERM: what runs is finished, then process 1 leaves with 0 and the container with it.
            render = subprocess.Popen([*enter, "gobo", "render", "cornell", "-o", "/tmp/last.png", "--size", "160x120", "--spp", "128"], env={"PATH": "/usr/bin:/usr/sbin:/bin", **env},
                                      stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
            deadline = time.monotonic() + 60
            while "gobo_renders_running{class=\"normal\"} 1" not in within("curl", "-fsS", "http://127.0.0.1:9464/metrics") and time.monotonic() < deadline and render.poll() is None:
                time.sleep(0.02)
            self.assertIsNone(render.poll())
            os.kill(first, signal.SIGTERM)
            _, log = container.communicate(timeout=60)
            self.assertEqual(container.returncode, 0, log)
            render.communicate(timeout=60)
            events = [json.loads(line) for line in log.splitlines()]   # [log] format
            done = [e for e in events if e["event"] == "render" and e.get("size") == "160x120"]
            self.assertEqual([e["status"] for e in done], ["OK"], log)
        finally:
            container.kill()
            container.communicate()


if __name__ == "__main__":
    unittest.main()
