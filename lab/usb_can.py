#!/usr/bin/env python3
"""usb_can.py COMMANDS LOG: a USB2CAN adapter (usb_8dev) for the running kernel, by USB/IP; its bus is in here.

It obeys the lines of the FIFO COMMANDS: `off`, `passive`, `active` are what its controller tells of itself, `ack` that
nobody acknowledges. What the driver asks of it is written to LOG: `open`, `close`, and each frame. What is sent on the
bus nobody answers; processes on the same machine hear each other by the kernel's echo.
"""

import socket
import struct
import subprocess
import sys
import threading

ATTACH = "/sys/devices/platform/vhci_hcd.0/attach"
FULL_SPEED = 2
DEVICE = struct.pack("<BBHBBBBHHHBBBB", 18, 1, 0x200, 255, 0, 0, 64, 0x0483, 0x1234, 0x101, 1, 2, 3, 1)
ENDPOINTS = b"".join(struct.pack("<BBBBHB", 7, 5, address, 2, 64, 0) for address in (0x81, 0x02, 0x83, 0x04))
INTERFACE = struct.pack("<BBBBBBBBB", 9, 4, 0, 0, 4, 255, 0, 0, 0)
CONFIGURATION = struct.pack("<BBHBBBBB", 9, 2, 18 + len(ENDPOINTS), 1, 1, 0, 0x80, 50) + INTERFACE + ENDPOINTS
STRINGS = ["", "LAB", "USB2CAN converter", "L1"]
# Endpoints: frames to the host, frames from it, answers to commands, commands.
FRAMES_IN, FRAMES_OUT, ANSWERS, COMMANDS = 1, 2, 3, 4
OPEN, CLOSE = 2, 3
# What a status message says: kind, receive and transmit errors.
STATUS = {"active": (0x00, 0, 0), "off": (0x04, 0, 255), "passive": (0x03, 0, 130), "ack": (0x23, 0, 128)}


class Adapter:
    def __init__(self, log):
        self.log = log
        self.kernel, self.ours = socket.socketpair()
        self.lock = threading.Lock()
        self.asked = {FRAMES_IN: [], ANSWERS: []}
        self.ready = {FRAMES_IN: [], ANSWERS: []}

    def attach(self):
        with open(ATTACH, "w") as attach:
            attach.write(f"0 {self.kernel.fileno()} {0x10001} {FULL_SPEED}\n")

    def note(self, line):
        self.log.write(line + "\n")
        self.log.flush()

    def read(self, length):
        data = b""
        while len(data) < length:
            more = self.ours.recv(length - len(data))
            if not more:
                sys.exit(0)
            data += more
        return data

    def answer(self, sequence, inwards, endpoint, status, data, length):
        header = struct.pack(">IIIII", 3, sequence, 0, inwards, endpoint)
        self.ours.sendall(header + struct.pack(">iIIII", status, length, 0, 0, 0) + bytes(8) + data)

    def serve(self):
        while True:
            header = self.read(48)
            command, sequence, _, inwards, endpoint = struct.unpack(">IIIII", header[:20])
            with self.lock:
                if command == 1:
                    length = struct.unpack(">I", header[24:28])[0]
                    data = self.read(length) if not inwards else b""
                    self.submitted(sequence, inwards, endpoint, header[40:48], data, length)
                elif command == 2:
                    self.unlinked(sequence, struct.unpack(">I", header[20:24])[0])

    def submitted(self, sequence, inwards, endpoint, setup, data, length):
        if endpoint == 0:
            said = self.control(setup)
            said = None if said is None else said[:length]
            self.answer(sequence, inwards, 0, -32 if said is None else 0, said or b"", len(said or b""))
        elif inwards:
            self.asked[endpoint].append(sequence)
            self.pump(endpoint)
        else:
            self.answer(sequence, 0, endpoint, 0, b"", length)
            self.take(endpoint, data)

    def unlinked(self, sequence, victim):
        was = any(victim in asked for asked in self.asked.values())
        for asked in self.asked.values():
            asked[:] = [one for one in asked if one != victim]
        self.ours.sendall(struct.pack(">IIIIIi", 4, sequence, 0, 0, 0, -104 if was else 0) + bytes(24))

    @staticmethod
    def control(setup):
        kind, request, value, _, _ = struct.unpack("<BBHHH", setup)
        if (kind, request) == (0x80, 6):
            number = value & 0xFF
            if value >> 8 == 3 and number < len(STRINGS):
                text = STRINGS[number].encode("utf-16le") if number else struct.pack("<H", 0x409)
                return bytes([len(text) + 2, 3]) + text
            return {1: DEVICE, 2: CONFIGURATION}.get(value >> 8)
        return b"\0\0" if request == 0 else b""

    def take(self, endpoint, data):
        if endpoint == COMMANDS:
            command = data[2]
            self.note({OPEN: "open", CLOSE: "close"}.get(command, f"command {command}"))
            version = struct.pack(">I", 0x0101_0101) + bytes(6)
            self.put(ANSWERS, struct.pack(">BBBBB10sB", 0x11, 0, command, 0, 0, version, 0x22))
            if command == OPEN:
                self.tell("active")
        elif endpoint == FRAMES_OUT:
            for at in range(0, len(data) - 15, 16):
                _, _, number, length, frame, _ = struct.unpack(">BBIB8sB", data[at : at + 16])
                self.note(f"{number:03X}#{frame[:length].hex()}")

    def tell(self, what):
        state, receive, transmit = STATUS[what]
        data = bytes([state, receive, transmit, 0, 0, 0, 0, 0])
        self.put(FRAMES_IN, struct.pack(">BBBIB8sIB", 0x55, 3, 4, 0, 8, data, 0, 0xAA))

    def put(self, endpoint, data):
        self.ready[endpoint].append(data)
        self.pump(endpoint)

    def pump(self, endpoint):
        while self.asked[endpoint] and self.ready[endpoint]:
            data = self.ready[endpoint].pop(0)
            self.answer(self.asked[endpoint].pop(0), 1, endpoint, 0, data, len(data))


def main():
    commands, log = sys.argv[1:]
    for module in ("vhci_hcd", "usb_8dev", "can-raw"):
        subprocess.run(["modprobe", module], check=True)
    with open(log, "w") as out:
        adapter = Adapter(out)
        threading.Thread(target=adapter.serve, daemon=True).start()
        adapter.attach()
        while True:
            # Opened anew for each writer.
            with open(commands) as lines:
                for line in lines:
                    with adapter.lock:
                        adapter.tell(line.strip())


main()
