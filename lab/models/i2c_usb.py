#!/usr/bin/env python3
"""i2c_usb.py COMMANDS LOG: an I2C adapter on USB (i2c-tiny-usb) with a MAX6615 at 0x18 and a 1-Wire bridge DS2482 at
0x1a.

Executes the commands read from the FIFO COMMANDS, one per line, and writes each to LOG when it is done:

  plug, unplug          the adapter
  sda low, sda free     a line held low by a defect: a reader receives zeros, and takes them for acknowledges
  scl low, scl free     the adapter waits for the clock, and its transfer does not return
  gone, back            the fan controller's supply off, on; it returns in its power-on state
  reset                 both at once
  stall N, turn N       fan 1 or 2 is held, released
  hot N CELSIUS         a channel's temperature
  battery CELSIUS       the thermometer's on 1-Wire; `battery off`, `battery on`: its plug
"""

import struct
import sys

import ds2482
import max6615
import usbip

# Requests of the adapter (i2c-tiny-usb.c of the kernel): a message of a transfer, with bits for the first and the last.
ECHO, FUNCTIONS, SET_DELAY, GET_STATUS, TRANSFER = 0, 1, 2, 3, 4
FIRST, LAST = 1, 2
READS = 1  # I2C_M_RD, in what the kernel hands over as the value
# I2C_FUNC_I2C, I2C_FUNC_SMBUS_EMUL: no block whose length is sent by the chip.
CAN = 0x0EFF0009
IDLE, ACKNOWLEDGED, REFUSED = 0, 1, 2


class Adapter(usbip.Device):
    speed = usbip.LOW_SPEED
    vendor, product, release = 0x0403, 0xC631, 0x0205
    strings = ("LAB", "i2c-tiny-usb", "L1")
    interface = (0, 0, 0)
    control_packet = 8

    def __init__(self, chips):
        super().__init__()
        self.chips = chips
        self.status = IDLE
        self.sda_low = self.scl_low = False

    def submitted(self, sequence, endpoint, setup, data, length):
        if self.scl_low and setup[0] & 0x60 and TRANSFER <= setup[1] <= TRANSFER | FIRST | LAST:
            # No answer, until the kernel cancels the request.
            self.asked[endpoint].append((sequence, length, data))
            return
        super().submitted(sequence, endpoint, setup, data, length)

    def control(self, kind, request, value, index, data, length):
        if request == ECHO:
            return struct.pack("<H", value)
        if request == FUNCTIONS:
            return struct.pack("<I", CAN)
        if request == SET_DELAY:
            return b""
        if request == GET_STATUS:
            return bytes([self.status])
        if TRANSFER <= request <= TRANSFER | FIRST | LAST:
            return self.message(index, value & READS, data, length)
        return None

    def message(self, address, reads, data, length):
        if self.sda_low:
            self.status = ACKNOWLEDGED
            return bytes(length)
        chip = self.chips.get(address)
        self.status = ACKNOWLEDGED if chip and chip.start(bool(reads)) else REFUSED
        if self.status == REFUSED:
            # Bits that no device pulls low are ones.
            return b"\xff" * length
        if reads:
            return bytes(chip.read() for _ in range(length))
        if not all(chip.write(byte) for byte in data):
            self.status = REFUSED
        return b""


def obey(adapter, fan_controller, thermometer, words):
    match words:
        case ["plug"]:
            adapter.attach()
        case ["unplug"]:
            adapter.detach()
        case ["sda", how]:
            adapter.sda_low = how == "low"
        case ["scl", how]:
            adapter.scl_low = how == "low"
        case ["gone"]:
            fan_controller.there = False
        case ["back"]:
            fan_controller.reset()
            fan_controller.there = True
        case ["reset"]:
            fan_controller.reset()
        case ["stall", fan]:
            fan_controller.fans[int(fan) - 1].stalled = True
        case ["turn", fan]:
            fan_controller.fans[int(fan) - 1].stalled = False
        case ["hot", channel, celsius]:
            fan_controller.temperature[int(channel) - 1] = float(celsius)
        case ["battery", "on" | "off" as plug]:
            thermometer.there = plug == "on"
        case ["battery", celsius]:
            thermometer.celsius = float(celsius)
        case _:
            raise ValueError(f"what is {' '.join(words)}?")


def main():
    commands, log = sys.argv[1:]
    fan_controller, thermometer = max6615.Max6615(), ds2482.Ds18b20(bytes.fromhex("28010000000000"))
    adapter = Adapter({0x18: fan_controller, 0x1A: ds2482.Ds2482([thermometer])})
    with open(log, "a", encoding="ascii") as done:
        while True:
            # Opened again for each writer.
            with open(commands, encoding="ascii") as lines:
                for line in lines:
                    with adapter.lock:
                        fan_controller.advance()
                        obey(adapter, fan_controller, thermometer, line.split())
                    print(line, end="", file=done, flush=True)


if __name__ == "__main__":
    main()
