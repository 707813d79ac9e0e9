#!/bin/sh
# The robot on a virtual interface of the kernel: bus-off reported by error frames, the interface deleted, frames lost.
set -eu
. "$LAB_SOURCE/lab/checks/lib.sh"
. "$LAB_SOURCE/lab/checks/can_lib.sh"
needs ip candump cansend cangen
warm cangen
on="--sim --run-dir $run --set can.main.interface=vcan0"
add() {
    ip link add vcan0 type vcan
    ip link set vcan0 up
}

add
step "start, and drive"
start
drive

step "bus-off"
cansend vcan0 20000040#0000000000000000
expect "can.main is down: vcan0: bus-off"
expect "can.main is up"
expect "the steering is homed"
once "can.main is down"
drive

step "interface removed and returned"
ip link delete vcan0
expect "can.main is down: vcan0: "
add
expect "can.main is up"
expect "the steering is homed"
drive
end

overrun vcan0
ip link delete vcan0
