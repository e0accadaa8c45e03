# SPDX-License-Identifier: Apache-2.0
"""deploy/compose.yaml as far as it can be held against what it speaks of without an engine: files, variables, addresses and ports, users, places that are written to,
health checks, limits; its configuration goes through gobod --check with its environment."""
import hashlib
import json
import os
import pathlib
import re
import shutil
import subprocess
import tempfile
import tomllib
import unittest

import yaml
from support import CLI, eventually

SOURCE = pathlib.Path(__file__).resolve().parents[2]
DEPLOY = SOURCE / "deploy"
GOBOD = os.environ["GOBO_GOBOD"]



def interpolated(value, env=None):
    """Compose's ${NAME:-DEFAULT}; others are an error."""
    if isinstance(value, dict):
        return {k: interpolated(v, env) for k, v in value.items()}
    if isinstance(value, list):
        return [interpolated(v, env) for v in value]
    if not isinstance(value, str):
        return value
    value = re.sub(r"\$\{(\w+):-([^}]*)\}", lambda m: (env or {}).get(m[1], m[2]), value)
    assert "$" not in value, value
    return value


class Compose(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.file = interpolated(yaml.safe_load((DEPLOY / "compose.yaml").read_text(encoding="utf-8")))
        cls.gobod, cls.store, cls.worker = (cls.file["services"][name] for name in ("gobod", "postgresql", "worker"))
        lines = (DEPLOY / "Containerfile").read_text(encoding="utf-8").replace("\\\n", " ").splitlines()
        final = max(i for i, line in enumerate(lines) if line.startswith("FROM "))
        cls.image = dict(line.split(None, 1) for line in lines[final:] if line and not line.startswith("#"))

    def setUp(self):
        self.folder = pathlib.Path(tempfile.mkdtemp(prefix="gobo-compose-"))
        self.addCleanup(shutil.rmtree, self.folder, ignore_errors=True)

    def check(self, text, env, *flags):
        (self.folder / "gobod.toml").write_text(text, encoding="utf-8")
        env = {**{k: v for k, v in os.environ.items() if not k.startswith("GOBO_")}, **env}
        return subprocess.run([GOBOD, "--config", self.folder / "gobod.toml", "--check", *flags], env=env, capture_output=True, text=True, timeout=30, check=False)

    def open_to_the_images_user(self):
        """The secrets that make_certs made, by what the file's head says: mounted as they are, they belong to whoever called it."""
        command = re.search(r"^# +(chmod 0644 deploy/secrets/\S+)", (DEPLOY / "compose.yaml").read_text(encoding="utf-8"), re.M)[1]
        subprocess.run(["bash", "-c", command.replace("deploy/secrets", str(self.folder / "secrets"))], check=True, timeout=30)
        made = 0
        # libpq's passfile is 0600 and of the image's user; the token is written by hand.
        for name in {*self.gobod["secrets"], *self.worker["secrets"]} - {"postgresql_passfile", "worker_token"}:
            mode = (self.folder / self.file["secrets"][name]["file"]).stat().st_mode
            self.assertTrue(mode & 0o004, f"{name}: {mode:o}")
            made += 1
        self.assertEqual(made, 3)
        self.assertFalse((self.folder / "secrets/ca.key").stat().st_mode & 0o077)
        self.assertFalse((self.folder / "secrets").stat().st_mode & 0o077)

    def test_files_that_it_names(self):
        build = self.gobod["build"]
        self.assertEqual((DEPLOY / build["context"]).resolve(), SOURCE)
        self.assertTrue((DEPLOY / build["context"] / build["dockerfile"]).is_file())
        for config in self.file["configs"].values():
            self.assertTrue((DEPLOY / config["file"]).is_file(), config)
        secrets = self.folder / "secrets"
        subprocess.run([DEPLOY / "front/make_certs", secrets, "--host", "localhost", "--host", "gobod"], check=True, capture_output=True, timeout=60)
        for name, secret in self.file["secrets"].items():
            folder, file = os.path.split(secret["file"])
            self.assertEqual(folder, "secrets")
            self.assertTrue((secrets / file).is_file() or name.startswith("postgresql_") or name == "worker_token", secret)
        self.open_to_the_images_user()
        ignored = subprocess.run(["git", "-C", SOURCE, "check-ignore", "-q", "deploy/secrets/server.key"], check=False, timeout=30).returncode
        self.assertIn(ignored, (0, 128))   # 128: sources without git
        self.assertIn("deploy/secrets", (SOURCE / ".containerignore").read_text(encoding="utf-8").split())

    def test_names_within_the_file(self):
        for service in (self.gobod, self.store, self.worker):
            self.assertLessEqual(set(service["secrets"]), set(self.file["secrets"]))
            self.assertLessEqual(set(service["networks"]), set(self.file["networks"]))
            named = {v.split(":")[0] for v in service.get("volumes", []) if not v.startswith("/")}
            self.assertLessEqual(named, set(self.file["volumes"]))
        self.assertEqual([c["source"] for s in (self.gobod, self.worker) for c in s["configs"]], list(self.file["configs"]))
        used = set().union(*(s["secrets"] for s in (self.gobod, self.store, self.worker)))
        self.assertEqual(used, set(self.file["secrets"]))
        self.assertTrue(self.file["networks"]["store"]["internal"])
        self.assertEqual((self.store["networks"], self.store["profiles"]), (["store"], ["postgresql"]))
        self.assertNotIn("ports", self.store)
        self.assertNotIn("profiles", self.gobod)
        self.assertEqual((self.worker["networks"], self.worker["profiles"], self.worker["depends_on"]), (["callers"], ["workers"], ["gobod"]))
        self.assertNotIn("ports", self.worker)

    def test_gobod_takes_its_configuration_and_environment(self):
        said = subprocess.run([GOBOD, "--help"], capture_output=True, text=True, timeout=30, check=True).stdout
        known = set(re.findall(r"GOBO_[A-Z_]+", said))
        for name in (*self.gobod["environment"], *self.worker["environment"]):
            self.assertTrue(name in known or name == "TMPDIR", name)
        secrets = self.folder / "secrets"
        subprocess.run([DEPLOY / "front/make_certs", secrets, "--host", "localhost"], check=True, capture_output=True, timeout=60)
        text = (DEPLOY / "compose.toml").read_text(encoding="utf-8")
        for name in re.findall(r'^\w+ = "/run/secrets/(\w+)"', text, re.M):
            self.assertIn(name, self.gobod["secrets"])
            text = text.replace(f"/run/secrets/{name}", str(self.folder / self.file["secrets"][name]["file"]))
        for place in ("/var/cache/gobo", "/var/lib/gobo", "/srv/scenes"):
            (self.folder / place[1:]).mkdir(parents=True)
            text = text.replace(place, str(self.folder / place[1:]))
        env = {k: v.replace("/run/gobo", str(self.folder)) for k, v in self.gobod["environment"].items()}
        done = self.check(text, env)
        self.assertEqual(done.returncode, 0, done.stderr)
        # That it is checked, and that tokens and TLS are what lets it listen beyond loopback.
        self.assertEqual(self.check(text, {**env, "GOBO_LISTEN": "0.0.0.0:99999"}).returncode, 2)
        self.assertEqual(self.check(re.sub(r"\[tls\]\ncert.*\nkey.*\n", "", text), env).returncode, 2)
        self.assertEqual(self.check(text[:text.index("[[tokens]]")], env).returncode, 2)

    def test_a_worker_works_for_the_daemon(self):
        """Both, as the file configures them, but for places and for the name under which Compose makes the daemon known."""
        secrets, token = self.folder / "secrets", "a-worker-of-this-test"
        subprocess.run([DEPLOY / "front/make_certs", secrets, "--host", "localhost"], check=True, capture_output=True, timeout=60)
        (secrets / "worker_token").write_text(token + "\n", encoding="utf-8")
        clean = {k: v for k, v in os.environ.items() if not k.startswith("GOBO_")}
        texts = {name: (DEPLOY / self.file["configs"][name]["file"]).read_text(encoding="utf-8") for name in ("gobod", "worker")}
        for name, text in texts.items():
            for secret in re.findall(r"/run/secrets/(\w+)", text):
                text = text.replace(f"/run/secrets/{secret}", str(self.folder / self.file["secrets"][secret]["file"]))
            for place in ("/var/cache/gobo", "/var/lib/gobo", "/srv/scenes"):
                (self.folder / name / place[1:]).mkdir(parents=True)
                text = text.replace(place, str(self.folder / name / place[1:]))
            # Of the three tokens that are to be replaced the second is the workers'.
            (self.folder / f"{name}.toml").write_text(text.replace("0" * 63 + "2", hashlib.sha256(token.encode()).hexdigest()), encoding="utf-8")
        log = open(self.folder / "log", "w+", encoding="utf-8")
        self.addCleanup(log.close)
        daemon = subprocess.Popen([GOBOD, "--config", self.folder / "gobod.toml", "--tmp", self.folder, "--listen", "localhost:0", "--listen", f"unix:{self.folder}/s"], env=clean,
                                  stdout=log, stderr=log)
        self.addCleanup(daemon.wait)
        self.addCleanup(daemon.kill)
        said = lambda: (self.folder / "log").read_text(encoding="utf-8")
        self.assertTrue(eventually(lambda: "gobod ready on" in said()), said())
        address = re.search(r"gobod ready on (\S+?),", said())[1]
        worker = subprocess.Popen([GOBOD, "--config", self.folder / "worker.toml", "--tmp", self.folder], env={**clean, "GOBO_WORKER": f"localhost:{address.rsplit(':', 1)[1]}"},
                                  stdout=log, stderr=log)
        self.addCleanup(worker.wait)
        self.addCleanup(worker.kill)
        gobo = lambda *words: subprocess.run([CLI, "--server", f"unix:{self.folder}/s", *words], capture_output=True, text=True, timeout=60, check=False)
        self.assertTrue(eventually(lambda: "attends" in gobo("workers").stdout), said())
        self.assertEqual(gobo("jobs", "submit", "cornell", "--size", "16x12", "--spp", "1", "--frames", "1-4", "--watch").returncode, 0, said())

    def test_addresses_ports_and_health(self):
        env = self.gobod["environment"]
        listened = {int(a.rsplit(":", 1)[1]) for a in [*env["GOBO_LISTEN"].split(","), env["GOBO_WEB"]] if not a.startswith("unix:")}
        published = {}
        for port in self.gobod["ports"]:
            host, outside, inside = port.rsplit(":", 2)
            self.assertEqual(host, "127.0.0.1")
            first, last = (int(p) for p in outside.split("-"))
            published[int(inside)] = range(first, last + 1)
        self.assertEqual(set(published), listened)
        self.assertIn(int(self.image["EXPOSE"]), listened)
        self.assertFalse(set(published[50551]) & set(published[8080]))
        http = tomllib.loads((DEPLOY / "container.toml").read_text(encoding="utf-8"))["http"]["listen"]
        self.assertEqual(env["GOBO_HTTP"], http)
        health = self.gobod["healthcheck"]
        said = re.match(r"--interval=(\S+) --timeout=(\S+) --start-period=(\S+) --retries=(\S+) CMD (.*)", self.image["HEALTHCHECK"])
        interval, timeout, start, retries, command = said.groups()
        self.assertEqual((health["interval"], health["timeout"], health["start_period"], health["retries"]), (interval, timeout, start, int(retries)))
        self.assertEqual(health["test"], ["CMD", *json.loads(command)])
        self.assertEqual(health["test"][-1], f"http://{http}/ready")

    def test_hardened_and_bounded(self):
        for name, service in (("gobod", self.gobod), ("postgresql", self.store), ("worker", self.worker)):
            self.assertTrue(service["read_only"], name)
            self.assertEqual((service["cap_drop"], service["security_opt"]), (["ALL"], ["no-new-privileges:true"]), name)
            self.assertNotIn("privileged", service)
            self.assertNotIn("cap_add", service)
            user, group = (int(n) for n in service["user"].split(":"))
            self.assertGreater(min(user, group), 0)
            for place in service["tmpfs"]:
                options = dict(o.split("=") for o in place.split(":", 1)[1].split(","))
                self.assertEqual((options["uid"], options["gid"], options["mode"]), (str(user), str(group), "0700"), place)
                self.assertIn("size", options)
            limits = service["deploy"]["resources"]["limits"]
            self.assertEqual(set(limits), {"cpus", "memory", "pids"}, name)
            self.assertFalse([v for k, v in service["environment"].items() if re.search("PASSWORD|TOKEN|KEY", k) and not v.startswith("/run/secrets/")])
        for service in (self.gobod, self.worker):
            self.assertEqual(service["user"].split(":")[0], self.image["USER"])
            self.assertEqual(service["healthcheck"], self.gobod["healthcheck"])
            self.assertEqual(service["environment"]["GOBO_HTTP"], self.gobod["environment"]["GOBO_HTTP"])
        # A worker's files are on a volume that the image has, so each container its own.
        kept = tomllib.loads((DEPLOY / "compose.worker.toml").read_text(encoding="utf-8"))["farm"]["folder"]
        self.assertTrue(any(kept.startswith(v + "/") for v in json.loads(self.image["VOLUME"])), kept)
        self.assertNotIn("volumes", self.worker)
        self.assertEqual(self.worker["environment"]["GOBO_WORKER"].rsplit(":", 1)[1], self.gobod["environment"]["GOBO_LISTEN"].rsplit(":", 1)[1])
        # Whatever the configuration and the environment write to is a volume or a tmpfs.
        config = tomllib.loads((DEPLOY / "compose.toml").read_text(encoding="utf-8"))
        written = [config["engine"]["cache_folder"], config["jobs"]["folder"], self.gobod["environment"]["TMPDIR"], self.gobod["environment"]["GOBO_TMP"]]
        written += [a.removeprefix("unix:") for a in self.gobod["environment"]["GOBO_LISTEN"].split(",") if a.startswith("unix:")]
        places = [v.split(":")[1] for v in self.gobod["volumes"] if not v.endswith(":ro")] + [t.split(":")[0] for t in self.gobod["tmpfs"]]
        for path in written:
            self.assertTrue(any(path == p or path.startswith(p + "/") for p in places), path)
        self.assertLessEqual(set(json.loads(self.image["VOLUME"])), set(places))
        self.assertIn("/srv/scenes", [v.split(":")[1] for v in self.gobod["volumes"] if v.endswith(":ro")])
        self.assertGreater(int(self.gobod["stop_grace_period"].removesuffix("s")), config["scheduler"]["drain_s"] + 2)
        self.assertEqual(self.gobod["stop_signal"], self.image["STOPSIGNAL"])

    def test_what_may_be_chosen(self):
        text = (DEPLOY / "compose.yaml").read_text(encoding="utf-8")
        variables = dict(re.findall(r"\$\{(\w+):-([^}]*)\}", text))
        self.assertEqual(variables, {"GOBO_DAEMONS": "1", "GOBO_WORKERS": "2", "GOBO_CPUS": "4", "GOBO_MEMORY": "8g", "GOBO_SCENES": "/srv/scenes"})
        three = interpolated(yaml.safe_load(text), {"GOBO_DAEMONS": "3"})["services"]["gobod"]
        self.assertEqual(three["deploy"]["replicas"], "3")
        self.assertNotIn("container_name", three)   # one name would forbid the second


if __name__ == "__main__":
    unittest.main()
