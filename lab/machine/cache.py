"""Debian packages unpacked without installing them, kept between runs. Needs no root.

All that stands under its name is complete: it is made beside it and renamed. So a download that broke off is made anew,
and with what is there no network is needed.
"""

import fcntl
import glob
import hashlib
import lzma
import os
import re
import shutil
import subprocess

from . import LabError

KERNELS = {"std": "linux-image-amd64", "rt": "linux-image-rt-amd64"}
XZ = b"\xfd7zXZ\0"


class Cache:
    """The folder `root`, with a separate apt state: the system's lists are not changed."""

    def __init__(self, root, say):
        self.root = os.path.abspath(root)
        self.say = say
        # The messages of apt about its lists, once they were fetched.
        self.updated = ""
        for folder in ("lists/partial", "archives/partial"):
            os.makedirs(self.path("apt", folder), exist_ok=True)
        # One run at a time fills it; an unfinished folder of an earlier run is removed.
        self.lock = open(self.path("lock"), "w")

    def path(self, *parts):
        return os.path.join(self.root, *parts)

    def has(self, name):
        return os.path.isdir(self.path(name))

    def kernel(self, flavour):
        """(version, uncompressed kernel, module tree) of a Debian kernel, `std` or `rt`."""
        tree = self.made(f"kernel-{flavour}", lambda new: self.make_kernel(flavour, new))
        [version] = os.listdir(f"{tree}/lib/modules")
        return version, f"{tree}/vmlinux", f"{tree}/lib/modules/{version}"

    def busybox(self):
        return self.package("busybox-static") + "/bin/busybox"

    def package(self, name):
        """The folder with the content of a package."""
        return self.made(f"package-{name}", lambda new: self.unpack(name, new))

    def tree(self, packages):
        """A minimal Debian with these packages: the root of a machine other than this one."""
        key = hashlib.sha256(" ".join(packages).encode()).hexdigest()[:12]

        def make(new):
            if not shutil.which("mmdebstrap"):
                raise LabError("mmdebstrap is missing: apt-get install --no-install-recommends mmdebstrap")
            os.rmdir(new)
            self.run("mmdebstrap", "--quiet", "--variant=minbase", "--include=" + ",".join(packages), "bookworm", new)

        return self.made(f"debian-{key}", make)

    def made(self, name, make):
        """The folder of this name; if there is none, a new one filled by `make`."""
        path = self.path(name)
        fcntl.flock(self.lock, fcntl.LOCK_EX)
        try:
            if not self.has(name):
                self.say(f"fetching {name}")
                new = self.path(f"{name}.new")
                shutil.rmtree(new, ignore_errors=True)
                os.makedirs(new)
                make(new)
                os.sync()
                os.rename(new, path)
        finally:
            fcntl.flock(self.lock, fcntl.LOCK_UN)
        return path

    def make_kernel(self, flavour, new):
        depends = self.apt("apt-cache", "depends", KERNELS[flavour])
        found = re.search(r"Depends: (linux-image-(\S+))", depends)
        if not found:
            raise LabError(f"apt knows no {KERNELS[flavour]}: is this Debian?")
        package, version = found.groups()
        self.unpack(package, new)
        # vmlinuz is a loader and the kernel as xz: QEMU starts the kernel itself through its PVH note, so the guest
        # need not unpack it, which takes an emulated processor 3 s.
        with open(f"{new}/boot/vmlinuz-{version}", "rb") as f:
            image = f.read()
        if XZ not in image:
            raise LabError(f"{package}: its kernel is not compressed as xz")
        with open(f"{new}/vmlinux", "wb") as f:
            f.write(lzma.LZMADecompressor().decompress(image[image.index(XZ):]))
        for folder in ("boot", "usr"):
            shutil.rmtree(f"{new}/{folder}", ignore_errors=True)
        # kmod's depmod also writes the indexes that kmod and udev in the guest read.
        depmod = shutil.which("depmod", path=os.environ["PATH"] + ":/usr/sbin:/sbin")
        self.run(*([depmod] if depmod else [self.path("package-busybox-static/bin/busybox"), "depmod"]), "-b", new, version)

    def depends(self, package):
        """The dependencies of a package, by name."""
        return re.findall(r"Depends: (\S+)", self.apt("apt-cache", "depends", package))

    def unpack(self, name, new):
        # A fresh folder: an aborted download is not mistaken for a package, nor left there. apt checks the sums.
        folder = self.path("download")
        shutil.rmtree(folder, ignore_errors=True)
        os.makedirs(folder)
        self.apt("apt-get", "download", name, cwd=folder)
        [archive] = glob.glob(f"{folder}/*.deb")
        self.run("dpkg-deb", "-x", archive, new)
        shutil.rmtree(folder)

    def apt(self, tool, *arguments, cwd=None):
        state = self.path("apt")
        options = ["-q", "-o", f"Dir::State::lists={state}/lists", "-o", f"Dir::Cache={state}"]
        options += ["-o", "APT::Sandbox::User=", "-o", "Debug::NoLocking=1", "-o", "Acquire::Retries=2"]
        if not self.updated:
            # Some lists may suffice if others fail, so this is not an error yet.
            self.updated = self.run("apt-get", *options, "update", errors=True).strip() or "up to date"
        try:
            return self.run(tool, *options, *arguments, cwd=cwd)
        except LabError as error:
            why = re.search(r"^[EW]: (Failed to fetch .*)$", self.updated, re.M)
            raise LabError(f"{error} ({why.group(1)})" if why else str(error)) from None

    def run(self, *command, cwd=None, errors=False):
        """The output of a command, or with `errors` its error messages."""
        try:
            done = subprocess.run(command, cwd=cwd, text=True, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
                                  stderr=subprocess.PIPE, check=False)
        except FileNotFoundError:
            raise LabError(f"{command[0]} is missing") from None
        if done.returncode:
            told = (done.stderr.strip() or done.stdout.strip()).splitlines()
            raise LabError(f"{os.path.basename(command[0])} failed: {told[-1] if told else done.returncode}")
        return done.stderr if errors else done.stdout
