"""Eclipse Cyclone DDS listens to the heartbeat of the robot's node, until that says that the bond is broken.

Prints a line of JSON. Everything waits for what it needs; the test bounds the time.
"""

import json
import time
from dataclasses import dataclass

from cyclone import Header, reader
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import float32


@dataclass
class Status(IdlStruct, typename="bond.msg.dds_.Status_"):
    header: Header
    id: str
    instance_id: str
    active: bool
    heartbeat_timeout: float32
    heartbeat_period: float32


bond = reader("rt/bond", Status)
beats = []
while not beats or beats[-1].active:
    beats.extend(bond.take(10))
    time.sleep(0.02)
stamps = [beat.header.stamp.sec + beat.header.stamp.nanosec / 1e9 for beat in beats if beat.active]
told = {
    "bonds": sorted({beat.id for beat in beats}),
    "instances": len({beat.instance_id for beat in beats}),
    "broken": sum(not beat.active for beat in beats),
    "gaps": [later - earlier for earlier, later in zip(stamps, stamps[1:])],
    "period": beats[0].heartbeat_period,
}
print(json.dumps(told), flush=True)
