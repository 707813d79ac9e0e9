"""USB devices modelled in Python, for the running kernel: it accesses them through its own USB/IP host controller
(vhci_hcd), so that the kernel's drivers of serial, CAN and I2C adapters run on them unchanged.

A model is a `Device` with a description and three methods: `control`, `take` (data from the host), `give` (data to
the host). They are called one at a time, with `lock` held; other threads hold it while they access the model's state,
and call `send` or `ready` when there is new data. Control, bulk and interrupt endpoints; no isochronous ones.
Source: Documentation/usb/usbip_protocol.rst of the kernel; Universal Serial Bus Specification 2.0, chapter 9.
"""

import collections
import os
import socket
import struct
import subprocess
import threading
import time

HOST = "/sys/devices/platform/vhci_hcd.0"
LOW_SPEED, FULL_SPEED = 1, 2
BULK, INTERRUPT = 2, 3
IN = 0x80
FREE = 4  # of a port, in the host controller's `status`
SUBMIT, UNLINK, SUBMITTED, UNLINKED = 1, 2, 3, 4
STALL, RESET = -32, -104  # EPIPE, ECONNRESET


class Device:
    """A device of one configuration with one interface. A subclass says what it is, by these:"""

    speed = FULL_SPEED
    vendor = product = release = 0
    strings = ("LAB", "", "")  # manufacturer, product, serial number
    interface = (255, 0, 0)  # class, subclass, protocol
    control_packet = 64  # bytes at most in a packet of endpoint 0
    endpoints = ()  # (address, BULK or INTERRUPT, bytes at most in a packet, ms between two questions)

    def __init__(self):
        self.lock = threading.RLock()
        self.port = None
        self.ours = None
        # By address: transfers that the host has asked for (sequence, length, data), and what waits for it to ask.
        self.asked = collections.defaultdict(collections.deque)
        self.waiting = collections.defaultdict(collections.deque)

    # -- what a model is made of ------------------------------------------------------------------------------------

    def control(self, kind, request, value, index, data, length):
        """A class or vendor request: what is answered, at most `length` bytes and none to a write; None refuses it."""
        return None

    def take(self, endpoint, data):
        """The host sends; False keeps it waiting, and offers it again at the next `ready`."""

    def give(self, endpoint, length):
        """The host asks for up to `length` bytes: they, or None until the next `ready`. By default what was `send`."""
        waiting = self.waiting[endpoint]
        return waiting.popleft() if waiting else None

    def send(self, endpoint, data):
        """A transfer for the host, whole, when it asks."""
        with self.lock:
            self.waiting[endpoint].append(data)
            self.ready(endpoint)

    def ready(self, endpoint):
        """`give` has something, or `take` has room again."""
        with self.lock:
            asked = self.asked[endpoint]
            while asked:
                sequence, length, data = asked[0]
                if endpoint & IN:
                    given = self.give(endpoint, length)
                    if given is None:
                        return
                    assert len(given) <= length, f"{len(given)} bytes, asked for {length}"
                    self.done(sequence, 0, given, len(given))
                else:
                    if self.take(endpoint, data) is False:
                        return
                    self.done(sequence, 0, b"", length)
                asked.popleft()

    # -- plug and unplug --------------------------------------------------------------------------------------------

    def attach(self):
        """Plugs it in: the first free port. The kernel then asks for its description, and looks for its driver."""
        subprocess.run(["modprobe", "vhci_hcd"], check=True)
        with open(f"{HOST}/status", encoding="ascii") as status:
            ports = [line.split() for line in status]
        free = [int(port[1]) for port in ports if port[0] == "hs" and int(port[2]) == FREE]
        if not free:
            raise OSError("no port of the host controller is free")
        with self.lock:
            self.port = free[0]
            self.asked.clear()
            self.waiting.clear()
            self.ours, kernel = socket.socketpair()
            with kernel, open(f"{HOST}/attach", "w", encoding="ascii") as attach:
                attach.write(f"{self.port} {kernel.fileno()} {0x10001 + self.port} {self.speed}\n")
        threading.Thread(target=self.serve, args=(self.ours,), daemon=True).start()

    def detach(self):
        """Unplugs it, whatever the kernel does with it just now; it may be attached again."""
        with open(f"{HOST}/detach", "w", encoding="ascii") as detach:
            detach.write(f"{self.port}\n")

    # -- between kernel and model -----------------------------------------------------------------------------------

    def serve(self, kernel):
        """Until it is unplugged."""
        try:
            with kernel:
                while True:
                    header = read(kernel, 48)
                    command, sequence, _, inwards, endpoint = struct.unpack(">IIIII", header[:20])
                    if command == SUBMIT:
                        (length,) = struct.unpack(">I", header[24:28])
                        data = b"" if inwards else read(kernel, length)
                    with self.lock:
                        if kernel is not self.ours:
                            return  # plugged in again already
                        if command == SUBMIT:
                            self.submitted(sequence, endpoint | (IN if inwards else 0), header[40:48], data, length)
                        elif command == UNLINK:
                            self.unlinked(sequence, struct.unpack(">I", header[20:24])[0])
        except (EOFError, OSError):
            pass

    def submitted(self, sequence, endpoint, setup, data, length):
        if endpoint & ~IN:
            self.asked[endpoint].append((sequence, length, data))
            # Those before it are asked first; where they wait, it waits.
            if len(self.asked[endpoint]) == 1:
                self.ready(endpoint)
            return
        kind, request, value, index, _ = struct.unpack("<BBHHH", setup)
        if kind & 0x60:
            said = self.control(kind, request, value, index, data, length)
        else:
            said = self.standard(kind, request, value)
        if said is None:
            self.done(sequence, STALL, b"", 0)
        else:
            said = said[:length] if endpoint & IN else b""
            self.done(sequence, 0, said, len(said) if endpoint & IN else length)

    def unlinked(self, sequence, victim):
        """The host takes a transfer back, unless it is answered already."""
        found = False
        for endpoint, asked in self.asked.items():
            left = [one for one in asked if one[0] != victim]
            found |= len(left) != len(asked)
            self.asked[endpoint] = collections.deque(left)
        self.ours.sendall(struct.pack(">IIIIIi", UNLINKED, sequence, 0, 0, 0, RESET if found else 0) + bytes(24))

    def done(self, sequence, status, data, length):
        header = struct.pack(">IIIIIiIIII8x", SUBMITTED, sequence, 0, 0, 0, status, length, 0, 0, 0)
        try:
            self.ours.sendall(header + data)
        except OSError:
            pass  # unplugged just now

    def standard(self, kind, request, value):
        """The requests that every device answers (USB 2.0, 9.4)."""
        if request == 6:  # GET_DESCRIPTOR
            return self.descriptor(value >> 8, value & 0xFF)
        return bytes(2) if kind & IN else b""  # GET_STATUS; what is set has no effect

    def descriptor(self, kind, number):
        if kind == 1:  # device
            return struct.pack("<BBHBBBBHHHBBBB", 18, 1, 0x0200, 0, 0, 0, self.control_packet, self.vendor, self.product,
                               self.release, 1, 2, 3, 1)
        if kind == 2:  # configuration
            rest = struct.pack("<9B", 9, 4, 0, 0, len(self.endpoints), *self.interface, 0)
            for address, transfer, packet, interval in self.endpoints:
                rest += struct.pack("<BBBBHB", 7, 5, address, transfer, packet, interval)
            return struct.pack("<BBHBBBBB", 9, 2, 9 + len(rest), 1, 1, 0, 0x80, 50) + rest
        if kind == 3 and number <= len(self.strings):
            text = self.strings[number - 1].encode("utf-16le") if number else b"\x09\x04"  # American English
            return bytes([2 + len(text), 3]) + text
        return None


def read(kernel, length):
    data = b""
    while len(data) < length:
        more = kernel.recv(length - len(data))
        if not more:
            raise EOFError
        data += more
    return data


def appears(find, seconds=10):
    """What `find` returns once that is anything; for a path: `lambda: glob.glob(path)`."""
    until = time.monotonic() + seconds
    while time.monotonic() < until:
        found = find()
        if found:
            return found
        time.sleep(0.02)
    raise TimeoutError(f"did not appear within {seconds} s")
