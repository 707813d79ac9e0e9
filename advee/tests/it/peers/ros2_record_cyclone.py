"""Eclipse Cyclone DDS records what the robot publishes: `ros2_record_cyclone.py DOMAIN FILE COUNT TOPIC...`, until
there are COUNT messages of each of the topics. Of the types its readers have the names alone: the content is recorded
as it comes. Prints a line of JSON: messages by topic.

Everything waits for what it needs; the test bounds the time.
"""

import json
import sys
import time
import types
from dataclasses import dataclass

from cyclone import participant, reader
from cyclonedds._clayer import ddspy_take
from cyclonedds.builtin import BuiltinDataReader, BuiltinTopicDcpsPublication
from cyclonedds.core import InstanceState, Policy, Qos, SampleState, ViewState
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import uint8
from ros2_bag import Bag

ANY = SampleState.Any | ViewState.Any | InstanceState.Any


def opaque(name):
    """A type of this name."""
    members = {"__annotations__": {"first": uint8}}
    return dataclass(types.new_class("Opaque", (IdlStruct,), {"typename": name}, lambda names: names.update(members)))


class Recorder:
    def __init__(self, path):
        self.writers = BuiltinDataReader(participant, BuiltinTopicDcpsPublication)
        self.bag = Bag(path)
        self.readers = {}
        # Writers that are not heard yet, and the robot's participant as soon as it is known.
        self.waiting = []
        self.robot = None

    def discover(self):
        self.waiting += [writer for writer in self.writers.take(100) if writer.topic_name.startswith("rt/")]
        for writer in self.waiting:
            if writer.topic_name == "rt/robot_description":
                self.robot = writer.participant_key
        if self.robot is not None:
            for writer in self.waiting:
                if writer.participant_key == self.robot and "/_action/" not in writer.topic_name:
                    self.hear(writer)
            self.waiting.clear()

    def hear(self, writer):
        reliability, durability = writer.qos[Policy.Reliability], writer.qos[Policy.Durability]
        qos = Qos(reliability, durability, Policy.History.KeepLast(1000))
        name = writer.topic_name.removeprefix("rt")
        kind = writer.type_name.replace("dds_::", "").removesuffix("_").replace("::", "/")
        self.bag.add(name, kind, reliability != Policy.Reliability.BestEffort)
        self.readers[name] = reader(writer.topic_name, opaque(writer.type_name.replace("::", ".")), qos)

    def take(self):
        for name, heard in self.readers.items():
            taken = ddspy_take(heard._ref, ANY, 1000)
            for data, info in taken if isinstance(taken, list) else []:
                # Other nodes publish on /rosout too.
                if info.valid_data and (name != "/rosout" or self.is_robot(heard, info.publication_handle)):
                    self.bag.write(name, bytes(data), time.time_ns(), info.source_timestamp)

    def is_robot(self, heard, writer):
        publication = heard.get_matched_publication_data(writer)
        return publication is not None and publication.participant_key == self.robot


recorder = Recorder(sys.argv[2])
while not recorder.bag.has(int(sys.argv[3]), sys.argv[4:]):
    recorder.discover()
    recorder.take()
    time.sleep(0.01)
recorder.bag.close()
print(json.dumps({"counts": recorder.bag.counts}), flush=True)
