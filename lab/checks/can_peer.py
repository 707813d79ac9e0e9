#!/usr/bin/env python3
"""can_peer.py NODE [INTERFACE CHANNEL PORT]: a CANopen slave by durand (PyPI), on can1 by default; node 255 is
unconfigured.

0x2000 stores any bytes; 0x2001 is a number from 10 to 20; 0x2002 can only be read.
"""

import sys

import can
from durand import CANBusNetwork, MinimalNode
from durand.datatypes import DatatypeEnum as Type
from durand.object_dictionary import ObjectDictionary, Variable
from durand.scheduler import SyncScheduler, set_scheduler


def objects():
    od = ObjectDictionary()
    od[0x2000] = Variable(Type.DOMAIN, "rw", b"", name="Any bytes")
    od[0x2001] = Variable(Type.UNSIGNED16, "rw", 10, minimum=10, maximum=20, name="From 10 to 20")
    od[0x2002] = Variable(Type.UNSIGNED16, "ro", 20, name="Read-only")
    return od


def main():
    number = int(sys.argv[1])
    interface, channel = sys.argv[2:4] or ("socketcan", "can1")
    port = {"port": int(sys.argv[4]), "hop_limit": 0, "fd": False} if sys.argv[4:] else {}
    scheduler = SyncScheduler()
    set_scheduler(scheduler)
    od = objects()
    MinimalNode(CANBusNetwork(can.Bus(interface=interface, channel=channel, **port)), number, od)
    for index, value in enumerate((0x4C41, 0x4231, 0x10002, 0xBEEF), 1):
        od.write(0x1018, index, value)
    od.write(0x1008, 0, b"a slave by durand")
    print("ready", flush=True)
    scheduler.run()


if __name__ == "__main__":
    main()
