"""One boot of a machine: QEMU's arguments, the guest's output, the result."""

import contextlib
import os
import re
import select
import shutil
import signal
import socket
import subprocess
import time

from . import LabError

QEMU = "qemu-system-x86_64"
# Maximum wall time of a guest until its first check: it takes 3 s, 25 s with systemd on a busy host.
UP_WITHIN = 300
# Beginning of a kernel's panic message.
PANIC = "Kernel panic"
# Maximum length of a line of the guest.
LINE_MAX = 4096
# KVM is given up if the kernel does not run within this time.
LIFE_WITHIN = 15


def kvm_works():
    """True if KVM runs an unmodified kernel on the processor. A /dev/kvm alone is not enough: the back end pvm starts
    one under the instruction emulator, some hundred times slower than QEMU's own translator."""
    try:
        with open("/proc/cpuinfo", encoding="utf-8") as f:
            flags = re.search(r"^flags\s*:(.*)$", f.read(), re.M).group(1).split()
    except (OSError, AttributeError):
        return False
    usable = os.access("/dev/kvm", os.R_OK | os.W_OK) and not os.path.exists("/sys/module/kvm_pvm")
    return usable and bool({"vmx", "svm"} & set(flags))


def free_port():
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        return s.getsockname()[1]


class Boot:
    """A running guest, until `end()`, which any thread may call. `lines()` yields its output; then `ended` is the
    reason for its end: `done`, `time limit`, `reset` (a reset, a panic, an unexpected power-off) or `not up`."""

    def __init__(self, machine, files, work, kvm=False):
        self.console_path = f"{work}/console"
        self.ended = None
        self.started = time.monotonic()
        self.up = None
        self.web = free_port() if machine.network else None
        self.limit = (LIFE_WITHIN if kvm else UP_WITHIN, "not up")
        open(self.console_path, "w", encoding="utf-8").close()
        # If the lab is killed, the machine ends, too.
        guard = ["setpriv", "--pdeathsig", "KILL", "--"] if shutil.which("setpriv") else []
        if not shutil.which(QEMU):
            raise LabError(f"{QEMU} is missing: apt-get install --no-install-recommends qemu-system-x86")
        # Its input stays open: at end of file QEMU treats the port as unplugged, and the guest's writes block forever.
        self.process = subprocess.Popen([*guard, *self.arguments(machine, files, kvm)], stdin=subprocess.PIPE,
                                        stdout=subprocess.PIPE, start_new_session=True)

    def arguments(self, machine, files, kvm):
        def share(tag, path, writable=False):
            options = f"local,id={tag},path={path},security_model=none,multidevs=remap" + ("" if writable else ",readonly=on")
            return ["-fsdev", options, "-device", f"virtio-9p-pci,fsdev={tag},mount_tag={tag}"]

        if machine.ns_per_instruction:
            # The clock counts executed instructions, independent of the host's load. While the guest is idle, time
            # follows the host's, or jumps to the next event: then reading a file over a share takes hours.
            shift = machine.ns_per_instruction.bit_length() - 1
            idle = "off" if machine.skip_idle else "on"
            clock = ["-accel", "tcg,thread=single,tb-size=256", "-icount", f"shift={shift},sleep={idle}", "-cpu", "max"]
        elif kvm:
            clock = ["-accel", "kvm", "-cpu", "host"]
        else:
            clock = ["-accel", "tcg,thread=multi,tb-size=256", "-cpu", "max"]
        # Self-tests and ACPI's routing of interrupts take a fifth of the boot.
        parameters = "console=ttyS0 panic=-1 quiet cryptomgr.notests acpi=noirq mitigations=off nokaslr tsc=reliable random.trust_cpu=on"
        arguments = [
            QEMU, "-nodefaults", "-no-user-config", "-no-reboot", "-display", "none", "-M", "pc", *clock,
            "-smp", str(machine.processors), "-m", str(machine.memory), "-kernel", files["kernel"], "-initrd", files["initrd"],
            "-append", f"{parameters} {machine.parameters}".strip(),
            "-chardev", f"file,id=console,path={self.console_path}", "-serial", "chardev:console",
            "-device", "isa-debug-exit,iobase=0xf4,iosize=1",
            "-device", "virtio-serial-pci", "-chardev", "stdio,id=lab,signal=off",
            "-device", "virtserialport,chardev=lab,name=lab",
            *share("root", files["root"]), *share("modules", files["modules"]), *share("share", files["share"], True),
        ]
        if files["root"] != "/":
            arguments += share("source", files["source"])
        if self.web:
            network = f"user,id=net,restrict=on,hostfwd=tcp:127.0.0.1:{self.web}-10.0.2.15:8080"
            arguments += ["-netdev", network, "-device", "virtio-net-pci,netdev=net,romfile="]
        return arguments + machine.qemu

    def within(self, seconds):
        """Sets the time limit, wall time from this call on."""
        self.limit = (time.monotonic() - self.started + seconds, "time limit")

    def lines(self):
        out = self.process.stdout
        rest = b""
        while True:
            left = self.limit[0] - (time.monotonic() - self.started)
            if left <= 0:
                self.ended = self.limit[1]
                self.end()
                return
            if not select.select([out], [], [], min(left, 1))[0]:
                continue
            data = os.read(out.fileno(), 65536)
            if not data:
                break
            *lines, rest = (rest + data).split(b"\n")
            if len(rest) > LINE_MAX:
                lines, rest = [*lines, rest], b""
            for line in lines:
                self.up = self.up or time.monotonic() - self.started
                yield line[:LINE_MAX].decode(errors="replace").rstrip("\r")
        # isa-debug-exit: twice the value written, plus one.
        self.ended = "done" if self.process.wait() == 3 else "reset" if self.up else "not up"

    def end(self):
        if self.process.poll() is None:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(self.process.pid, signal.SIGKILL)
            self.process.wait()

    def console(self, lines=30):
        """The end of the kernel's output; after a panic, from there on."""
        with open(self.console_path, "rb") as f:
            f.seek(max(0, os.fstat(f.fileno()).st_size - 65536))
            said = f.read().decode(errors="replace").splitlines()
        panics = [number for number, line in enumerate(said) if PANIC in line]
        return "\n".join(said[panics[0]:][:lines] if panics else said[-lines:])
