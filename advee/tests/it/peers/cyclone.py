"""Eclipse Cyclone DDS on the loopback interface, in the domain of the first argument; shared by the peers that use it."""

import os
import sys
from dataclasses import dataclass

os.environ["CYCLONEDDS_URI"] = """
<CycloneDDS><Domain id="any">
  <General><Interfaces><NetworkInterface address="127.0.0.1"/></Interfaces><AllowMulticast>false</AllowMulticast></General>
  <Discovery><ParticipantIndex>auto</ParticipantIndex><Peers><Peer address="127.0.0.1"/></Peers></Discovery>
</Domain></CycloneDDS>
"""

from cyclonedds.core import Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import int32, uint32
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

RELIABLE = Policy.Reliability.Reliable(duration(seconds=1))
VOLATILE = Qos(RELIABLE, Policy.History.KeepLast(10))
LATCHED = Qos(RELIABLE, Policy.History.KeepLast(1), Policy.Durability.TransientLocal)

participant = DomainParticipant(int(sys.argv[1]))


@dataclass
class Time(IdlStruct, typename="builtin_interfaces.msg.dds_.Time_"):
    sec: int32
    nanosec: uint32


@dataclass
class Header(IdlStruct, typename="std_msgs.msg.dds_.Header_"):
    stamp: Time
    frame_id: str


def reader(name, kind, qos=VOLATILE):
    """A reader of a topic by its name in DDS, as `rt/tf`."""
    return DataReader(participant, Topic(participant, name, kind, qos=qos), qos=qos)


def writer(name, kind, qos=VOLATILE):
    return DataWriter(participant, Topic(participant, name, kind, qos=qos), qos=qos)
