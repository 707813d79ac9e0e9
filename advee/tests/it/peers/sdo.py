"""Reads both simulated drives by SDO with the `canopen` package: `sdo.py PORT`; prints JSON.

A drive has one SDO server (the default SDO of CiA 301), and the robot's driver reads the drives, too: a transfer that
meets one of the driver's gets an answer that is not its own. It is repeated, as any second client must.
"""
import json
import sys

import canopen

ATTEMPTS = 50
ABSENT = 0x06020000


def upload(sdo, index, sub):
    for attempt in range(ATTEMPTS):
        try:
            return sdo.upload(index, sub)
        except canopen.SdoAbortedError as abort:
            if abort.code == ABSENT or attempt + 1 == ATTEMPTS:
                raise
        except canopen.SdoCommunicationError:
            if attempt + 1 == ATTEMPTS:
                raise


network = canopen.Network()
network.connect(interface="udp_multicast", channel="239.74.163.2", port=int(sys.argv[1]), hop_limit=0, fd=False)
result = {}
for name, node_id in (("epos", 1), ("icla", 2)):
    node = network.add_node(node_id, canopen.ObjectDictionary())
    sdo = node.sdo
    read = result[name] = {
        "type": int.from_bytes(upload(sdo, 0x1000, 0), "little"),
        "vendor": int.from_bytes(upload(sdo, 0x1018, 1), "little"),
        "name": upload(sdo, 0x1008, 0).rstrip(b"\0").decode(),
    }
    try:
        upload(sdo, 0x5FFF, 0)
    except canopen.SdoAbortedError as abort:
        read["absent"] = abort.code
network.disconnect()
print(json.dumps(result))
