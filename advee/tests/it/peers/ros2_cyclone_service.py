"""Eclipse Cyclone DDS as a client of a service, with the header that rmw_cyclonedds_cpp puts in front of the content.

Asks `/courier/list_parameters` three times and prints a line of JSON. Everything waits for what it needs; the test
bounds the time.
"""

import json
import time
from dataclasses import dataclass

from cyclone import reader, writer
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import int64, sequence, uint64


@dataclass
class Request(IdlStruct, typename="rcl_interfaces.srv.dds_.ListParameters_Request_"):
    guid: uint64
    seq: int64
    prefixes: sequence[str]
    depth: uint64


@dataclass
class Response(IdlStruct, typename="rcl_interfaces.srv.dds_.ListParameters_Response_"):
    guid: uint64
    seq: int64
    names: sequence[str]
    prefixes: sequence[str]


name = "/courier/list_parameters"
answers = reader(f"rr{name}Reply", Response)
asks = writer(f"rq{name}Request", Request)

while not asks.get_matched_subscriptions() or not answers.get_matched_publications():
    time.sleep(0.02)
got = []
for number in [1, 2, 3]:
    asks.write(Request(guid=77, seq=number, prefixes=["limits.speed_mps"], depth=0))
    while len(got) < number:
        got.extend(answers.take(10))
        time.sleep(0.02)
print(json.dumps({"answers": [[one.guid, one.seq] for one in got], "names": got[-1].names}), flush=True)
