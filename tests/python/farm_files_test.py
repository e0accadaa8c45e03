# SPDX-License-Identifier: Apache-2.0
"""deploy/farm: the configuration goes through gobod --check, the Slurm script is run as the node would, the unit through systemd's own check, and the Kubernetes
file is held against what it speaks of: the configuration's files and ports, flags and variables of gobod, the image's user."""
import os
import pathlib
import re
import shutil
import signal
import subprocess
import tempfile
import tomllib
import unittest

import gobo
import yaml
from support import CLI, eventually

SOURCE = pathlib.Path(__file__).resolve().parents[2]
FARM = SOURCE / "deploy" / "farm"
GOBOD = os.environ["GOBO_GOBOD"]


class FarmFiles(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory(prefix="gobo-farm-files-")
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)

    def test_configuration(self):
        said = subprocess.run([GOBOD, "--config", str(FARM / "worker.toml"), "--worker", "coordinator.example:50551", "--check"], capture_output=True, text=True)
        self.assertEqual(said.returncode, 0, said.stderr)
        said = subprocess.run([GOBOD, "--config", str(FARM / "worker.toml"), "--worker", "coordinator", "--check"], capture_output=True, text=True)
        self.assertEqual(said.returncode, 2)
        self.assertIn('"coordinator" is neither unix:PATH nor HOST:PORT', said.stderr)

    def test_slurm_script_makes_a_worker(self):
        script = str(FARM / "worker.slurm")
        if shutil.which("shellcheck"):
            said = subprocess.run(["shellcheck", script], capture_output=True, text=True)
            self.assertEqual(said.returncode, 0, said.stdout)
        env = {**os.environ, "PATH": f"{pathlib.Path(GOBOD).parent}:" + os.environ["PATH"], "SLURMD_NODENAME": "node7", "SLURM_ARRAY_TASK_ID": "3", "SLURM_CPUS_ON_NODE": "1",
               "GOBO_TMP": str(self.folder)}
        env.pop("GOBO_WORKER", None)
        self.assertEqual(subprocess.run(["bash", script], env=env, capture_output=True).returncode, 1, "without a coordinator")
        with gobo.local(threads=1, jobs=self.folder / "jobs") as coordinator:
            workers = lambda: subprocess.run([CLI, "--server", coordinator.address, "workers"], capture_output=True, text=True).stdout
            worker = subprocess.Popen(["bash", script], env={**env, "GOBO_WORKER": coordinator.address}, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
            try:
                self.assertTrue(eventually(lambda: re.search(r"^node7-3 +attends +1 ", workers(), re.MULTILINE)), workers())
                worker.send_signal(signal.SIGTERM)          # what Slurm sends before the end
                self.assertEqual(worker.wait(30), 0)
                self.assertTrue(eventually(lambda: re.search(r"^node7-3 +gone ", workers(), re.MULTILINE)), workers())
            finally:
                worker.kill()
                worker.communicate()

    def test_unit(self):
        if not shutil.which("systemd-analyze"):
            self.skipTest("systemd-analyze is not here")
        unit = self.folder / "gobod-worker.service"
        unit.write_text((FARM / unit.name).read_text(encoding="utf-8").replace("/usr/bin/gobod", GOBOD), encoding="utf-8")
        said = subprocess.run(["systemd-analyze", "verify", "--man=no", str(unit)], capture_output=True, text=True)
        ours = [line for line in said.stderr.splitlines() if "gobod-worker" in line]
        self.assertEqual(ours, [])

    def test_kubernetes(self):
        deployment = yaml.safe_load((FARM / "worker.k8s.yaml").read_text(encoding="utf-8"))
        self.assertEqual(deployment["kind"], "Deployment")
        template = deployment["spec"]["template"]
        self.assertEqual(template["metadata"]["labels"], deployment["spec"]["selector"]["matchLabels"])
        pod, container = template["spec"], template["spec"]["containers"][0]
        help_ = subprocess.run([GOBOD, "--help"], capture_output=True, text=True, check=True).stdout
        self.assertEqual(container["command"][0], "gobod")
        for word in container["command"]:
            if word.startswith("--"):
                self.assertIn(word, help_)
        for variable in container["env"]:
            self.assertIn(variable["name"], help_)
        mounts = {m["mountPath"] for m in container["volumeMounts"]}
        self.assertEqual({m["name"] for m in container["volumeMounts"]}, {v["name"] for v in pod["volumes"]})
        config = tomllib.loads((FARM / "worker.toml").read_text(encoding="utf-8"))
        self.assertIn(str(pathlib.Path(container["command"][2]).parent), mounts)
        for name in (config["farm"]["ca"], config["farm"]["token_file"]):
            self.assertIn(name, mounts)
        self.assertTrue(config["farm"]["folder"].startswith("/var/cache/gobo"))
        for probe in ("readinessProbe", "livenessProbe"):
            self.assertIn(config["http"]["listen"], container[probe]["exec"]["command"][-1])
        image = (SOURCE / "deploy" / "Containerfile").read_text(encoding="utf-8")
        self.assertIn(f"USER {pod['securityContext']['runAsUser']}", image)
        self.assertTrue(container["securityContext"]["readOnlyRootFilesystem"])


if __name__ == "__main__":
    unittest.main()
