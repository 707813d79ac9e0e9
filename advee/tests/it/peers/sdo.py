"""Reads both simulated drives by SDO with the `canopen` package: `sdo.py PORT`; prints JSON."""
import json
import sys

import canopen

network = canopen.Network()
network.connect(interface="udp_multicast", channel="239.74.163.2", port=int(sys.argv[1]), hop_limit=0, fd=False)
result = {}
for name, node_id in (("epos", 1), ("icla", 2)):
    node = network.add_node(node_id, canopen.ObjectDictionary())
    sdo = node.sdo
    read = result[name] = {
        "type": int.from_bytes(sdo.upload(0x1000, 0), "little"),
        "vendor": int.from_bytes(sdo.upload(0x1018, 1), "little"),
        "name": sdo.upload(0x1008, 0).rstrip(b"\0").decode(),
    }
    try:
        sdo.upload(0x5FFF, 0)
    except canopen.SdoAbortedError as abort:
        read["absent"] = abort.code
network.disconnect()
print(json.dumps(result))
