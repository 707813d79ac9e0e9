#!/usr/bin/env python3
"""The simulated EIA-485 bus behaves as one: all other ports receive what a port sends, at wire speed, by their own
parity.

The other checks rely on this bus: nothing of ours runs here but the kernel module.
"""

import fcntl
import os
import struct
import sys
import termios
import time

CMSPAR = 0o10000000000
TIOCGRS485, TIOCSRS485, TIOCSERGETLSR = 0x542E, 0x542F, 0x5459
PARITY = {
    "none": 0, "even": termios.PARENB, "mark": termios.PARENB | termios.PARODD | CMSPAR, "space": termios.PARENB | CMSPAR,
}
failed = []


class Port:
    """One of the ports of the first bus, set up as a board's or a master's: errors are marked."""

    def __init__(self, number, parity="space"):
        self.file = os.open(f"/dev/ttyLAB{number}", os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        self.set(parity)
        termios.tcflush(self.file, termios.TCIOFLUSH)

    def set(self, parity, baud=termios.B38400, when=termios.TCSADRAIN):
        settings = termios.tcgetattr(self.file)
        settings[0] = termios.INPCK | termios.PARMRK
        settings[1] = settings[3] = 0
        settings[2] = termios.CS8 | termios.CREAD | termios.CLOCAL | PARITY[parity]
        settings[4] = settings[5] = baud
        termios.tcsetattr(self.file, when, settings)

    def send(self, text):
        os.write(self.file, bytes.fromhex(text))

    def frame(self, address, rest):
        """An address in mark parity, the rest in space parity."""
        self.set("mark")
        self.send(address)
        self.set("space")
        self.send(rest)
        termios.tcdrain(self.file)

    def heard(self):
        time.sleep(0.02)
        try:
            return os.read(self.file, 4096).hex(" ")
        except BlockingIOError:
            return ""

    def count(self):
        """(received, framing errors, parity errors, breaks) so far."""
        told = struct.unpack("20i", fcntl.ioctl(self.file, 0x545D, bytes(80)))
        return told[4], told[6], told[8], told[9]

    def direction(self, *told):
        """Sets (flags, ms before, ms after); returns the values that the port accepted."""
        fcntl.ioctl(self.file, TIOCSRS485, struct.pack("8I", *told, 0, 0, 0, 0, 0))
        return struct.unpack("8I", fcntl.ioctl(self.file, TIOCGRS485, bytes(32)))[:3]


def same(what, seen, expected):
    print(f"{'ok' if seen == expected else 'FAILED':7} {what}: {seen}" + ("" if seen == expected else f", not {expected}"))
    if seen != expected:
        failed.append(what)


def main():
    master, one, two = Port(0), Port(1), Port(2)
    master.frame("42", "44 41 ff 00")
    same("an address and its frame, in space parity", one.heard(), "ff 00 42 44 41 ff ff 00")
    same("the other board receives the same", two.heard(), "ff 00 42 44 41 ff ff 00")
    same("the sender receives nothing", master.heard(), "")
    one.set("mark")
    master.frame("ff", "01")
    same("in mark parity the address is plain, the rest marked", one.heard(), "ff ff ff 00 01")
    one.set("none")
    master.frame("42", "44")
    same("without parity a space is a missing stop bit", one.heard(), "42 ff 00 44")
    before = two.count()
    one.set("space", termios.B9600)
    master.frame("42", "44")
    same("at another rate garbage is received", one.heard(), "ff 00 42 ff 00 44")
    same("at the right rate a parity error is counted", [b - a for a, b in zip(before, two.count())], [2, 0, 1, 0])
    one.set("space")
    two.heard()

    begin = time.monotonic()
    master.send("55" * 384)
    termios.tcdrain(master.file)
    took = (time.monotonic() - begin) * 1e3
    print(f"384 characters of 11 bits at 38400 Bd: {took:.1f} ms, the wire's own is 110.0")
    same("duration on the wire, plus at most two polls of the kernel for the end", 110.0 <= took < 125, True)
    same("all of them arrived", (len(one.heard().split()), len(two.heard().split())), (384, 384))

    one.send("41" * 4)
    two.send("42" * 4)
    same("two simultaneous senders spoil each other", master.heard(), " ".join(["ff 00 00"] * 8))
    one.heard()
    two.heard()
    master.send("41")
    master.set("mark", when=termios.TCSANOW)
    same("a parity change during a character spoils it", one.heard(), "ff 00 00")
    master.set("space")
    termios.tcsendbreak(master.file, 0)
    same("a break", (one.heard(), one.count()[3]), ("ff 00 00", 1))
    two.heard()

    same("the direction setting is kept", master.direction(0b011, 3, 0), (0b011, 3, 0))
    same("an unsupported setting is not", master.direction(0b011, 0, 3), (0b011, 0, 0))
    same("with RX_DURING_TX a port receives its own data", (master.direction(0b10011, 0, 0), master.send("41"), master.heard()),
         ((0b10011, 0, 0), None, "41"))
    master.direction(0b011, 3, 0)
    begin = time.monotonic()
    master.send("41")
    while not struct.unpack("I", fcntl.ioctl(master.file, TIOCSERGETLSR, bytes(4)))[0]:
        pass
    took = (time.monotonic() - begin) * 1e3
    same(f"RTS is on 3 ms before ({took:.2f} ms to the end of the character)", 3.28 <= took < 4, True)
    return 1 if failed else 0


sys.exit(main())
