#!/usr/bin/env python3
"""A device of CiA 401 on a CAN bus, with eight digital inputs and outputs: to try `[io.canopen]` without one.

    pip install canopen python-can msgpack
    python3 examples/canopen_io.py udp:239.74.163.2:43113 20

The bus is `udp:GROUP:PORT`, or a network interface for SocketCAN: `vcan0`; 20 is its node. The tables of a robot that
uses it are in canopen_io.toml. Inputs (0x6000:1) are in TPDO 1, which is sent at each change; outputs (0x6200:1) are
written by SDO, and get their error values (0x6206, 0x6207) when the master's heartbeat is missing (0x1016).

Prints a line for each event: monotonic time in s, node, event. The line `input CHANNEL 0` on standard input opens an
input, counted from 0, `input CHANNEL 1` closes it; all are open at the start.
"""
import signal
import sys
import threading
import time

try:
    import canopen
    from canopen.objectdictionary import ODArray, ODRecord, ODVariable, UNSIGNED8, UNSIGNED16, UNSIGNED32
except ModuleNotFoundError as error:
    sys.exit(f"{error}: pip install canopen python-can msgpack; or .venv/bin/python, which make test fills")

from canopen_drives import connect  # the bus, in the file beside this one

CYCLE = 0.005
INPUTS, OUTPUTS, ERROR_MODE, ERROR_VALUE = 0x6000, 0x6200, 0x6206, 0x6207
MASTERS, TPDO, MAPPING = 0x1016, 0x1800, 0x1A00


def dictionary(node):
    od = canopen.ObjectDictionary()

    def variable(index, sub, name, data_type, default, access):
        new = ODVariable(name, index, sub)
        new.data_type, new.default, new.access_type = data_type, default, access
        new.pdo_mappable = index >= INPUTS
        return new

    def group(kind, index, name, *members):
        new = kind(name, index)
        new.add_member(variable(index, 0, f"{name}: highest sub-index", UNSIGNED8, members[-1][0], "ro"))
        for sub, data_type, default, access in members:
            new.add_member(variable(index, sub, f"{name} {sub}", data_type, default, access))
        od.add_object(new)

    # CiA 401: digital inputs and outputs.
    od.add_object(variable(0x1000, 0, "Device type", UNSIGNED32, 0x00030191, "ro"))
    od.add_object(variable(0x1001, 0, "Error register", UNSIGNED8, 0, "ro"))
    od.add_object(variable(0x1017, 0, "Producer heartbeat time", UNSIGNED16, 0, "rw"))
    group(ODArray, MASTERS, "Consumer heartbeat time", (1, UNSIGNED32, 0, "rw"))
    group(ODRecord, 0x1018, "Identity", *((sub, UNSIGNED32, 0, "ro") for sub in range(1, 5)))
    group(ODRecord, TPDO, "TPDO 1", (1, UNSIGNED32, 0x4000_0180 + node, "rw"), (2, UNSIGNED8, 255, "rw"))
    group(ODRecord, MAPPING, "TPDO 1 mapping", (1, UNSIGNED32, INPUTS << 16 | 0x0108, "rw"))
    group(ODArray, INPUTS, "Digital inputs", (1, UNSIGNED8, 0, "ro"))
    group(ODArray, OUTPUTS, "Digital outputs", (1, UNSIGNED8, 0, "rw"))
    group(ODArray, ERROR_MODE, "Error mode of the outputs", (1, UNSIGNED8, 0xFF, "rw"))
    group(ODArray, ERROR_VALUE, "Error values of the outputs", (1, UNSIGNED8, 0, "rw"))
    return od


class Device:
    def __init__(self, network, number):
        self.network, self.number, self.lock = network, number, threading.RLock()
        self.node = canopen.LocalNode(number, dictionary(number))
        self.inputs = self.outputs = 0
        self.begin()
        self.node.add_write_callback(self.on_write)
        # A master may be waiting: from here on its frames arrive.
        with self.lock:
            network.add_node(self.node)
            # After the node's own handler, which changes the state.
            network.subscribe(0, self.on_nmt)
            self.boot()

    def begin(self):
        """Objects after power-on, or a reset. The inputs are what is wired to them."""
        self.node.data_store.clear()
        self.masters, self.received = {}, {}
        self.put(INPUTS, self.inputs)
        self.set_outputs(0)

    def boot(self):
        self.node.nmt.stop_heartbeat()
        self.node.nmt.state = "INITIALISING"
        self.node.nmt.state = "PRE-OPERATIONAL"

    def say(self, *words):
        sys.stdout.write(" ".join(map(str, (f"{time.monotonic():.4f}", self.number, *words))) + "\n")
        sys.stdout.flush()

    def get(self, index):
        return self.node.get_data(index, 1)[0]

    def put(self, index, value):
        """Writes an object as the device itself does, whatever its access."""
        self.node.data_store.setdefault(index, {})[1] = bytes([value])

    def set_outputs(self, value):
        self.put(OUTPUTS, value)
        if value != self.outputs:
            self.outputs = value
            self.say("outputs", value)

    def set_input(self, channel, value):
        with self.lock:
            self.inputs = self.inputs & ~(1 << channel) | value << channel
            self.put(INPUTS, self.inputs)
            self.say("inputs", self.inputs)
            self.send()

    def send(self):
        """TPDO 1, which a device sends in the state Operational alone."""
        if self.node.nmt.state == "OPERATIONAL":
            pdo = self.node.tpdo[1]
            for mapped in pdo.map:
                mapped.raw = self.inputs
            pdo.transmit()

    def on_write(self, index, subindex, od, data):
        match index, subindex:
            case (0x6200, 1):
                self.set_outputs(data[0])
            case (0x1016, 1):
                entry = od.decode_raw(data)
                master, limit = entry >> 16 & 0x7F, (entry & 0xFFFF) / 1000
                self.masters = {master: limit} if master and limit else {}
                self.received.clear()
                self.network.subscribe(0x700 + master, self.on_heartbeat)

    def on_heartbeat(self, can_id, _, __):
        with self.lock:
            self.received[can_id - 0x700] = time.monotonic()

    def on_nmt(self, _, data, __):
        command, node = data[0], data[1]
        if node not in (0, self.number):
            return
        with self.lock:
            if command in (0x81, 0x82):
                self.begin()
                self.boot()
            elif command == 1:
                self.node.tpdo[1].read()
                self.send()
            self.say("nmt", self.node.nmt.state.lower())

    def cycle(self):
        with self.lock:
            for master, limit in self.masters.items():
                at = self.received.get(master)
                if at is not None and time.monotonic() - at > limit:
                    del self.received[master]
                    self.say("master lost")
                    by_error = self.get(ERROR_MODE)
                    self.set_outputs(self.outputs & ~by_error | self.get(ERROR_VALUE) & by_error)


def main(bus, number):
    network, over = connect(bus), threading.Event()
    device = Device(network, number)

    def run():
        while not over.wait(CYCLE):
            device.cycle()

    cycles = threading.Thread(target=run, daemon=True)
    cycles.start()
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))
    device.say("ready")
    try:
        for line in sys.stdin:
            match line.split():
                case ["input", channel, ("0" | "1") as value] if channel in "01234567":
                    device.set_input(int(channel), int(value))
        signal.pause()
    except KeyboardInterrupt:
        pass
    finally:
        over.set()
        cycles.join()
        network.disconnect()


if __name__ == "__main__":
    if len(sys.argv) != 3 or not sys.argv[2].isdecimal():
        sys.exit(__doc__)
    main(sys.argv[1], int(sys.argv[2]))
