#!/usr/bin/env python3
"""Reports a low battery voltage, long before the charge is near the reserve: a weak cell shows under load.

    battery_watch.py [--below VOLTS]

A module in Python: docs/writing-a-module.md. Its device is LL_DATA_POWER.
"""
import time

import advee
from advee import Kind, Severity
from lowlevel import data_power_t

MARGIN = 0.5    # V above the limit: clears the fault
SILENT = 3.0    # s; the power controller is polled each second
POWER_SILENT, BATTERY_SAGS = 0x8001, 0x8002


class BatteryWatch(advee.Module):
    def __init__(self, args):
        super().__init__(args)
        self.below, self.heard = args.below, time.monotonic()
        self.subscribe("LL_DATA_POWER", data_power_t, self.on_power)
        self.every(0.2, self.on_look)

    def on_power(self, power):
        self.heard = time.monotonic()
        self.clear(POWER_SILENT, "LL_DATA_POWER is heard again")
        self.working()
        if self.acts and power.voltage < self.below:
            self.fault(BATTERY_SAGS, Kind.RESOURCE, Severity.WARNING,
                       f"the battery has {power.voltage:.1f} V, less than {self.below:.1f} V")
        elif self.acts and power.voltage >= self.below + MARGIN:
            self.clear(BATTERY_SAGS, f"the battery has {power.voltage:.1f} V again")

    def on_look(self):
        if time.monotonic() - self.heard >= SILENT:
            self.fault(POWER_SILENT, Kind.TIMEOUT, Severity.ERROR, "no LL_DATA_POWER: is driver_power there?")
            self.failed()


if __name__ == "__main__":
    parser = advee.arguments("battery_watch", "Reports a battery that sags.")
    parser.add_argument("--below", type=float, default=25.0, metavar="VOLTS", help="report below this voltage (25)")
    advee.run(BatteryWatch, parser.parse_args())
