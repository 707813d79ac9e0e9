#!/bin/sh
# The whole robot on two SJA1000 of one bus: the driver uses one, the simulator's drives the other.
set -eu
. "$LAB_SOURCE/lab/checks/lib.sh"
. "$LAB_SOURCE/lab/checks/can_lib.sh"
needs ip candump
warm
for interface in can0 can1; do
    set_up $interface 500000 0
    [ "$(basename "$(readlink /sys/class/net/$interface/device/driver)")" = kvaser_pci ] || fail "$interface is no SJA1000"
done

step "start, and drive"
record can1 "$HOME/start"
start --set "$boards"
drive
recorded
has "$HOME/start" " 701#00" # boot-up
has "$HOME/start" " 701#05" # heartbeat: operational
has "$HOME/start" " 702#05"
has "$HOME/start" " 77F#05" # the master's
has "$HOME/start" " 501#"   # RPDO4: speed
has "$HOME/start" " 302#"   # RPDO2: steering

end
