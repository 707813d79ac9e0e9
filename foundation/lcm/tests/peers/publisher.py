"""An official LCM publisher: sends message n of the test's series (see message() in interop.rs) each time a line
comes on stdin. Argument: URL. Ends with its stdin.
"""

import sys

import lcm

bus = lcm.LCM(sys.argv[1])
for n, _ in enumerate(sys.stdin):
    size = 60_000 * n // 199
    bus.publish(f"PEER_{n % 7}", bytes((i + n + i // 256) % 256 for i in range(size)))
