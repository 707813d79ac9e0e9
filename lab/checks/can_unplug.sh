#!/bin/sh
# The whole robot on USB adapters: the driver's adapter is unplugged while the robot drives, and returns.
set -eu
. "$LAB_SOURCE/lab/checks/lib.sh"
. "$LAB_SOURCE/lab/checks/can_lib.sh"
needs ip candump python3
warm python3
plug_in candle candle
for interface in can0 can1; do set_up $interface 500000 0; done

step "start, and drive"
start --set "$boards"
drive

step "unplugged while driving"
number=$(cat /sys/class/net/can0/ifindex)
keep_driving
adapter unplug
expect "can.main is down: can0: "
within 3 stands || fail "it drives without its bus"
let_go
sleep 1
once "can.main is down"
[ ! -e /sys/class/net/can0 ] || fail "it is still there"
"$ADVEE" state driver_canbus | grep -e ERROR || fail "driver_canbus is not in ERROR"

step "plugged in again"
adapter plug
within 10 test -e /sys/class/net/can0 || fail "the adapter does not return"
[ "$(cat /sys/class/net/can0/ifindex)" != "$number" ] || fail "it has the old number"
set_up can0 500000 0
expect "can.main is up"
expect "the steering is homed"
drive
end
kill $adapter
