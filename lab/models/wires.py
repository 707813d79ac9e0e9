#!/usr/bin/env python3
"""wires.py COMMANDS LOG: a MAX6615 at 0x18, level by level on two wires of lab/kernel/wires: SDA is bit 0, SCL bit 1.

It is at the far end of two GPIO lines, so that a bit-banged master meets a chip through the kernel's own GPIO code. The
kernel module stretches the clock for it: SCL stays low after each fall until this program has answered.

Executes the commands read from the FIFO COMMANDS, one per line, and writes each to LOG when it is done: those of
i2c_usb.py, except `plug` and `unplug`. `count` writes how many STARTs, STOPs and rises of SCL there were so far.
Written from UM10204 3.1 and docs/facts/robot.md 2.3 alone.
"""

import os
import select
import sys

import i2c_usb
import max6615

SDA, SCL = 1, 2
ACKNOWLEDGE = 8  # the clock after the bits of a byte


class Slave:
    """What a chip does on the wires, a call per change; the result is whether it pulls SDA."""

    def __init__(self, chips):
        self.chips = chips
        self.chip = None
        self.levels = SDA | SCL
        self.pulls = False
        self.sda_low = self.scl_low = False  # defects: a wire held low
        self.starts = self.stops = self.rises = 0
        self.rest()

    def rest(self):
        """Waits for a START."""
        self.reads = self.addressed = self.begun = False
        self.bits, self.clock, self.byte = 0, 0, 0xFF
        self.pulls = False

    def changed(self, levels):
        """Takes the levels after a change; returns the wires that it pulls from now on."""
        before, self.levels = self.levels, levels
        if before & levels & SCL:
            if before & ~levels & SDA:
                self.starts += 1
                self.rest()
                self.begun = True
            elif levels & ~before & SDA:
                self.stops += 1
                self.rest()
        elif levels & ~before & SCL:
            self.rose(bool(levels & SDA))
        elif before & ~levels & SCL:
            self.fell()
        return self.held()

    def held(self):
        return (SDA if self.pulls or self.sda_low else 0) | (SCL if self.scl_low else 0)

    def rose(self, sda):
        self.rises += 1
        if not self.begun:
            return
        if self.clock < ACKNOWLEDGE:
            self.bits = self.bits << 1 | sda
        elif self.reads and self.addressed and sda:
            self.begun = False  # the master has enough
        self.clock += 1

    def fell(self):
        self.pulls = False
        if not self.begun:
            return
        if self.clock == ACKNOWLEDGE:
            # While reading the master acknowledges.
            self.pulls = not self.sends() and self.take(self.bits & 0xFF)
        elif self.clock > ACKNOWLEDGE:
            self.clock = self.bits = 0
            self.addressed = True
            if self.reads:
                self.byte = self.chip.read()
        if self.sends() and self.clock < ACKNOWLEDGE:
            self.pulls = not self.byte >> (7 - self.clock) & 1

    def sends(self):
        return self.reads and self.addressed

    def take(self, byte):
        """A byte of the master: returns True to acknowledge it."""
        if self.addressed:
            good = self.chip.write(byte)
        else:
            self.chip, self.reads = self.chips.get(byte >> 1), bool(byte & 1)
            good = self.chip is not None and self.chip.start(self.reads)
        if not good:
            self.begun = False
        return good


def main():
    commands, log = sys.argv[1:]
    fan_controller = max6615.Max6615()
    slave = Slave({0x18: fan_controller})
    wires = os.open("/dev/lab_wires", os.O_RDWR)
    # Opened for writing, too: it does not end with its first writer.
    lines = os.open(commands, os.O_RDWR | os.O_NONBLOCK)
    poll = select.poll()
    for file in (wires, lines):
        poll.register(file, select.POLLIN)
    rest = b""
    with open(log, "a", encoding="ascii") as done:
        print("ready", file=done, flush=True)
        while True:
            for file, _ in poll.poll():
                if file == wires:
                    for levels in os.read(wires, 64):
                        held = slave.changed(levels)
                    os.write(wires, bytes([held]))
                    continue
                *whole, rest = (rest + os.read(lines, 4096)).split(b"\n")
                for line in whole:
                    text = line.decode()
                    fan_controller.advance()
                    if text == "count":
                        text = f"count: {slave.starts} {slave.stops} {slave.rises}"
                    else:
                        i2c_usb.obey(slave, fan_controller, None, text.split())
                        os.write(wires, bytes([slave.held()]))
                    print(text, file=done, flush=True)


if __name__ == "__main__":
    main()
