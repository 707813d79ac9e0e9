"""A peer on the official Python package; what it does stands in peer.c.

Types are named `vec.geom.point_t`, their channels `vec_geom_point_t`. One more role, `types TYPE...`: makes one of each,
encodes and decodes it.
"""

import importlib
import select
import struct
import sys

import lcm


def find(name):
    package, _, short = name.rpartition(".")
    return getattr(importlib.import_module(package or short), short)


def copy_log(source, target):
    log = lcm.EventLog(target, "w", overwrite=True)
    for event in lcm.EventLog(source, "r"):
        log.write_event(event.timestamp, event.channel, event.data)
    log.close()


class Peer:
    def __init__(self, types):
        self.stdin, self.stdout = open(0, "rb", buffering=0), sys.stdout.buffer
        self.lcm = lcm.LCM()
        self.lcm.subscribe("TO_.*", self.tell).set_queue_capacity(0)
        for name in types:
            self.lcm.subscribe(name.replace(".", "_"), self.typed(find(name))).set_queue_capacity(0)

    def run(self):
        self.stdout.write(b"ready\n")
        self.stdout.flush()
        while True:
            readable, _, _ = select.select([self.lcm.fileno(), self.stdin], [], [])
            if self.lcm.fileno() in readable:
                self.lcm.handle()
            if self.stdin in readable and not self.publish():
                return

    def tell(self, channel, payload):
        self.stdout.write(struct.pack(">II", len(channel), len(payload)) + channel.encode() + payload)
        self.stdout.flush()

    def typed(self, message_type):
        def handler(channel, payload):
            payload = message_type.decode(payload).encode()
            self.tell(channel, payload)
            self.lcm.publish("FROM_TYPED", payload)

        return handler

    def publish(self):
        """Publishes the next message of stdin; false at its end."""
        head = self.read(8)
        if not head:
            return False
        channel_len, payload_len = struct.unpack(">II", head)
        channel = self.read(channel_len).decode()
        self.lcm.publish(channel, self.read(payload_len))
        return True

    def read(self, length):
        data = bytearray()
        while len(data) < length and (piece := self.stdin.read(length - len(data))):
            data += piece
        return bytes(data)


role, arguments = sys.argv[1], sys.argv[2:]
if role == "log":
    copy_log(*arguments)
elif role == "types":
    for name in arguments:
        find(name).decode(find(name)().encode())
else:
    Peer(arguments).run()
