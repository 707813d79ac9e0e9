"""Builds kernel modules that Debian does not ship for a kernel of the cache: from lab/kernel, from files of the
kernel's source (listed in a file `sources`), and from Debian's headers.

Needs gcc, make, xz and libelf on this machine, no root, and no installed headers.
"""

import glob
import hashlib
import os
import shutil
import subprocess

from . import LabError

SOURCES = os.path.join(os.path.dirname(os.path.dirname(os.path.abspath(__file__))), "kernel")
# Folder of the header packages when they are installed; their makefiles name it.
INSTALLED = "/usr/src/"


class Missing(LabError):
    """The requirements of the build are missing: not an error of the source."""


class Broken(LabError):
    """The source does not build: the first line names it, the others have the reason."""


def build(cache, flavour, name):
    """The files of the modules that lab/kernel/`name` makes for the kernel `flavour`."""
    source = os.path.join(SOURCES, name)
    if not os.path.exists(os.path.join(source, "Kbuild")):
        raise LabError(f"there is no {source}/Kbuild")
    version = cache.kernel(flavour)[0]
    built = f"built-{name}-{version}-{digest(source)}"
    if not cache.has(built):
        compiler = shutil.which("gcc-12") or shutil.which("gcc")
        if not compiler or not shutil.which("make"):
            raise Missing(f"{name} is not built: gcc or make is missing: tools/require kbuild")
        headers = cache.made(f"headers-{version}", lambda new: unpack_headers(cache, flavour, version, new))

        def make(new):
            shutil.copytree(source, f"{new}/source")
            for path in kernel_sources(cache, version, source):
                shutil.copy(path, f"{new}/source")
            tree = f"{headers}{INSTALLED}linux-headers-{version}"
            command = ["make", "-C", tree, f"M={new}/source", f"CC={compiler}", "modules"]
            done = subprocess.run(command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
                                  text=True, check=False)
            if done.returncode:
                raise Broken(f"{name} is not built for {version}:\n{done.stdout.strip()}")
            for module in glob.glob(f"{new}/source/*.ko"):
                shutil.move(module, new)
            shutil.rmtree(f"{new}/source")

        cache.made(built, make)
    return sorted(glob.glob(cache.path(built, "*.ko")))


def kernel_sources(cache, version, source):
    """Files of the kernel's own source that the file `sources` names, where there is one."""
    listed = os.path.join(source, "sources")
    if not os.path.exists(listed):
        return []
    with open(listed, encoding="utf-8") as f:
        names = f.read().split()
    series = ".".join(version.split(".")[:2])

    def make(new):
        try:
            cache.unpack(f"linux-source-{series}", new)
            members = [f"linux-source-{series}/{name}" for name in names]
            archive = f"{new}{INSTALLED}linux-source-{series}.tar.xz"
            # Everything after the last of them stays packed.
            cache.run("tar", "-C", new, "--occurrence", "--strip-components=1", "-xJf", archive, *members)
        except LabError as error:
            raise Missing(f"no source of Linux {series}: {error}") from None
        shutil.rmtree(f"{new}/usr")

    folder = cache.made(f"source-{version}-{digest(source)}", make)
    return [os.path.join(folder, name) for name in names]


def digest(folder):
    """A digest of the state of a source."""
    sums = hashlib.sha256()
    for path in sorted(glob.glob(f"{folder}/**", recursive=True)):
        if os.path.isfile(path):
            with open(path, "rb") as f:
                sums.update(os.path.relpath(path, folder).encode() + b"\0" + hashlib.sha256(f.read()).digest())
    return sums.hexdigest()[:12]


def unpack_headers(cache, flavour, version, new):
    """The headers of a kernel with their dependencies, and their makefiles redirected to them."""
    package = f"linux-headers-{version}"
    try:
        for name in [package, *cache.depends(package)]:
            if name.startswith(("linux-headers-", "linux-kbuild-")):
                cache.unpack(name, new)
    except LabError as error:
        raise Missing(f"no headers of {version}: {error} (without kernel-{flavour} in the cache a newer one is fetched)") from None
    path = f"{new}{INSTALLED}{package}/Makefile"
    with open(path, encoding="utf-8") as f:
        text = f.read()
    # make runs in this folder.
    with open(path, "w", encoding="utf-8") as f:
        f.write(text.replace(INSTALLED, "../"))
