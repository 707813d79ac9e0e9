"""A MAX6615 with two fans, byte by byte on its bus, by docs/facts/robot.md 2.3 alone: independent of
the driver and its own emulated chip, so that they verify each other."""

import time

RPM_AT_FULL_DUTY = 3000
RPM_TIMES_COUNT = 57600
STOPPED = 0xFF
FULL = 240
TICK = 1 / 16  # s: the finest rate of change
FULL_DRIVE = 32  # ticks of full drive: at a start from zero, and before a fan counts as failed
POWER_ON = {
    0x02: 0x18, 0x03: 0x6E, 0x04: 0x50, 0x06: 0x00, 0x07: 0x60, 0x08: 0x60, 0x09: 0xF0, 0x0A: 0xF0, 0x0B: 0x00, 0x0C: 0x00,
    0x0F: 0x00, 0x10: 0x00, 0x11: 0x00, 0x12: 0xB4, 0x13: 0x55, 0x14: 0x40, 0x17: 0x00, 0x1A: 0xFF, 0x1B: 0xFF, 0x1C: 0x00,
}
IDENTITY = {0xFD: 0x01, 0xFE: 0x68, 0xFF: 0x4D}
STANDBY, RESET, MINIMUM_DUTY, SPIN_UP_OFF = 0x80, 0x40, 0x04, 0x01


class Fan:
    def __init__(self):
        self.rpm = 0.0
        self.stalled = False
        self.supplied()

    def supplied(self):
        self.duty = 0  # in 240ths
        self.waited = 0  # ticks since its last step
        self.full = 0  # ticks of full drive that are left
        self.suspect = False  # at whose end it is measured once more
        self.failed = False
        self.count = STOPPED


class Max6615:
    def __init__(self):
        self.temperature = [25.0, 25.0]
        self.fans = [Fan(), Fan()]
        self.there = True
        self.time = time.monotonic()
        self.ticks = 0
        self.reset()

    def reset(self):
        """Loss of supply and its return."""
        self.registers = dict(POWER_ON)
        self.over = 0
        self.pointer = 0
        self.pointed = False
        for fan in self.fans:
            fan.supplied()

    # -- on the bus -------------------------------------------------------------------------------------------------

    def start(self, reading):
        """Called with its address: returns True if it acknowledges."""
        self.advance()
        self.pointed = reading
        return self.there

    def write(self, byte):
        if not self.pointed:
            self.pointer, self.pointed = byte, True
        elif self.pointer in POWER_ON:
            self.set(self.pointer, byte)
        return True

    def read(self):
        return self.get(self.pointer)

    def set(self, register, value):
        if register == 0x1C:
            value &= 0x3F  # the failures are the chip's to say
        self.registers[register] = value & {0x06: 0xC0, 0x11: 0xFC, 0x12: 0xFC, 0x14: 0xE0}.get(register, 0xFF)
        if register == 0x02 and value & RESET:
            self.reset()

    def get(self, register):
        if register in (0x00, 0x01):
            return min(self.eighths(register) >> 3, 255)
        if register in (0x1E, 0x1F):
            return (self.eighths(register - 0x1E) & 7) << 5
        if register == 0x05:
            # The flag stays until it is read and the channel is no longer above its limit.
            said, self.over = self.over, 0
            self.watch()
            return said
        if register in (0x0D, 0x0E):
            return self.fans[register - 0x0D].duty & ~1
        if register in (0x18, 0x19):
            return self.fans[register - 0x18].count
        if register == 0x1C:
            return self.registers[0x1C] | self.fans[0].failed << 7 | self.fans[1].failed << 6
        return self.registers.get(register, IDENTITY.get(register, 0))

    # -- behaviour --------------------------------------------------------------------------------------------------

    def eighths(self, channel):
        return max(0, int(self.temperature[channel] * 8))

    def watch(self):
        for channel in (0, 1):
            if self.temperature[channel] > self.registers[0x03 + channel]:
                self.over |= 0x80 >> channel

    def advance(self):
        """Simulates up to the present, at most a minute."""
        now = time.monotonic()
        self.time = max(self.time, now - 60)
        while self.time + TICK <= now:
            self.time += TICK
            self.tick()

    def tick(self):
        self.ticks += 1
        self.watch()
        helps = not self.registers[0x1C] & 0x01 and any(fan.failed for fan in self.fans)
        for number, fan in enumerate(self.fans):
            self.drive(fan, FULL if helps else self.wanted(number), number)
            speed = 0 if fan.stalled else RPM_AT_FULL_DUTY * fan.duty / FULL
            fan.rpm = 0 if fan.stalled else fan.rpm + (speed - fan.rpm) / 8
            if self.ticks % 16 == 0:
                self.measure(fan, number)

    def wanted(self, number):
        if self.registers[0x02] & STANDBY:
            return 0
        follows = self.registers[0x11] >> (4, 2)[number] & 3
        if not follows:
            return min(self.registers[0x0B + number], FULL)
        return max(self.automatic(number, channel) for channel in (0, 1) if follows & 2 >> channel)

    def automatic(self, number, channel):
        start, least = self.registers[0x0F + channel], self.registers[0x07 + number]
        above = int(self.temperature[channel]) - start
        if above < 0:
            return least if self.registers[0x02] & MINIMUM_DUTY else 0
        each = self.registers[0x13] >> (4, 0)[number] & 15
        steps = above // (2 if self.registers[0x11] & 0x40 else 1)
        return min(least + each * steps, self.registers[0x09 + number], FULL)

    def drive(self, fan, wanted, number):
        if fan.full:
            fan.duty = FULL
            fan.full -= 1
            return
        if not fan.duty and wanted and not self.registers[0x02] & SPIN_UP_OFF:
            fan.full = FULL_DRIVE
            return
        code = self.registers[0x12] >> (5, 2)[number] & 7
        fan.waited += 1
        if not code:
            fan.duty = wanted
        elif fan.waited >= 1 << (code - 1):
            fan.waited = 0
            fan.duty = max(fan.duty - 2, wanted) if fan.duty > wanted else min(fan.duty + 2, wanted)

    def measure(self, fan, number):
        fan.count = max(1, min(STOPPED, int(RPM_TIMES_COUNT / fan.rpm))) if fan.rpm > 0 else STOPPED
        if self.registers[0x1C] & 0x20 >> number:
            fan.failed = False
        elif fan.count <= self.registers[0x1A + number] or not fan.duty:
            fan.failed = fan.suspect = False
        elif not fan.suspect:
            fan.full, fan.suspect = FULL_DRIVE, True
        elif not fan.full:
            fan.failed = True
