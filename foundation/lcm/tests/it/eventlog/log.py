"""Event logs by the official library. `read FILE`: a line for each event; `write FILE`: a log of lines of that kind."""

import sys

import lcm

role, path = sys.argv[1:]
if role == "read":
    for event in lcm.EventLog(path, "r"):
        print(event.eventnum, event.timestamp, event.channel, event.data.hex())
else:
    log = lcm.EventLog(path, "w", overwrite=True)
    for line in sys.stdin:
        _, timestamp, channel, data = line.rstrip("\n").split(" ")
        log.write_event(int(timestamp), channel, bytes.fromhex(data))
    log.close()
