"""Foreign readers of lidars: peer.py KIND PORT SECONDS. The emulated device is at the TCP port; a terminal between.

Reads for so many seconds, and some scans at least; then no scan may be missing among them.
"""

import math
import os
import socket
import sys
import threading
import time
import tty

# Directions in degrees clockwise from the front, and ranges in mm: a wall at 2 m, 4 m on the right, 1 m behind.
WALLS = [(0.0, 2000), (90.0, 4000), (180.0, 1000)]


def terminal(port):
    """Path of a pseudo-terminal whose bytes another process exchanges with the port: SDKs keep the interpreter busy."""
    line = socket.create_connection(("127.0.0.1", port))
    master, slave = os.openpty()
    tty.setraw(slave)
    if os.fork() > 0:
        line.close()
        os.close(master)
        return os.ttyname(slave)
    os.close(slave)

    def forward(read, write):
        try:
            while data := read():
                write(data)
        finally:
            os._exit(0)

    threading.Thread(target=forward, args=(lambda: line.recv(4096), lambda data: os.write(master, data))).start()
    forward(lambda: os.read(master, 4096), line.sendall)


def check(points, tolerance_mm):
    """Points: degrees clockwise, mm."""
    for direction, expected in WALLS:
        near = [mm for degrees, mm in points if abs((degrees - direction + 180) % 360 - 180) < 5 and mm > 0]
        assert near, f"nothing at {direction} degrees among {len(points)} points"
        worst = max(abs(mm - expected) for mm in near)
        assert worst <= tolerance_mm, f"{worst} mm off at {direction} degrees"


class Scans:
    """Counts scans of a device that turns so many times a second, and those that are missing among them."""

    LEAST = 3

    def __init__(self, turns=10):
        self.period = 1 / turns
        self.times, self.points = [], []
        # Scans for which the reader itself was away too long, of those that keep the newest one only.
        self.skipped = 0

    def begin(self):
        """The reader asks for the next scan now."""
        if self.times:
            self.skipped += int((time.monotonic() - self.times[-1]) / self.period)

    def wanted(self):
        return len(self.times) < self.LEAST or self.times[-1] - self.times[0] < SECONDS

    def add(self, points, tolerance_mm):
        self.times.append(time.monotonic())
        self.points.append(len(points))
        check(points, tolerance_mm)

    def finish(self):
        # A scan that arrives late says nothing; all scans after a missing one are a period late.
        late = [time - n * self.period for n, time in enumerate(self.times)]
        missing = round((min(late[-20:]) - min(late[:20])) / self.period)
        took = self.times[-1] - self.times[0]
        print(
            f"{len(self.times)} scans in {took:.1f} s, {missing} missing, {self.skipped} of them not asked for in time,"
            f" {min(self.points)} to {max(self.points)} points"
        )
        assert len(late) < 40 or missing <= self.skipped


def lds2d(model, port):
    from lds2d import Lidar
    lidar = Lidar.open(model, terminal(port))
    if model != "LD14P":
        lidar.start()
    scans, read = lidar.scans(), Scans(7 if model == "YDLIDAR-X4" else 10)
    # The first one is cut.
    next(scans)
    while read.wanted():
        read.add([(point.angle_deg, point.dist_mm) for point in next(scans).points], 2)
    read.finish()


def slamtec(baud, port):
    import pyrplidarsdk
    driver = pyrplidarsdk.RplidarDriver(port=terminal(port), baudrate=baud)
    assert driver.connect()
    info, health = driver.get_device_info(), driver.get_health()
    print(info.model, info.firmware_version, info.hardware_version, info.serial_number, health.status)
    assert health.status == 0
    assert driver.start_scan()
    read, empty = Scans(), 0
    while read.wanted():
        read.begin()
        data = driver.get_scan_data()
        if data and len(data[0]) > 100:
            read.add([(math.degrees(angle) % 360, meters * 1000) for angle, meters in zip(data[0], data[1])], 20)
            empty = 0
        else:
            empty += 1
            assert empty < 60
    read.finish()
    driver.stop_scan()
    driver.disconnect()


def hokuyo(port):
    from hokuyolx import HokuyoLX
    sensor = HokuyoLX(addr=("127.0.0.1", port), tsync=False, convert_time=False)
    print(sensor.model, sensor.dmin, sensor.dmax, sensor.ares, sensor.amin, sensor.amax, sensor.aforw)
    assert (sensor.dmin, sensor.dmax, sensor.ares, sensor.amax) == (23, 60000, 1440, 1080)
    angles = sensor.get_angles()
    read = Scans()
    while read.wanted():
        # One scan at a time: hokuyolx takes what arrives at once as one answer, and so depends on the machine's speed.
        _, scan = sensor.get_dist()
        assert len(scan) == 1081
        points = [(-math.degrees(angle) % 360, float(mm)) for angle, mm in zip(angles, scan)]
        # Its view ends 45 degrees before the back.
        read.add(points + [(180.0, 1000)], 2)
    sensor.close()


def pylidar3(model, port):
    import serial
    # A pseudo-terminal has no DTR.
    serial.Serial.setDTR = lambda *_: None
    import PyLidar3
    lidar = {"6": PyLidar3.YdLidarX4, "5": PyLidar3.YdLidarG4}[model](terminal(port))
    # It asks for the health.
    assert lidar.Connect()
    info = lidar.GetDeviceInfo()
    print(info)
    assert (info["model_number"], info["firmware_version"]) == (model, "1.10")
    # Of each direction of a degree the mean of what was measured in the 6000 bytes that it reads at a time.
    read, least = 0, 360
    begin = time.monotonic()
    for scan in lidar.StartScanning():
        points = [(degrees + 0.5, mm) for degrees, mm in scan.items() if mm > 0]
        check(points, 5)
        read, least = read + 1, min(least, len(points))
        if read >= 3 and time.monotonic() - begin > SECONDS:
            break
    print(f"{read} times 6000 bytes in {time.monotonic() - begin:.1f} s, {least} directions at least")
    assert least > 330
    lidar.StopScanning()


kind, port, SECONDS = sys.argv[1], int(sys.argv[2]), float(sys.argv[3])
if kind.startswith("lds2d:"):
    lds2d(kind.removeprefix("lds2d:"), port)
elif kind.startswith("slamtec:"):
    slamtec(int(kind.removeprefix("slamtec:")), port)
elif kind.startswith("pylidar3:"):
    pylidar3(kind.removeprefix("pylidar3:"), port)
else:
    hokuyo(port)
print("done")
