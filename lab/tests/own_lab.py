"""A separate lab for a test: a copy of the runner, checks written by the test, a filled cache, a script in QEMU's
place."""

import os
import shutil
import signal
import subprocess
import sys
import tempfile
import unittest

LAB = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
GUEST = os.path.join(LAB, "tests", "guest.py")
# No server listens there: no network.
NO_NETWORK = {"http_proxy": "http://127.0.0.1:9", "https_proxy": "http://127.0.0.1:9"}


class OwnLab(unittest.TestCase):
    """A separate lab with its own checks."""

    def setUp(self):
        self.folder = tempfile.mkdtemp(prefix="advee-lab-test.")
        self.addCleanup(shutil.rmtree, self.folder)
        for name in ("lab", "machine"):
            path = os.path.join(LAB, name)
            (shutil.copytree if os.path.isdir(path) else shutil.copy)(path, self.path("lab", name))
        self.checks = ""
        self.write("advee", "#!/bin/sh\n")
        self.fill_cache()
        self.write("bin/qemu-system-x86_64", f"#!/bin/sh\nexec {sys.executable} {GUEST} \"$@\"\n")

    def path(self, *names):
        path = os.path.join(self.folder, *names)
        os.makedirs(os.path.dirname(path), exist_ok=True)
        return path

    def write(self, name, text):
        with open(self.path(name), "w", encoding="utf-8") as f:
            f.write(text)
        os.chmod(self.path(name), 0o755)

    def fill_cache(self):
        """The cache after everything was fetched."""
        names = ("virtio_pci", "9p", "9pnet_virtio", "overlay", "virtio_console")
        modules = "cache/kernel-std/lib/modules/6.1.0-1-amd64"
        self.write(f"{modules}/modules.dep", "".join(f"{name}.ko:\n" for name in names))
        for name in names:
            self.write(f"{modules}/{name}.ko", "")
        self.write("cache/kernel-std/vmlinux", "")
        self.write("cache/package-busybox-static/bin/busybox", "")

    def check(self, name, script, **keys):
        self.write(f"lab/checks/{name}.sh", f"#!/bin/sh\n{script}\n")
        keys = {"name": name, "machine": "bus", "script": f"{name}.sh", "says": f"it is {name}", **keys}
        rows = "".join(f"{key} = {str(value).lower() if isinstance(value, bool) else repr(value)}\n"
                       for key, value in keys.items())
        self.checks += f"[[check]]\n{rows}\n"
        self.write("lab/lab.toml", f"[machine.bus]\n{self.checks}")

    def environment(self, **more):
        path = os.pathsep.join([self.path("bin"), *os.environ["PATH"].split(os.pathsep)])
        told = {"PATH": path, "LAB_CACHE": self.path("cache"), "ADVEE": self.path("advee")}
        # Settings of make test for the real lab do not apply to this one.
        inherited = {name: value for name, value in os.environ.items() if not name.startswith("ADVEE_")}
        return {**inherited, **NO_NETWORK, **told, **more}

    def start(self, *arguments, **environment):
        return subprocess.Popen([sys.executable, self.path("lab", "lab"), *arguments], env=self.environment(**environment),
                                stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
                                # Tests started by a shell in the background would ignore it.
                                preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL))

    def run_lab(self, *arguments, **environment):
        """(exit status, output)."""
        lab = self.start(*arguments, **environment)
        said, _ = lab.communicate(timeout=600)
        return lab.returncode, said

    def log(self, name):
        with open(self.path("target", "lab", f"{name}.log"), encoding="utf-8") as f:
            return f.read()
