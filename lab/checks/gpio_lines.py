#!/usr/bin/env python3
"""Two lines of a GPIO chip as an I2C bus, on the kernel's gpio-sim: how our adapter requests, pulls and releases the
lines, and its errors when they are busy and when the chip disappears. No chip answers there: gpio-sim has no wires.
Then a line that feeds the motors: requested as it is found, and never switched on by a start."""

import fcntl
import os
import signal
import struct
import subprocess
import sys
import time

CONFIG = "/sys/kernel/config/gpio-sim/lab"
LINE_INFO = 0xC100B405  # GPIO_V2_GET_LINEINFO_IOCTL
USED, OUTPUT, OPEN_DRAIN, ACTIVE_LOW = 1 << 0, 1 << 3, 1 << 6, 1 << 1
SDA, SCL, TAKEN, FEED = 2, 3, 5, 6
ADVEE = os.environ["ADVEE"]
LOG = os.path.join(os.environ["HOME"], "said")


def write(path, text):
    with open(path, "w", encoding="ascii") as f:
        f.write(text)


def read(path):
    with open(path, encoding="utf-8") as f:
        return f.read().strip()


def plug(live):
    """Creates the chip, or removes it even while its lines are held."""
    write(f"{CONFIG}/live", str(int(live)))
    return f"/dev/{read(f'{CONFIG}/bank/chip_name')}" if live else None


def level(line):
    """The level of a line at the chip."""
    device, chip = read(f"{CONFIG}/dev_name"), read(f"{CONFIG}/bank/chip_name")
    return read(f"/sys/devices/platform/{device}/{chip}/sim_gpio{line}/value")


def info(chip, line):
    """Name, consumer and flags of a line, from the kernel."""
    told = bytearray(256)
    struct.pack_into("=I", told, 64, line)
    with open(chip, "rb") as f:
        fcntl.ioctl(f, LINE_INFO, told)
    (flags,) = struct.unpack_from("=Q", told, 72)
    return told[:32].rstrip(b"\0").decode(), told[32:64].rstrip(b"\0").decode(), flags


def until(holds, what, seconds=30):
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        if holds():
            print(f"{what}: yes")
            return
        time.sleep(0.02)
    sys.exit(f"FAILED: {what}: never; it said:\n{read(LOG)}")


def same(what, is_, should):
    print(f"{what}: {is_}")
    if is_ != should:
        sys.exit(f"FAILED: {what}: {is_!r}, not {should!r}")


def refused(place, why):
    """Checks that the tool reports an unavailable line in one line."""
    done = subprocess.run([ADVEE, "i2c", "scan", "--port", place], text=True, capture_output=True, check=False)
    print(done.stderr.strip())
    if done.returncode == 0 or why not in done.stderr or len(done.stderr.splitlines()) != 1:
        sys.exit(f"FAILED: {place} is to be refused with {why!r}: {done.returncode} {done.stdout}")


def stop_driver(chip, line):
    """Starts the driver whose second way to stop is a line, and waits until it holds the line as an output."""
    with open(LOG, "w", encoding="utf-8") as log:
        settings = ["stop.second_way=gpio", f"stop.gpio.chip={chip}", f"stop.gpio.line={line}"]
        command = [ADVEE, "run", "driver_canbus", *(word for one in settings for word in ("--set", one))]
        driver = subprocess.Popen(command, stdout=log, stderr=subprocess.STDOUT)
    held = USED | OUTPUT
    until(lambda: info(chip, FEED)[2] & held == held, f"the driver has line {line} as an output")
    same("its consumer", info(chip, FEED)[1], "advee stop")
    return driver


def end(driver):
    driver.send_signal(signal.SIGTERM)
    same("exit status", driver.wait(10), 0)


def pull(chip, up):
    """The resistor at the line that feeds the motors."""
    name = os.path.basename(chip)
    write(f"/sys/devices/platform/{read(f'{CONFIG}/dev_name')}/{name}/sim_gpio{FEED}/pull", f"pull-{up}")


def feed(chip):
    """A line that is no output is cut; one that is an output keeps its level, which gpio-sim takes from the pull."""
    pull(chip, "up")
    driver = stop_driver(chip, FEED)
    same("a line that nobody drove is cut, whatever its level was", level(FEED), "0")
    end(driver)
    driver = stop_driver(chip, "MOTOR_FEED")
    same("an output that was on stays on", level(FEED), "1")
    end(driver)
    pull(chip, "down")
    driver = stop_driver(chip, FEED)
    same("an output that was cut stays cut", level(FEED), "0")
    end(driver)


def main():
    os.chdir(os.environ["LAB_SOURCE"])
    if not os.path.ismount("/sys/kernel/config"):
        subprocess.run(["mount", "-t", "configfs", "none", "/sys/kernel/config"], check=True)
    os.makedirs(f"{CONFIG}/bank/line{TAKEN}/hog")
    write(f"{CONFIG}/bank/num_lines", "8")
    write(f"{CONFIG}/bank/line{TAKEN}/hog/name", "lamp")
    write(f"{CONFIG}/bank/line{TAKEN}/hog/direction", "output-low")
    for line, name in ((SDA, "FAN_SDA"), (SCL, "FAN_SCL"), (FEED, "MOTOR_FEED")):
        os.makedirs(f"{CONFIG}/bank/line{line}")
        write(f"{CONFIG}/bank/line{line}/name", name)
    chip = plug(True)
    bus = f"gpio:{chip}:{SDA}:{SCL}"

    # Unavailable lines.
    refused(f"gpio:{chip}:{TAKEN}:{SCL}", f"{chip}: lines {TAKEN} and {SCL}: Device or resource busy")
    refused(f"gpio:{chip}:{SDA}:99", "Invalid argument")
    refused(f"gpio:{chip}:{SDA}:{SDA}", "expected /dev/i2c-1")
    refused(f"gpio:/dev/zero:{SDA}:{SCL}", f"/dev/zero: lines {SDA} and {SCL}: ")
    refused(f"gpio:/dev/gpiochip99:{SDA}:{SCL}", "/dev/gpiochip99: No such file or directory")
    for line in (SDA, SCL):
        same(f"line {line} is free after what was refused", info(chip, line)[2] & USED, 0)

    feed(chip)

    # The driver holds the lines.
    with open(LOG, "w", encoding="utf-8") as log:
        settings = [f"i2c.aux.bus='{bus}'", "i2c.aux.hz=1000"]
        command = [ADVEE, "run", "driver_aux", *(word for one in settings for word in ("--set", one))]
        driver = subprocess.Popen(command, stdout=log, stderr=subprocess.STDOUT)
    until(lambda: info(chip, SDA)[2] & USED, "the driver has the lines")
    for line, name in ((SDA, "FAN_SDA"), (SCL, "FAN_SCL")):
        told, consumer, flags = info(chip, line)
        same(f"name of line {line}", told, name)
        same("its consumer", consumer, "advee i2c")
        # The kernel reports a released open-drain line as requested: an output.
        same("an open-drain output, not inverted", flags & (OUTPUT | OPEN_DRAIN | ACTIVE_LOW), OUTPUT | OPEN_DRAIN)
    refused(bus, "is held by driver_aux")
    for line in (SDA, SCL):
        until(lambda line=line: level(line) == "0", f"line {line} is pulled")

    # The chip disappears while they are held.
    plug(False)
    until(lambda: "i2c.aux is down: " in read(LOG), "the driver says that its bus is gone")
    driver.send_signal(signal.SIGTERM)
    same("exit status", driver.wait(10), 0)
    print(read(LOG))


main()
