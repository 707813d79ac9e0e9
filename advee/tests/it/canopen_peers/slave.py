"""Slave on `canopen` (PyPI): `slave.py PORT`, with the objects of node.eds. Reads commands line by line, prints events.
"""
import json
import pathlib
import sys

import canopen

HERE = pathlib.Path(__file__).parent
NODE = 5


class Slave:
    def __init__(self, port):
        self.network = canopen.Network()
        self.network.NOTIFIER_CYCLE = 0.1
        self.network.connect(
            interface="udp_multicast", channel="239.74.163.2", port=port, hop_limit=0, fd=False
        )
        self.node = self.network.create_node(NODE, str(HERE / "node.eds"))
        self.node.sdo[0x2000].raw = b""
        self.written = []
        self.node.add_write_callback(self.on_write)
        # After the node's own handler, which changes the state but neither resets objects nor boots.
        self.network.subscribe(0, self.on_nmt)

    def on_write(self, index, subindex, od, data):
        self.written.append([index, subindex, data.hex()])

    def on_nmt(self, _, data, __):
        command, node = data[0], data[1]
        if node not in (0, NODE):
            return
        print("nmt", command, flush=True)
        if command in (0x81, 0x82):
            first = 0x1000 if command == 0x82 else 0
            last = 0x1FFF if command == 0x82 else 0xFFFF
            for index in [index for index in self.node.data_store if first <= index <= last]:
                del self.node.data_store[index]
            self.boot()

    def boot(self):
        self.node.nmt.stop_heartbeat()
        self.node.nmt.state = "INITIALISING"
        self.node.nmt.state = "PRE-OPERATIONAL"

    def on_pdo(self, pdo):
        print("pdo", *(variable.raw for variable in pdo.map), flush=True)

    def obey(self, order, *numbers):
        match order:
            case "boot":
                self.boot()
            case "silent":
                self.node.nmt.stop_heartbeat()
            case "heartbeat":
                self.node.nmt.start_heartbeat(*numbers)
            case "emergencies":
                for n in range(*numbers):
                    self.node.emcy.send(0x8100 | n & 0xFF, 0x11, n.to_bytes(5, "little"))
            case "identity":
                self.node.object_dictionary[0x1018][numbers[0]].default = numbers[1]
                print("changed", flush=True)
            case "listen":
                self.node.rpdo[1].read()
                self.node.rpdo[1].add_callback(self.on_pdo)
            case "tpdo":
                pdo = self.node.tpdo[2]
                pdo.read()
                for variable, value in zip(pdo.map, numbers):
                    variable.raw = value
                pdo.transmit()
            case "written":
                print("written", json.dumps(self.written), flush=True)
                self.written.clear()


def main(port):
    slave = Slave(port)
    print("ready", flush=True)
    for line in sys.stdin:
        order, *numbers = line.split()
        if order == "quit":
            break
        slave.obey(order, *(int(number) for number in numbers))
    slave.network.disconnect()


main(int(sys.argv[1]))
