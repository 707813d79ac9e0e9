#!/usr/bin/env python3
"""ftdi.py LINK BY_ID: a USB adapter to EIA-485 with an FT232R, plugged into the kernel that runs this; its wire is the
serial line of two-byte words at LINK, where the simulator has the boards.

Commands on standard input, one per line: `plug`, `unplug`, `other` (plugs in a second one, which takes the first free
number), `end`; each is answered with a line on standard output. While it is plugged in, BY_ID is a link to its device
file, as udev would create it.

The chip is modelled as far as needed for nine bits: its transmitter has a FIFO and a shift register and takes the time
of the wire; the parity at the beginning of a character applies, and a character during which it changes is spoilt;
received characters wait for the latency timer or a full packet; errors are reported per packet, so a packet has
characters of one kind.
Sources: FTDI, FT232R USB UART IC data sheet 2.15; AN232B-04 (latency, status bytes); the kernel's ftdi_sio.h
(requests).
"""

import collections
import glob
import os
import select
import sys
import termios
import threading
import time
import tty

import usbip

RESET, BAUD, DATA, MODEM_STATUS, SET_LATENCY, LATENCY, EEPROM = 0, 3, 4, 5, 9, 10, 0x90
PARITY_ERROR, FRAMING_ERROR, ROOM, EMPTY = 0x04, 0x08, 0x20, 0x40  # of the line's status, as a 16450 has it
MODEM = 0x31  # CTS, DSR, and a constant one
NINTH = {3: 1, 4: 0}  # of DATA's parity: mark, space
FIFO = 128
PACKET = 62  # characters, after two bytes of status
CLOCK = 3_000_000
EIGHTHS = (0, 3, 2, 4, 1, 5, 6, 7)  # the code of each eighth of a divisor
BITS = 11


class Ft232r(usbip.Device):
    """The chip. `wire(ninth, byte)` is called for each character sent; `heard` is called with received ones."""

    vendor, product, release = 0x0403, 0x6001, 0x0600
    endpoints = ((0x81, usbip.BULK, 64, 0), (0x02, usbip.BULK, 64, 0))
    control_packet = 8

    def __init__(self, serial, wire=lambda ninth, byte: None):
        super().__init__()
        self.strings = ("FTDI", "FT232R USB UART", serial)
        self.wire = wire
        self.news = threading.Condition(self.lock)
        self.reset()
        for work in (self.transmit, self.hand_on):
            threading.Thread(target=work, daemon=True).start()

    def reset(self):
        self.fifo = collections.deque()
        self.sending = self.spoilt = False
        self.parity, self.baud, self.latency = 0, 9600, 16
        self.received = collections.deque()  # (byte, error)
        self.due = None
        # Characters sent in each parity, and the number spoilt by a change of parity.
        self.sent = collections.Counter()

    # -- from the host ------------------------------------------------------------------------------------------------

    def control(self, kind, request, value, index, data, length):
        if request == DATA:
            parity = value >> 8 & 7
            self.spoilt |= self.sending and parity != self.parity
            self.parity = parity
        elif request == BAUD:
            code = value >> 14 | (index & 1) << 2
            divisor = (value & 0x3FFF) + EIGHTHS.index(code) / 8
            self.baud = round(CLOCK / max(divisor, 1))
        elif request == SET_LATENCY:
            self.latency = max(value & 0xFF, 1)
        elif request == LATENCY:
            return bytes([self.latency])
        elif request == MODEM_STATUS:
            return bytes([MODEM, self.line_status()])
        elif request == EEPROM:
            return b"\xff\xff"  # blank
        elif request == RESET and value == 2:
            self.fifo.clear()
        return b""

    def line_status(self):
        return (ROOM if len(self.fifo) < FIFO else 0) | (0 if self.fifo or self.sending else EMPTY)

    def take(self, endpoint, data):
        if len(self.fifo) + len(data) > FIFO:
            return False
        self.fifo.extend(data)
        self.news.notify_all()
        return True

    # -- the wire -----------------------------------------------------------------------------------------------------

    def transmit(self):
        free = 0
        with self.lock:
            while True:
                while not self.fifo:
                    self.sending = False
                    self.news.wait()
                byte, parity = self.fifo.popleft(), self.parity
                self.sending, self.spoilt = True, False
                self.ready(0x02)
                free = max(free, time.monotonic()) + BITS / self.baud
                left = free - time.monotonic()
                if left > 0:
                    self.lock.release()
                    time.sleep(left)
                    self.lock.acquire()
                self.sent["spoilt" if self.spoilt else {3: "mark", 4: "space"}.get(parity, "other")] += 1
                if self.ours:
                    self.wire(NINTH.get(parity, 1), 0 if self.spoilt else byte)

    def heard(self, words):
        """Receives characters: (ninth, byte) each."""
        with self.lock:
            for ninth, byte in words:
                wrong = self.parity in NINTH and NINTH[self.parity] != ninth
                self.received.append((byte, PARITY_ERROR if wrong else 0))
            self.due = self.due or time.monotonic() + self.latency / 1e3
            self.news.notify_all()

    def hand_on(self):
        """Offers received characters, after the latency timer."""
        with self.lock:
            while True:
                left = self.due - time.monotonic() if self.due else None
                if left is None or left > 0 and len(self.received) < PACKET:
                    self.news.wait(left)
                    continue
                self.due = None
                self.ready(0x81)

    def give(self, endpoint, length):
        # Packets with status only, which a real chip sends continuously, are left out.
        if not self.received or self.due:
            return None
        error = self.received[0][1]
        packet = bytearray([MODEM, self.line_status() | error])
        while self.received and self.received[0][1] == error and len(packet) < min(length, 2 + PACKET):
            packet.append(self.received.popleft()[0])
        return bytes(packet)


class TwoByte:
    """The simulator's line: each word its byte, then its ninth bit."""

    def __init__(self, link):
        self.link, self.file, self.rest = link, None, b""

    def send(self, ninth, byte):
        file = self.file
        if file is not None:
            os.write(file, bytes([byte, ninth]))

    def listen(self, heard):
        """Opens the line whenever it exists, and forwards received words."""
        while True:
            try:
                self.file, self.rest = os.open(self.link, os.O_RDWR | os.O_NOCTTY), b""
                tty.setraw(self.file)
                while True:
                    select.select([self.file], [], [])
                    data = self.rest + os.read(self.file, 4096)
                    if not data:
                        raise OSError("gone")
                    whole = len(data) & ~1
                    self.rest = data[whole:]
                    heard([(data[i + 1], data[i]) for i in range(0, whole, 2)])
            except (OSError, termios.error):
                if self.file is not None:
                    file, self.file = self.file, None
                    os.close(file)
                time.sleep(0.1)


def terminal(chip):
    """The name of the terminal that the kernel created for it."""
    found = glob.glob(f"/sys/bus/usb/devices/*-{chip.port + 1}:1.0/ttyUSB*")
    return os.path.basename(found[0]) if found else None


def plug(chip, link):
    chip.reset()
    chip.attach()
    name = usbip.appears(lambda: terminal(chip))
    usbip.appears(lambda: os.path.exists(f"/dev/{name}"))
    if link:
        os.makedirs(os.path.dirname(link), exist_ok=True)
        os.symlink(f"/dev/{name}", link)
    return f"plugged in: {name}"


def unplug(chip, link):
    if link:
        os.remove(link)
    chip.detach()
    return (f"unplugged; it had sent {chip.sent['mark']} characters in mark parity, {chip.sent['space']} in space parity, "
            f"{chip.sent['other']} in others, {chip.sent['spoilt']} spoilt; {chip.baud} Bd, latency {chip.latency} ms")


def main():
    link, by_id = sys.argv[1:]
    line = TwoByte(link)
    chip, other = Ft232r("LAB00001", line.send), Ft232r("LAB00002")
    threading.Thread(target=line.listen, args=(chip.heard,), daemon=True).start()
    for command in sys.stdin:
        command = command.strip()
        said = {"plug": lambda: plug(chip, by_id), "unplug": lambda: unplug(chip, by_id), "other": lambda: plug(other, None)}
        if command == "end":
            return
        print(said[command]() if command in said else f"what is {command}?", flush=True)


if __name__ == "__main__":
    main()
