# SPDX-License-Identifier: Apache-2.0
"""deploy/front/nginx.conf before a gobod with configs/studio.toml's rules: what the tests of it share."""
import hashlib
import os
import re
import resource
import shutil
import signal
import socket
import ssl
import subprocess
import sys
import tempfile
import time
import unittest
import urllib.request

import grpc

import gobo
from support import SOURCE

sys.path.insert(0, os.path.join(SOURCE, "bench", "attackers"))
import http2  # noqa: E402,F401
import scenes  # noqa: E402,F401

FRONT = os.path.join(SOURCE, "deploy", "front")
TOKENS = {"lighting": "token-of-lighting", "limited": "token-of-limited", "ops": "token-of-ops"}
RIGHTS = {"limited": "max_pixels = 100\n", "ops": "admin = true\n"}


def nginx():
    return shutil.which("nginx") or ("/usr/sbin/nginx" if os.access("/usr/sbin/nginx", os.X_OK) else None)


def free_port() -> int:
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        return s.getsockname()[1]


def replaced(text: str, *pairs) -> str:
    """Every pattern must be there: the test is of the file that is installed."""
    for pattern, value in pairs:
        text, n = re.subn(pattern, lambda _: value, text)
        if n == 0:
            raise AssertionError(f"deploy/front/nginx.conf or configs/studio.toml: nothing matches {pattern}")
    return text


@unittest.skipUnless(nginx(), "nginx is not installed (deploy/install-deps installs nginx-light)")
class FrontTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        if resource.getrlimit(resource.RLIMIT_NOFILE)[0] < 4096:
            resource.setrlimit(resource.RLIMIT_NOFILE, (4096, resource.getrlimit(resource.RLIMIT_NOFILE)[1]))
        cls.folder = tempfile.mkdtemp(prefix="gobo-front-")
        cls.addClassCleanup(shutil.rmtree, cls.folder, ignore_errors=True)
        os.chmod(cls.folder, 0o755)
        cls.port, http = free_port(), free_port()
        certs = cls.certs = os.path.join(cls.folder, "certs")
        subprocess.run([os.path.join(FRONT, "make_certs"), certs, "--host", "localhost", "--client", "lighting"], check=True)
        subprocess.run([os.path.join(FRONT, "make_certs"), os.path.join(cls.folder, "others"), "--host", "localhost", "--client", "lighting"], check=True)
        for sub in ("cache", "tmp", "scenes"):
            os.mkdir(os.path.join(cls.folder, sub))
        with open(os.path.join(SOURCE, "configs", "studio.toml"), encoding="utf-8") as file:
            config = file.read().split("\n[[tokens]]")[0]
        config = replaced(config, (r"unix:/run/gobo/gobo\.sock", f"unix:{cls.folder}/gobo.sock"), (r"127\.0\.0\.1:9464", f"127.0.0.1:{http}"),
                          (r"/var/cache/gobo", f"{cls.folder}/cache"), (r"/srv/scenes", f"{cls.folder}/scenes"), (r"/var/lib/gobo", f"{cls.folder}/tmp"),
                          (r'store_bytes = "24GiB"', 'store_bytes = "256MiB"\nthreads = 2'), (r"drain_s = 60", "drain_s = 2"))
        for name, token in TOKENS.items():
            config += f'\n[[tokens]]\nname = "{name}"\nsha256 = "{hashlib.sha256(token.encode()).hexdigest()}"\n' + RIGHTS.get(name, "")
        cls.gobod_config = os.path.join(cls.folder, "gobod.toml")
        with open(cls.gobod_config, "w", encoding="utf-8") as file:
            file.write(config)
        with open(os.path.join(FRONT, "nginx.conf"), encoding="utf-8") as file:
            front = replaced(file.read(), (r"listen 443 ssl", f"listen 127.0.0.1:{cls.port} ssl"), (r"/run/gobo/gobo\.sock", f"{cls.folder}/gobo.sock"),
                             (r"127\.0\.0\.1:9464", f"127.0.0.1:{http}"), (r"/etc/gobo/front", certs), (r"/run/nginx\.pid", f"{cls.folder}/nginx.pid"),
                             (r"/var/log/nginx", cls.folder), (r"/var/lib/nginx", cls.folder), (r"client_body_timeout 30s", "client_body_timeout 2s"), (r"send_timeout 60s;  ", "send_timeout 3s;  "),
                             (r"user www-data gobo;[^\n]*", "user root;" if os.getuid() == 0 else ""))
        # Temporary folders of modules that the file has no use for.
        front = front.replace("  access_log off;", "".join(f"  {m}_temp_path {cls.folder}/{m};\n" for m in ("fastcgi", "uwsgi", "scgi")) + "  access_log off;")
        cls.nginx_config = os.path.join(cls.folder, "nginx.conf")
        with open(cls.nginx_config, "w", encoding="utf-8") as file:
            file.write(front)
        log = open(os.path.join(cls.folder, "log"), "wb")
        cls.addClassCleanup(log.close)
        cls.gobod = subprocess.Popen([os.environ["GOBO_GOBOD"], "--config", cls.gobod_config], stdout=subprocess.PIPE, stderr=log)
        cls.addClassCleanup(cls.gobod.stdout.close)
        cls.addClassCleanup(cls.stop, cls.gobod, signal.SIGTERM)
        if b"ready" not in cls.gobod.stdout.readline():
            raise AssertionError("gobod does not start: " + cls.said())
        cls.nginx = subprocess.Popen([nginx(), "-c", cls.nginx_config, "-e", os.path.join(cls.folder, "error.log"), "-g", "daemon off;"], stderr=log)
        cls.addClassCleanup(cls.stop, cls.nginx, signal.SIGQUIT)
        for _ in range(200):
            try:
                socket.create_connection(("127.0.0.1", cls.port), 1).close()
                break
            except OSError:
                time.sleep(0.05)
        else:
            raise AssertionError("nginx does not start: " + cls.said())

    @classmethod
    def said(cls):
        with open(os.path.join(cls.folder, "log"), encoding="utf-8", errors="replace") as log:
            return log.read()[-3000:]

    @staticmethod
    def stop(process, how):
        process.send_signal(how)
        try:
            process.wait(15)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()

    def tls(self, folder="certs", cert=True):
        name = lambda n: os.path.join(self.folder, folder, n)
        return gobo.Tls(ca=os.path.join(self.certs, "ca.pem"), cert=name("lighting.pem") if cert else None, key=name("lighting.key") if cert else None)

    def connect(self, token="lighting", tls=None, **more):
        return gobo.connect(f"localhost:{self.port}", token=TOKENS.get(token, token), tls=tls or self.tls(), timeout=60, **more)

    def rss(self) -> int:
        with open(f"/proc/{self.gobod.pid}/status", encoding="ascii") as file:
            return int(re.search(r"VmHWM:\s+(\d+)", file.read())[1]) * 1024

    def get(self, path):
        context = ssl.create_default_context(cafile=os.path.join(self.certs, "ca.pem"))
        context.load_cert_chain(os.path.join(self.certs, "lighting.pem"), os.path.join(self.certs, "lighting.key"))
        return urllib.request.urlopen(f"https://localhost:{self.port}{path}", context=context, timeout=10)

    def raw(self):
        def read(name):
            with open(os.path.join(self.certs, name), "rb") as file:
                return file.read()
        credentials = grpc.ssl_channel_credentials(read("ca.pem"), read("lighting.key"), read("lighting.pem"))
        channel = grpc.secure_channel(f"localhost:{self.port}", credentials, [("grpc.use_local_subchannel_pool", 1), ("grpc.max_send_message_length", -1)])
        return channel, [("authorization", f"Bearer {TOKENS['lighting']}")]
