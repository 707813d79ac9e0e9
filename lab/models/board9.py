#!/usr/bin/env python3
"""board9.py PORT ADDRESS...: boards on EIA-485 at a terminal with nine bits by parity, each with its address.

They only answer requests for their firmware version, whose last byte is their address, and drop a frame with a gap, as
real boards do. Written from docs/facts/boards.md 1 alone, to detect faults that master and simulator might share.
"""

import fcntl
import os
import select
import sys
import termios
import time

CMSPAR = 0o10000000000
VERSION, UNKNOWN = 0xFE, 0x03
TURNAROUND = 0.0002
GAP = 0.005
TIOCSERGETLSR = 0x5459


def crc(data):
    rest = 0xFF
    for byte in data:
        rest ^= byte
        for _ in range(8):
            rest = rest << 1 ^ (0x1D if rest & 0x80 else 0)
            rest &= 0xFF
    return rest ^ 0xFF


def set_parity(port, mark):
    """Waits until everything is sent: the kernel's own wait for that takes up to 8 ms."""
    while not fcntl.ioctl(port, TIOCSERGETLSR, bytes(4))[0] & 1:
        time.sleep(0.0001)
    settings = termios.tcgetattr(port)
    settings[0] = termios.INPCK | termios.PARMRK
    settings[1] = settings[3] = 0
    settings[2] = termios.CS8 | termios.CREAD | termios.CLOCAL | termios.PARENB | CMSPAR
    settings[2] |= termios.PARODD if mark else 0
    settings[4] = settings[5] = termios.B115200
    termios.tcsetattr(port, termios.TCSANOW, settings)


def words(data, rest):
    """(ninth, byte) of each complete word read from a terminal; the remainder goes to `rest`."""
    data = bytes(rest) + data
    rest.clear()
    at = 0
    while at < len(data):
        if data[at] != 0xFF:
            yield 0, data[at]
            at += 1
        elif data[at + 1:at + 2] == b"\xff":
            yield 0, 0xFF
            at += 2
        elif len(data) - at > 2:
            yield 1, data[at + 2]
            at += 3
        else:
            rest.extend(data[at:])
            return


def main():
    path, *addresses = sys.argv[1:]
    addresses = [int(address, 0) for address in addresses]
    port = os.open(path, os.O_RDWR | os.O_NOCTTY)
    set_parity(port, mark=False)
    termios.tcflush(port, termios.TCIOFLUSH)
    frame, rest, last = [], bytearray(), 0
    print("ready", flush=True)
    while True:
        select.select([port], [], [])
        now = time.monotonic()
        if frame and now - last > GAP:
            print(f"dropped a frame with a gap of {(now - last) * 1e3:.1f} ms", flush=True)
            frame = []
        last = now
        for ninth, byte in words(os.read(port, 4096), rest):
            if ninth:
                frame = [byte] if byte in addresses else []
            elif frame:
                frame.append(byte)
            if len(frame) < 5 or len(frame) < 5 + frame[3]:
                continue
            address, instruction, good = frame[0], frame[1], crc(frame[:-1]) == frame[-1]
            frame = []
            if good:
                data = [1, 2, address] if instruction == VERSION else []
                answer = [address, instruction, 0 if data else UNKNOWN, len(data), *data]
                time.sleep(TURNAROUND)
                set_parity(port, mark=True)
                os.write(port, bytes(answer[:1]))
                set_parity(port, mark=False)
                os.write(port, bytes([*answer[1:], crc(answer)]))


main()
