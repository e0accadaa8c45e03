# SPDX-License-Identifier: Apache-2.0
"""What deploy/Containerfile promises, as far as it can be tried without a container: its command with its file and with another, environment variables
over the file and below flags, a user, a health check, folders to write in."""
import json
import os
import pathlib
import re
import shutil
import subprocess
import tempfile
import unittest
import urllib.request

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


if __name__ == "__main__":
    unittest.main()
