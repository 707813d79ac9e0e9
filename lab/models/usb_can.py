#!/usr/bin/env python3
"""usb_can.py COMMANDS LOG KIND...: CAN adapters on USB, all on one bus, for the running kernel, by USB/IP. KIND:
`usb2can` (driver usb_8dev, which restarts a controller that is bus-off) or `candle` (gs_usb, which may be unplugged:
usb_8dev of Linux 5.14 and later then frees its buffers twice).

Executes the commands read from the FIFO COMMANDS, each a word and the number of an adapter: `unplug`, `plug`; for a
usb2can also `off`, `warning`, `passive`, `active`, the state that its controller reports and keeps, and `stuff`, a frame
with an error. Requests of the driver are written to LOG: `0 open`, `0 close`.

A frame is sent when another adapter is open and acknowledges it. Otherwise it is repeated, as by a controller: the
transmit error counter rises by eight each time, to 128, where it is passive; the adapter accepts no further frames.
There is no bit time and no arbitration. Source: drivers/net/can/usb/usb_8dev.c and gs_usb.c of the kernel.
"""

import collections
import os
import struct
import subprocess
import sys
import threading

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import usbip

Frame = collections.namedtuple("Frame", "number extended remote length data")
# s between two attempts at sending a frame that is not acknowledged.
ATTEMPT = 0.01
ACTIVE, WARNING, PASSIVE, OFF, STUFF, NO_ACKNOWLEDGE = 0x00, 0x02, 0x03, 0x04, 0x20, 0x23


class Bus:
    def __init__(self, log):
        self.log = log
        self.lock = threading.RLock()
        self.waits = threading.Condition(self.lock)
        self.adapters = []
        threading.Thread(target=self.attempts, daemon=True).start()

    def attempts(self):
        """Sends a frame again that was not acknowledged."""
        with self.lock:
            while True:
                waiting = [adapter for adapter in self.adapters if adapter.on and adapter.asked[adapter.OUT]]
                for adapter in waiting:
                    adapter.failed()
                self.waits.wait(ATTEMPT if waiting else None)


class Adapter(usbip.Device):
    """What all kinds share: whether they are on the bus, and its frames."""

    OUT = 0x02  # the endpoint of frames from the host

    def __init__(self, bus):
        super().__init__()
        self.bus = bus
        self.lock = bus.lock
        self.number = len(bus.adapters)
        self.strings = ("LAB", self.called, f"LAB{self.number}")
        self.on = False
        bus.adapters.append(self)

    def others(self):
        """Who acknowledges what it sends."""
        return [other for other in self.bus.adapters if other is not self and other.on]

    def switch(self, on):
        """The host opens or closes it."""
        print(self.number, "open" if on else "close", file=self.bus.log, flush=True)
        self.on = on
        for other in self.others() if on else []:
            other.ready(self.OUT)

    def transmit(self, frames):
        """Whether they left."""
        others = self.others()
        if not others:
            self.bus.waits.notify()
            return False
        for frame in frames:
            for other in others:
                other.heard(frame)
        return True

    def failed(self):
        """Nobody acknowledged."""

    def unplug(self):
        self.on = False
        self.detach()


class Usb2Can(Adapter):
    driver, called = "usb_8dev", "USB2CAN converter"
    vendor, product, release = 0x0483, 0x1234, 0x0101
    IN, ANSWERS, COMMANDS = 0x81, 0x83, 0x04
    endpoints = tuple((address, usbip.BULK, 64, 0) for address in (IN, Adapter.OUT, ANSWERS, COMMANDS))
    OPEN, CLOSE = 2, 3
    EXTENDED, REMOTE = 1, 2
    FRAME, STATUS = 0, 3

    def __init__(self, bus):
        super().__init__(bus)
        self.reset()

    def reset(self):
        self.transmit_errors, self.state, self.held = 0, ACTIVE, False
        self.waiting[self.IN].clear()

    def take(self, endpoint, data):
        if endpoint == self.COMMANDS:
            self.obey(data[2])
            return True
        if not self.on:
            return True  # what was to be sent is dropped
        frames = []
        for at in range(0, len(data) - 15, 16):
            _, flags, number, length, data_bytes = struct.unpack(">BBIB8s", data[at : at + 15])
            frames.append(Frame(number, bool(flags & self.EXTENDED), bool(flags & self.REMOTE), length, data_bytes))
        if not self.transmit(frames):
            return False
        self.count(-1)
        return True

    def give(self, endpoint, length):
        """As many messages as there is room for."""
        data = b""
        while self.waiting[endpoint] and len(data) + len(self.waiting[endpoint][0]) <= length:
            data += self.waiting[endpoint].popleft()
        return data or None

    def obey(self, command):
        version = struct.pack(">I6x", 0x0101_0101)
        self.send(self.ANSWERS, struct.pack(">BBBBB10sB", 0x11, 0, command, 0, 0, version, 0x22))
        if command in (self.OPEN, self.CLOSE):
            self.reset()
            self.switch(command == self.OPEN)
        if self.on:
            self.tell(ACTIVE)

    def heard(self, frame):
        flags = frame.extended * self.EXTENDED | frame.remote * self.REMOTE
        self.message(self.FRAME, flags, frame.number, frame.length, frame.data)

    def message(self, kind, flags, number, length, data):
        self.send(self.IN, struct.pack(">BBBIB8sIB", 0x55, kind, flags, number, length, data, 0, 0xAA))

    def tell(self, what):
        if what == OFF:
            self.on = False
            self.ready(self.OUT)
        self.message(self.STATUS, 4, 0, 8, bytes([what, 0, self.transmit_errors, 0, 0, 0, 0, 0]))

    def failed(self):
        """Alone on its bus a controller does not get further than passive."""
        self.count(8)
        self.tell(NO_ACKNOWLEDGE)

    def count(self, errors):
        if self.held:
            return
        self.transmit_errors = min(max(self.transmit_errors + errors, 0), 128)
        state = PASSIVE if self.transmit_errors >= 128 else WARNING if self.transmit_errors >= 96 else ACTIVE
        if state != self.state:
            self.state = state
            self.tell(state)

    def is_told(self, what):
        """Something that its controller is to be, or that it saw."""
        if what != STUFF:
            self.state = what
            self.held = what in (WARNING, PASSIVE)
            self.transmit_errors = {WARNING: 96, PASSIVE: 128, OFF: 255}.get(what, 0)
        self.tell(what)


class Candle(Adapter):
    driver, called = "gs_usb", "candleLight USB to CAN adapter"
    vendor, product, release = 0x1D50, 0x606F, 0x0100
    IN = 0x81
    endpoints = ((IN, usbip.BULK, 32, 0), (Adapter.OUT, usbip.BULK, 32, 0))
    HOST_FORMAT, BIT_TIMING, MODE, CONSTANTS, CONFIGURATION = 0, 1, 2, 4, 5
    FRAME = struct.Struct("<IIBBBx8s")
    OTHERS = 0xFFFF_FFFF  # in place of the number of an own frame
    EXTENDED, REMOTE = 0x8000_0000, 0x4000_0000

    def control(self, kind, request, value, index, data, length):
        if request == self.CONFIGURATION:
            return struct.pack("<3xBII", 0, 2, 1)  # one channel
        if request == self.CONSTANTS:
            return struct.pack("<10I", 0, 48_000_000, 1, 16, 1, 8, 4, 1, 1024, 1)
        if request == self.MODE:
            self.waiting[self.IN].clear()
            self.switch(struct.unpack("<I", data[:4])[0] == 1)
        return b"" if request in (self.HOST_FORMAT, self.BIT_TIMING, self.MODE) else None

    def take(self, endpoint, data):
        if not self.on:
            return True
        _, number, length, _, _, data_bytes = self.FRAME.unpack(data[: self.FRAME.size])
        frame = Frame(number & 0x1FFF_FFFF, bool(number & self.EXTENDED), bool(number & self.REMOTE), length, data_bytes)
        if not self.transmit([frame]):
            return False
        self.send(self.IN, data[: self.FRAME.size])  # it has left
        return True

    def heard(self, frame):
        number = frame.number | frame.extended * self.EXTENDED | frame.remote * self.REMOTE
        self.send(self.IN, self.FRAME.pack(self.OTHERS, number, frame.length, 0, 0, frame.data))


def main():
    commands, log, *kinds = sys.argv[1:]
    kinds = [{"usb2can": Usb2Can, "candle": Candle}[kind] for kind in kinds]
    does = {"active": ACTIVE, "warning": WARNING, "passive": PASSIVE, "off": OFF, "stuff": STUFF}
    with open(log, "w", encoding="ascii") as out:
        bus = Bus(out)
        for number, kind in enumerate(kinds):
            subprocess.run(["modprobe", kind.driver], check=True)
            kind(bus).attach()
            usbip.appears(lambda number=number: os.path.exists(f"/sys/class/net/can{number}"))
        print("ready", file=out, flush=True)
        # Held open for writing, too: it does not end with a writer.
        with open(os.open(commands, os.O_RDWR), encoding="ascii") as lines:
            for line in lines:
                what, number = line.split()
                adapter = bus.adapters[int(number)]
                with bus.lock:
                    if what == "unplug":
                        adapter.unplug()
                    elif what == "plug":
                        adapter.attach()
                    else:
                        adapter.is_told(does[what])


if __name__ == "__main__":
    main()
