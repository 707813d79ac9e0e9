"""An official LCM subscriber: prints `ready`, then the number in each message that comes (64 bits, little-endian).
Arguments: URL, channel. Ends with its stdin.
"""

import select
import struct
import sys

import lcm

bus = lcm.LCM(sys.argv[1])
out = sys.stdout
subscription = bus.subscribe(sys.argv[2], lambda _, payload: print(struct.unpack_from("<Q", payload)[0]))
subscription.set_queue_capacity(100_000)
print("ready", flush=True)
while True:
    ready, _, _ = select.select([bus.fileno(), sys.stdin], [], [])
    if sys.stdin in ready:
        break
    bus.handle()
