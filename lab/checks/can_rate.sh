#!/bin/sh
# Frames per second through two SJA1000 without loss: by our own CAN port, and by can-utils for comparison. The
# processor is emulated and the controllers have no wire: a figure of drivers and programs, not of a bus, which carries
# 3704 to 4504 frames of 8 bytes a second at 500 kbit/s.
set -eu
. "$LAB_SOURCE/lab/checks/lib.sh"
. "$LAB_SOURCE/lab/checks/can_lib.sh"
needs ip candump cangen
warm cangen
for interface in can0 can1; do set_up $interface 500000 0; done
frames=5000

now() { cut -d ' ' -f 1 /proc/uptime; }

step "our own port"
"$ADVEE" bench can can0 can1 --frames $frames || fail "frames are lost"

step "cangen and candump"
timeout 20 candump -n $frames can1 >"$HOME/dump" &
candump=$!
sleep 0.3
from=$(now)
cangen can0 -g 0 -p 10 -I 7F0 -L 8 -n $frames
wait $candump
to=$(now)
[ "$(wc -l <"$HOME/dump")" = $frames ] || fail "candump has $(wc -l <"$HOME/dump") of $frames frames"
awk "BEGIN { printf \"can0 to can1 %d frames, none lost, %d frames/s\\n\", $frames, $frames / ($to - $from) }"

step "lost by the controllers or the kernel"
for interface in can0 can1; do
    for what in rx_dropped rx_over_errors rx_errors tx_dropped tx_errors; do
        count=$(cat /sys/class/net/$interface/statistics/$what)
        [ "$count" = 0 ] || fail "$interface: $what is $count"
    done
done
