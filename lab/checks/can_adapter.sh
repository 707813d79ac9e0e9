#!/bin/sh
# A USB adapter whose controller goes bus-off, on a real kernel's driver: the bit rate is compared, the controller is
# restarted by whoever may, and frames flow again.
set -eu
. "$LAB_SOURCE/lab/checks/lib.sh"
. "$LAB_SOURCE/lab/checks/can_lib.sh"
needs ip candump python3 setpriv
warm setpriv python3

drives() { # PREFIX: the driver and its drives, the driver started by the prefix
    "$ADVEE" run simulator $on --set can.main.interface=can1 >/dev/null 2>&1 &
    simulator=$!
    $1 "$ADVEE" run driver_canbus $on >>"$log" 2>&1 &
    driver=$!
}

finish() {
    kill $driver $simulator
    wait $driver || fail "exit status $?"
    wait $simulator || true
}

alive() { # the master's heartbeat is on the bus
    [ -n "$(timeout 5 candump -n 1 can1,77F:7FF)" ] || fail "the driver does not send"
}

plug_in usb2can usb2can
set_up can1 500000 0

step "a bit rate that is not the bus's"
set_up can0 250000 0
drives env
expect "can0: runs at 250000 bit/s, the bus is configured for 500000"
step "the right one"
set_up can0 500000 0
expect "can.main is up"
alive

step "bus-off: restarted by us"
times=$(opened)
adapter off
expect "can.main is down: can0: bus-off"
expect "can.main is up"
once "can.main is down"
[ "$(count error-passive)" = 0 ] || fail "bus-off is told as error-passive, too"
[ "$(opened)" = $((times + 1)) ] || fail "the adapter was opened $(opened) times, was $times"
alive

step "bus-off: restarted by the kernel"
set_up can0 500000 1500
expect "can.main is up"
step "now"
adapter off
expect "can0: bus-off; the kernel restarts it after 1500 ms"
expect "can.main is up"
alive

step "the controller gets error-passive, and well again"
adapter warning
adapter passive
expect "the controller of can.main is error-passive: transmit errors 128, receive errors 0"
adapter passive
sleep 0.5
once "error-passive"
adapter active
expect "the controller of can.main is error-active"

step "frames with errors"
for _ in $(seq 20); do adapter stuff; done
expect "frames with errors within a second on can.main"
expect "the wire of can.main is clean"
once "frames with errors"

step "nobody acknowledges: the only other node leaves the bus"
ip link set can1 down
expect "nobody on can.main acknowledges what is sent"
sleep 3
once "nobody on can.main acknowledges"
once "error-passive"
ip link set can1 up
expect "frames on can.main are acknowledged"
expect "the controller of can.main is error-active"
alive
finish

step "bus-off: nobody may restart it"
set_up can0 500000 0
drives "setpriv --inh-caps=-net_admin --bounding-set=-net_admin"
alive
adapter off
expect "can0: bus-off, and restarting it needs CAP_NET_ADMIN"
step "but a person"
ip link set can0 type can restart
expect "can.main is up"
alive
finish
kill $adapter
