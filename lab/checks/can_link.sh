#!/bin/sh
# The robot on two SJA1000 of one bus: paused, its interface down, the card gone and back, floods of foreign frames.
set -eu
. "$LAB_SOURCE/lab/checks/lib.sh"
. "$LAB_SOURCE/lab/checks/can_lib.sh"
needs ip candump cangen pgrep
warm cangen pgrep timeout
for interface in can0 can1; do set_up $interface 500000 0; done

step "start"
start --set "$boards"

step "PAUSE while driving: quick stop on the bus"
keep_driving
record can1 "$HOME/pause"
"$ADVEE" state driver_canbus PAUSE
within 3 stands || fail "it drives on"
recorded
has "$HOME/pause" " 501#0B00" # the EPOS's quick stop
"$ADVEE" state driver_canbus RUN
let_go
drive
step "link down while driving"
keep_driving
ip link set can0 down
expect "can.main is down: can0: the interface is down"
within 3 stands || fail "it drives without its bus"
sleep 1
once "can.main is down"
record can1 "$HOME/back"
ip link set can0 up
expect "can.main is up"
expect "the steering is homed"
sleep 1
stands || fail "it drives on, by a command of before"
recorded
let_go
once "can.main is up"
# Nothing that waited: a quick stop, for it may turn yet, then the drives are set up.
first=$(grep -e " [356]0[12]#" "$HOME/back" | grep -v -m 1 -e " 501#0B0000000000")
case $first in *" 60"[12]"#"*) ;; *) fail "an old command on the bus: $first" ;; esac
drive

step "interface gone while driving, and back"
driver=/sys/bus/pci/drivers/kvaser_pci
card=$(basename "$(readlink /sys/class/net/can0/device)")
keep_driving
echo "$card" >$driver/unbind
[ ! -e /sys/class/net/can0 ] || fail "it is still there"
expect "can.main is down: can0: "
within 3 stands || fail "it drives without its bus"
let_go
was=$(cat /sys/class/net/can1/ifindex)
echo "$card" >$driver/bind
set_up can0 500000 0
[ "$(cat /sys/class/net/can0/ifindex)" -gt "$was" ] || fail "it has the number of before"
expect "can.main is up"
expect "the steering is homed"
drive

step "a flood of frames that are nobody's here"
before=$(wc -l <"$log")
timeout 4 cangen can1 -e -g 0 -p 10 &
flood=$!
sleep 1
drive
wait $flood || true

step "a flood of all frames there are, NMT and the drives' own among them"
timeout 1 cangen can1 -g 0 -p 10 || true
within 5 stands || fail "it drives by foreign commands"
expect "no other master on can.main"
stands || fail "it drives by foreign commands"
[ $(($(wc -l <"$log") - before)) -lt 300 ] || fail "too many words about it"
! grep -e panicked -e ModuleDied -e ModuleHung "$log" || fail "a module died"

step "what foreign SDOs have made of the drives ends with a new driver, which boots them"
kill -9 "$(pgrep -f "advee run driver_canbus")"
expect "the steering is homed" 60
drive
end

overrun can1
