#!/usr/bin/env python3
"""Shows the CANopen traffic of the simulated robot by python-can: `listen.py [PORT] [SECONDS]`.

    pip install python-can msgpack

Prints one line per kind of frame: its count, and the last data.
"""
import sys
import time

try:
    import can
except ModuleNotFoundError as error:
    sys.exit(f"{error}: pip install python-can msgpack; or .venv/bin/python, which make test fills")

port = int(sys.argv[1]) if len(sys.argv) > 1 else 43113
seconds = float(sys.argv[2]) if len(sys.argv) > 2 else 2.0
KINDS = {0x000: "NMT", 0x080: "SYNC/EMCY", 0x180: "TPDO1", 0x200: "RPDO1", 0x280: "TPDO2", 0x300: "RPDO2", 0x380: "TPDO3",
         0x400: "RPDO3", 0x480: "TPDO4", 0x500: "RPDO4", 0x580: "SDO answer", 0x600: "SDO request", 0x700: "heartbeat"}

seen = {}
with can.Bus(interface="udp_multicast", channel="239.74.163.2", port=port, hop_limit=0, fd=False) as bus:
    end = time.monotonic() + seconds
    while (left := end - time.monotonic()) > 0:
        frame = bus.recv(left)
        if frame is not None:
            count, _ = seen.get(frame.arbitration_id, (0, b""))
            seen[frame.arbitration_id] = (count + 1, bytes(frame.data))
for identifier, (count, data) in sorted(seen.items()):
    kind, node = KINDS.get(identifier & 0x780, "?"), identifier & 0x7F
    print(f"{identifier:03X}  {kind:11} node {node:3}  {count:5} x  last {data.hex(' ')}")
sys.exit(0 if seen else 1)
