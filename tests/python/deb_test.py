# SPDX-License-Identifier: Apache-2.0
"""`make deb`: what is in the packages, that they depend on what they link, that what they hold works where dpkg-deb unpacks it, and what dpkg makes of them
in a root of its own: user, folders, unit, configuration, a daemon that serves with it."""
import glob
import os
import pathlib
import re
import shutil
import signal
import subprocess
import unittest

import private_root
from private_root import BUILD, run
from support import SOURCE, gltf

NAMES = ("gobo", "gobo-dev", "python3-gobo")


class Deb(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        private_root.need_build()
        cls.folder = private_root.folder(cls)
        run(["cpack", "--config", os.path.join(BUILD, "CPackConfig.cmake"), "-B", cls.folder, "-D", "CPACK_DEBIAN_COMPRESSION_TYPE=none"], cwd=cls.folder)
        shutil.rmtree(os.path.join(cls.folder, "_CPack_Packages"))
        cls.packages = {os.path.basename(p).split("_")[0]: p for p in glob.glob(cls.folder + "/*.deb")}
        cls.unpacked = os.path.join(cls.folder, "unpacked")
        run(["dpkg-deb", "-x", cls.packages["gobo"], cls.unpacked])

    def field(self, package, name):
        return run(["dpkg-deb", "-f", self.packages[package], name]).strip()

    def files(self, package):
        """(mode, owner, name without the leading dot) of each row."""
        rows = []
        for line in run(["dpkg-deb", "-c", self.packages[package]]).splitlines():
            mode, owner, _, _, _, name = line.split(None, 5)
            rows.append((mode, owner, name[1:]))
        return rows

    def elf(self):
        at = pathlib.Path(self.unpacked)
        return [at / "usr/bin/gobod", at / "usr/bin/gobo", at / "usr/bin/gobo-ingest", at / "usr/lib/gobo/libgobo_image_codec.so", at / "usr/lib/gobo/libgobo_color.so"]

    def test_names_and_fields(self):
        version = re.search(r"project\(gobo VERSION (\S+)", pathlib.Path(SOURCE, "CMakeLists.txt").read_text(encoding="utf-8"))[1] + "-1"
        architecture = run(["dpkg", "--print-architecture"]).strip()
        self.assertEqual(sorted(os.path.basename(p) for p in self.packages.values()),
                         sorted([f"gobo_{version}_{architecture}.deb", f"gobo-dev_{version}_{architecture}.deb", f"python3-gobo_{version}_all.deb"]))
        for package in NAMES:
            self.assertEqual(self.field(package, "Version"), version)
            self.assertRegex(self.field(package, "Maintainer"), r"^[\w ]+ <\S+@(localhost|\S+\.invalid)>$")   # nobody's address
            self.assertGreater(int(self.field(package, "Installed-Size")), 100)
            self.assertEqual(self.field(package, "Priority"), "optional")
            synopsis, *more = self.field(package, "Description").splitlines()
            self.assertTrue(0 < len(synopsis) <= 80 and not synopsis.endswith("."), synopsis)
            self.assertTrue(more and all(len(line) <= 80 for line in more), more)
        self.assertEqual([self.field(p, "Section") for p in NAMES], ["graphics", "libdevel", "python"])
        self.assertIn(f"gobo (= {version})", self.field("gobo-dev", "Depends"))

    def test_files(self):
        seen = {}
        for package in NAMES:
            rows = self.files(package)
            names = [name for _, _, name in rows]
            self.assertIn(f"/usr/share/doc/{package}/copyright", names)
            for mode, owner, name in rows:
                self.assertEqual(owner, "root/root", name)
                self.assertTrue(name.startswith(("/usr/", "/etc/gobo/")) or name in ("/etc/",), name)
                if mode[0] == "d":
                    self.assertEqual(mode, "drwxr-xr-x", name)
                    self.assertTrue(any(other.startswith(name) and other != name for other in names), f"{name} is empty")
                    continue
                program = name.startswith("/usr/bin/") or name == "/usr/share/gobo/front/make_certs"
                self.assertEqual(mode, "-rwxr-xr-x" if program else "-rw-r--r--", name)
                self.assertNotIn(name, seen, f"in {package} and in {seen.get(name)}")
                seen[name] = package
        for name in ("/usr/bin/gobod", "/usr/bin/gobo", "/usr/bin/gobo-ingest", "/usr/lib/gobo/libgobo_image_codec.so", "/usr/lib/gobo/libgobo_color.so", "/usr/lib/systemd/system/gobod.service",
                     "/usr/lib/sysusers.d/gobo.conf", "/usr/lib/tmpfiles.d/gobo.conf", "/usr/share/man/man1/gobo.1.gz", "/usr/share/doc/gobo/operations.md",
                     "/usr/share/bash-completion/completions/gobo", "/usr/share/zsh/vendor-completions/_gobo", "/usr/share/fish/vendor_completions.d/gobo.fish",
                     "/usr/share/gobo/configs/gobod.toml", "/usr/share/gobo/proto/gobo/v1/render.proto", "/etc/gobo/gobod.toml"):
            self.assertEqual(seen.get(name), "gobo", name)
        self.assertEqual(seen.get("/usr/lib/python3/dist-packages/gobo/v1/render_pb2.py"), "python3-gobo")
        for name in ("/usr/lib/cmake/gobo/gobo-config.cmake", "/usr/lib/gobo/libgobo_plan.a", "/usr/include/gobo/plan/engine.h"):
            self.assertEqual(seen.get(name), "gobo-dev", name)
        self.assertIn("/usr/share/common-licenses/Apache-2.0", pathlib.Path(self.unpacked, "usr/share/doc/gobo/copyright").read_text(encoding="utf-8"))

    def test_control_files(self):
        control = os.path.join(self.folder, "control")
        run(["dpkg-deb", "-e", self.packages["gobo"], control])
        self.assertEqual(pathlib.Path(control, "conffiles").read_text(encoding="utf-8"), "/etc/gobo/gobod.toml\n")
        for script in ("postinst", "prerm", "postrm"):
            path = os.path.join(control, script)
            self.assertEqual(os.stat(path).st_mode & 0o7777, 0o755)
            run(["sh", "-n", path])
            self.assertRegex(pathlib.Path(path).read_text(encoding="utf-8"), r"^#!/bin/sh\n(.*\n)*set -e\n")
        sums = dict(reversed(line.split(None, 1)) for line in pathlib.Path(control, "md5sums").read_text(encoding="utf-8").splitlines())
        self.assertEqual(set(sums), {name[1:] for mode, _, name in self.files("gobo") if mode[0] == "-"} - ({"etc/gobo/gobod.toml"} - set(sums)))
        run(["md5sum", "--quiet", "-c", os.path.join(control, "md5sums")], cwd=self.unpacked)

    def test_programs_are_stripped_and_depend_on_what_they_link(self):
        depends = {d.split()[0] for d in re.split(r"[,|]\s*", self.field("gobo", "Depends"))}
        libraries = set()
        for path in self.elf():
            self.assertNotIn(".symtab", run(["readelf", "-SW", path]), path)
            dynamic = run(["readelf", "-dW", path])
            self.assertNotRegex(dynamic, r"\((RPATH|RUNPATH)\)")
            needed = set(re.findall(r"\(NEEDED\).*\[(.*)\]", dynamic))
            found = dict(re.findall(r"^\s*(\S+) => (/\S+)", run(["ldd", path]), re.M))
            libraries |= {os.path.realpath(found[name]).removeprefix("/usr") for name in needed - {"ld-linux-x86-64.so.2"}}
        linked = {line.split(":")[0] for line in run(["dpkg-query", "-S", *("*" + name for name in libraries)]).splitlines()}
        self.assertGreater(len(linked), 10)
        self.assertEqual(linked - depends, set())
        text = pathlib.Path(self.unpacked, "usr/bin/gobod").read_bytes()
        self.assertNotIn(os.path.realpath(BUILD).encode(), text)

    def test_what_is_unpacked_renders(self):
        at = pathlib.Path(self.unpacked, "usr/bin")
        scene = gltf(self.folder)
        server = f"unix:{self.folder}/s.sock"
        env = private_root.clean_environment(GOBO_SERVER=server)
        daemon = subprocess.Popen([at / "gobod", "--listen", server, "--threads", "2"], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, cwd=self.folder, env=env)
        try:
            self.assertIn(b"ready on", daemon.stdout.readline())
            small = ["--size", "32x24", "--spp", "1"]
            run([at / "gobo", "render", "cornell", "-o", "box.exr", *small], cwd=self.folder, env=env)
            run([at / "gobo", "render", scene, "-o", "tri.png", "--env", private_root.radiance(os.path.join(self.folder, "map.hdr")), *small], cwd=self.folder, env=env)   # by its gobo-ingest, with its codec
            self.assertTrue(pathlib.Path(self.folder, "tri.png").read_bytes().startswith(b"\x89PNG"))
            python = os.path.join(self.folder, "python")
            run(["dpkg-deb", "-x", self.packages["python3-gobo"], python])
            said = run(["/usr/bin/python3", "-c", "import gobo; print(gobo.connect().render('cornell', width=8, height=6, spp=1).image.shape)"],
                       env={**env, "PYTHONPATH": python + "/usr/lib/python3/dist-packages"}, cwd=self.folder)
            self.assertIn("(6, 8, ", said)
        finally:
            daemon.send_signal(signal.SIGTERM)
            self.assertEqual(daemon.wait(30), 0)
            daemon.stdout.close()

    def test_unit_user_and_folders(self):
        root = os.path.join(self.folder, "root")
        shutil.copytree(self.unpacked, root)
        for folder in ("etc", "var/lib", "var/cache"):
            os.makedirs(os.path.join(root, folder), exist_ok=True)
        unit = pathlib.Path(root, "usr/lib/systemd/system/gobod.service").read_text(encoding="utf-8")
        command = re.search(r"^ExecStart=(.*)$", unit, re.M)[1].split()
        self.assertTrue(os.access(root + command[0], os.X_OK))
        self.assertIn(command[2], [name for _, _, name in self.files("gobo")])
        if shutil.which("systemd-analyze"):
            here = os.path.join(self.folder, "gobod.service")
            pathlib.Path(here).write_text(unit.replace("/usr/bin/gobod", root + "/usr/bin/gobod"), encoding="utf-8")
            done = subprocess.run(["systemd-analyze", "verify", "--man=no", "--recursive-errors=no", here], capture_output=True, text=True, timeout=60, check=False)
            self.assertEqual((done.returncode, done.stdout + done.stderr), (0, ""))
        if shutil.which("systemd-sysusers") and os.geteuid() == 0:
            run(["systemd-sysusers", f"--root={root}", "gobo.conf"])
            user = re.search(r"^gobo:[^:]*:(\d+):(\d+):[^:]*:([^:]*):(.*)$", pathlib.Path(root, "etc/passwd").read_text(encoding="utf-8"), re.M)
            self.assertEqual(user.groups()[2:], ("/var/lib/gobo", "/usr/sbin/nologin"))
            run(["systemd-tmpfiles", f"--root={root}", "--create", "gobo.conf"])
            for place, mode, owner in (("var/lib/gobo", 0o700, int(user[1])), ("var/cache/gobo", 0o700, int(user[1])), ("etc/gobo/gobod.toml", 0o640, 0)):
                stat = os.stat(os.path.join(root, place))
                self.assertEqual((stat.st_mode & 0o7777, stat.st_uid, stat.st_gid), (mode, owner, int(user[2])), place)

    def test_lintian(self):
        if not shutil.which("lintian"):
            self.skipTest("lintian is not installed")
        done = subprocess.run(["lintian", "--fail-on=error", "--suppress-tags", "no-changelog,bogus-mail-host,bogus-mail-host-in-debian-changelog", *self.packages.values()],
                              capture_output=True, text=True, timeout=300, check=False)
        self.assertEqual(done.returncode, 0, done.stdout)

    # As dpkg installs them: this machine's files below, what is written in memory above. {0} is the folder.
    INSTALL = r"""
set -eu
mount --make-rprivate /
mkdir {0}/over && mount -t tmpfs over {0}/over && mkdir {0}/over/up {0}/over/work {0}/over/root
mount -t overlay overlay -o lowerdir=/,upperdir={0}/over/up,workdir={0}/over/work {0}/over/root || exit 77
root={0}/over/root
mount -t proc proc $root/proc; mount --rbind /dev $root/dev; mount -t tmpfs run $root/run; mount -t tmpfs tmp $root/tmp
cp {0}/*.deb $root/tmp/
rm -f $root/var/lib/man-db/auto-update; export HOME=/root DEBIAN_FRONTEND=noninteractive
inside() {{ chroot $root "$@"; }}
inside sh -c 'dpkg -i /tmp/*.deb' > $root/tmp/said 2>&1 || {{ cat $root/tmp/said; exit 1; }}
echo "status $(inside dpkg-query -W -f '${{Package}}=${{db:Status-Status}} ' gobo gobo-dev python3-gobo)"
echo "id $(inside id -gn gobo) $(inside getent passwd gobo | cut -d: -f6,7)"
inside stat -c 'stat %n %a %U:%G' /etc/gobo/gobod.toml /var/lib/gobo /var/cache/gobo /etc/gobo
echo "wanted $(inside readlink /etc/systemd/system/multi-user.target.wants/gobod.service)"
install -d -m 0750 -o "$(inside id -u gobo)" -g "$(inside id -g gobo)" $root/run/gobo     # RuntimeDirectory=
as() {{ inside setpriv --reuid gobo --regid gobo --clear-groups --no-new-privs --bounding-set=-all "$@"; }}
mkfifo $root/tmp/ready
as /usr/bin/gobod --config /etc/gobo/gobod.toml --check
(cd /; TMPDIR=/var/lib/gobo as /usr/bin/gobod --config /etc/gobo/gobod.toml --threads 2 > $root/tmp/ready 2> $root/tmp/log) & daemon=$!
head -n 1 $root/tmp/ready || cat $root/tmp/log
export GOBO_SERVER=unix:/run/gobo/gobo.sock
inside stat -c 'socket %a %U:%G' /run/gobo/gobo.sock
inside gobo render cornell -o /tmp/box.png --size 16x12 --spp 1 > /dev/null && echo "rendered $(head -c 4 $root/tmp/box.png | tail -c 3)"
inside /usr/bin/python3 -c 'import gobo; print("python", gobo.connect().render("cornell", width=8, height=6, spp=1).image.shape)'
inside gobo jobs submit cornell --frames 1 --size 16x12 --spp 1 --watch > /dev/null && echo "job done"
inside gobo shutdown > /dev/null; wait $daemon; echo "left $?"
echo '# mine' >> $root/etc/gobo/gobod.toml
inside sh -c 'dpkg -i /tmp/gobo_*.deb' > $root/tmp/said 2>&1 || {{ cat $root/tmp/said; exit 1; }}
echo "kept $(tail -n 1 $root/etc/gobo/gobod.toml) $(inside stat -c '%a %U:%G' /etc/gobo/gobod.toml)"
inside dpkg -r gobo-dev gobo > /dev/null 2>&1; [ -e $root/etc/gobo/gobod.toml ] && [ ! -e $root/usr/bin/gobod ] && [ -d $root/var/lib/gobo ] && echo removed
inside dpkg -P gobo > /dev/null 2>&1; for p in etc/gobo var/lib/gobo var/cache/gobo etc/systemd/system/multi-user.target.wants/gobod.service; do [ ! -e $root/$p ] && [ ! -L $root/$p ]; done; echo purged
"""

    def test_dpkg_installs_and_removes_them(self):
        if os.geteuid() != 0 or not shutil.which("unshare"):
            private_root.missing_here("a root of its own for dpkg needs root's rights and unshare")
        done = subprocess.run(["unshare", "-mpf", "--kill-child", "sh", "-c", self.INSTALL.format(self.folder)], capture_output=True, text=True, timeout=300,
                              env=private_root.clean_environment(), check=False)
        if done.returncode == 77:
            private_root.missing_here(f"this kernel mounts no overlay here: {done.stderr}")
        said = done.stdout
        self.assertEqual(done.returncode, 0, said + done.stderr)
        self.assertIn("status gobo=installed gobo-dev=installed python3-gobo=installed", said)
        self.assertIn("id gobo /var/lib/gobo:/usr/sbin/nologin\n", said)
        self.assertIn("stat /etc/gobo/gobod.toml 640 root:gobo\nstat /var/lib/gobo 700 gobo:gobo\nstat /var/cache/gobo 700 gobo:gobo\nstat /etc/gobo 755 root:root\n", said)
        self.assertRegex(said, r"wanted (/usr)?/lib/systemd/system/gobod\.service\n")
        self.assertIn("ready on unix:/run/gobo/gobo.sock", said)
        self.assertIn("socket 660 gobo:gobo\n", said)
        self.assertIn("rendered PNG\npython (6, 8, ", said)
        self.assertIn("job done\nleft 0\nkept # mine 640 root:gobo\nremoved\npurged\n", said)


if __name__ == "__main__":
    unittest.main()
