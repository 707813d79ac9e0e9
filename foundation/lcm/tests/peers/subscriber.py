"""An official LCM subscriber: writes each message that it receives to stdout as
channel length, payload length (32 bits each, big-endian), channel, payload.
Arguments: URL, pattern, count of messages. Ends without one after 10 s of silence.
"""

import struct
import sys

import lcm

url, pattern, count = sys.argv[1], sys.argv[2], int(sys.argv[3])
out = sys.stdout.buffer


def handle(channel, payload):
    out.write(struct.pack(">II", len(channel), len(payload)) + channel.encode() + payload)
    out.flush()


bus = lcm.LCM(url)
bus.subscribe(pattern, handle)
out.write(b"ready\n")
out.flush()
for _ in range(count):
    if bus.handle_timeout(10_000) == 0:
        sys.exit("no message within 10 s")
