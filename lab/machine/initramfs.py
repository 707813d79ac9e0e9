"""The guest's initial file system: busybox, the modules for the shares, and our own start."""

import os

# Modules for access to the host's folders and for output to it.
MODULES = ["virtio_pci", "9p", "9pnet_virtio", "overlay", "virtio_console"]
GUEST = os.path.join(os.path.dirname(os.path.abspath(__file__)), "guest")


def build(busybox, tree, settings):
    """A cpio archive. `tree` is the kernel's modules, `settings` the input of guest/init and guest/main."""
    archive = Cpio()
    for folder in ("bin", "dev", "proc", "sys", "modules"):
        archive.add(folder, 0o040755)
    archive.add("dev/console", 0o020600, device=(5, 1))
    archive.add("bin/busybox", 0o100755, read(busybox))
    order = load_order(tree, MODULES)
    for path in order:
        archive.add("modules/" + os.path.basename(path), 0o100644, read(f"{tree}/{path}"))
    archive.add("modules/order", 0o100644, "\n".join(map(os.path.basename, order)).encode())
    for name in ("init", "main", "checks"):
        archive.add(name, 0o100755, read(os.path.join(GUEST, name)))
    text = "".join(f"{name}={quoted(value)}\n" for name, value in settings.items())
    archive.add("settings", 0o100644, text.encode())
    return archive.finish()


def read(path):
    with open(path, "rb") as f:
        return f.read()


def quoted(value):
    return "'" + str(value).replace("'", "'\\''") + "'"


def load_order(tree, wanted):
    """The files of the modules and of their dependencies, in the order of loading."""
    needs = {}
    with open(f"{tree}/modules.dep", encoding="utf-8") as f:
        for line in f:
            path, _, others = line.partition(":")
            needs[module(path)] = (path, others.split())
    order = []

    def add(name):
        path, others = needs[name]
        for other in others:
            add(module(other))
        if path not in order:
            order.append(path)

    for name in wanted:
        add(name.replace("-", "_"))
    return order


def module(path):
    return os.path.basename(path).removesuffix(".ko").replace("-", "_")


class Cpio:
    """An archive in the format newc (the kernel's early-userspace/buffer-format): a device node in it needs no root."""

    def __init__(self):
        self.data = bytearray()
        self.count = 0

    def add(self, name, mode, content=b"", device=(0, 0)):
        self.count += 1
        path = name.encode() + b"\0"
        fields = (self.count, mode, 0, 0, 1, 0, len(content), 0, 0, *device, len(path), 0)
        self.data += b"070701" + b"".join(b"%08X" % field for field in fields) + path
        self.pad()
        self.data += content
        self.pad()

    def pad(self):
        self.data += bytes(-len(self.data) % 4)

    def finish(self):
        self.add("TRAILER!!!", 0)
        return bytes(self.data)
