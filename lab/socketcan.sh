#!/bin/sh
# The simulated robot on a CAN interface of a real kernel: motion, bus-off, link down, frames lost.
# Runs itself in a virtual machine (boot.sh).
set -eu
cd "$(dirname "$(realpath "$0")")/.."
export ADVEE="$(realpath "${ADVEE:-target/release/advee}")"
[ -x "$ADVEE" ] || { echo "socketcan.sh: there is no $ADVEE: make build" >&2; exit 1; }
for tool in candump cansend cangen ip; do
    command -v $tool >/dev/null || {
        echo "socketcan.sh: $tool is missing: apt-get install --no-install-recommends can-utils iproute2" >&2
        exit 1
    }
done
[ -n "${LAB:-}" ] || exec lab/boot.sh "$0"

log=/tmp/log
robot="--sim --run-dir /run/advee --set can.main.interface=can0"

fail() {
    echo "FAILED: $*"
    cat $log
    exit 1
}

# From here on `expect` and `count` look at what is new in the log.
step() {
    echo "== $*"
    touch $log
    seen=$(wc -l <$log)
}

news() { tail -n +$((seen + 1)) $log; }

count() { news | grep -c -e "$1" || true; }

expect() { # TEXT: it comes within a minute
    until=$(($(date +%s) + 60))
    while [ "$(date +%s)" -lt $until ]; do
        if news | grep -m 1 -e "$1"; then return; fi
        sleep 0.2
    done
    fail "never said: $1"
}

once() { [ "$(count "$1")" = 1 ] || fail "said $(count "$1") times: $1"; }

truth() { "$ADVEE" lcm echo SIM_DATA_TRUTH --for 0.3 | sed -n "\$s/.* $1=\([^ ]*\).*/\1/p"; }

record() { # FILE: what is on the bus, until `recorded`
    candump -L can0 >"$1" &
    candump=$!
    sleep 0.3
}

recorded() {
    kill $candump
    wait $candump || true
}

has() { grep -q -e "$2" "$1" || fail "never on the bus: $2"; }

drive() {
    from=$(truth x)
    "$ADVEE" drive 0.3 0.1 --for 2
    to=$(truth x)
    awk "BEGIN { exit !($to - $from > 0.2) }" || fail "it did not drive: x was $from m, is $to m"
}

modprobe -a vcan can-raw
ip link add can0 type vcan
ip link set can0 up
ip link set lo multicast on
ip route add 224.0.0.0/4 dev lo

step "start, and drive"
record /tmp/start
"$ADVEE" up --headless $robot >$log 2>&1 &
up=$!
expect "the steering is homed"
drive
recorded
has /tmp/start " 701#00"     # boot-up
has /tmp/start " 701#05"     # heartbeat: operational
has /tmp/start " 702#05"
has /tmp/start " 77F#05"     # the master's
has /tmp/start " 501#"       # RPDO4: speed
has /tmp/start " 302#"       # RPDO2: steering

step "bus-off"
cansend can0 20000040#0000000000000000
expect "can.main is down: can0: bus-off"
expect "can.main is up"
expect "the steering is homed"
once "can.main is down"
drive

step "link down while driving"
"$ADVEE" drive 0.3 0 >/dev/null &
drive=$!
sleep 2
ip link set can0 down
expect "can.main is down: can0: the interface is down"
sleep 3
once "can.main is down"
[ "$(truth speed)" = 0.0 ] || fail "it drives without its bus"
ip link set can0 up
record /tmp/back
expect "can.main is up"
expect "the steering is homed"
recorded
kill -INT $drive
wait $drive || true
once "can.main is up"
# Nothing that waited: the drives are set up before they are told to move.
[ "$(grep -m 1 -o -e " [356]0[12]#" /tmp/back | tr -d ' #')" -ge 600 ] || fail "old commands on the bus: $(head /tmp/back)"
drive

step "interface gone and back"
ip link delete can0
expect "can.main is down: can0: "
ip link add can0 type vcan
ip link set can0 up
expect "can.main is up"
expect "the steering is homed"
drive

step "end"
kill -INT $up
wait $up || fail "exit code $?"

step "more frames than the driver takes"
"$ADVEE" run driver_canbus $robot >>$log 2>&1 &
driver=$!
sleep 1
kill -STOP $driver
cangen can0 -g 0 -n 10000 -I 123 -L 8 -p 10
kill -CONT $driver
sleep 1
cansend can0 123#00     # the next frame brings the count
expect "the receive buffer ran over: [0-9]* frames are lost"
kill $driver
wait $driver || fail "exit code $?"

echo "== all well"
