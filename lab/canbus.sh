#!/bin/sh
# A CAN controller that goes bus-off, on a real kernel's driver: the bit rate is compared, the controller is restarted by
# whoever may, and frames flow again. Runs itself in a virtual machine (boot.sh).
set -eu
cd "$(dirname "$(realpath "$0")")/.."
export ADVEE="$(realpath "${ADVEE:-target/release/advee}")"
[ -x "$ADVEE" ] || { echo "canbus.sh: there is no $ADVEE: make build" >&2; exit 1; }
for tool in ip python3 setpriv; do
    command -v $tool >/dev/null || { echo "canbus.sh: $tool is missing" >&2; exit 1; }
done
[ -n "${LAB:-}" ] || exec lab/boot.sh "$0"

log=/tmp/log
robot="--sim --run-dir /run/advee --set can.main.interface=can0 --set can.main.bitrate=500000"

fail() {
    echo "FAILED: $*"
    cat $log /tmp/adapter
    exit 1
}

# From here on `expect` looks at what is new in the log, and `asked` at what the adapter was asked.
step() {
    echo "== $*"
    touch $log
    seen=$(wc -l <$log)
    before=$(wc -l </tmp/adapter)
}

expect() { # TEXT: it comes within a minute
    until=$(($(date +%s) + 60))
    while [ "$(date +%s)" -lt $until ]; do
        if tail -n +$((seen + 1)) $log | grep -m 1 -e "$1"; then return; fi
        sleep 0.2
    done
    fail "never said: $1"
}

asked() { # TEXT: the adapter was asked it, within ten seconds
    for _ in 1 2 3 4 5 6 7 8 9 10; do
        if tail -n +$((before + 1)) /tmp/adapter | grep -m 1 -e "$1"; then return; fi
        sleep 1
    done
    fail "the adapter was never asked: $1"
}

start() { # PREFIX: the driver and its drives, each started by the prefix
    $1 "$ADVEE" run simulator $robot >/dev/null 2>&1 &
    simulator=$!
    $1 "$ADVEE" run driver_canbus $robot >>$log 2>&1 &
    driver=$!
}

end() {
    kill $driver $simulator
    wait $driver || fail "exit code $?"
    wait $simulator || true
}

set_up() { # bit/s, ms until the kernel restarts a controller
    ip link set can0 down
    ip link set can0 type can bitrate "$1" restart-ms "$2"
    ip link set can0 up
}

mkfifo /tmp/bus
touch /tmp/adapter
python3 lab/usb_can.py /tmp/bus /tmp/adapter &
adapter=$!
until [ -e /sys/class/net/can0 ]; do sleep 0.2; done
ip link set lo multicast on
ip route add 224.0.0.0/4 dev lo

step "a bit rate that is not the bus's"
set_up 250000 0
start env
expect "can0: runs at 250000 bit/s, the bus is configured for 500000"
step "the right one"
set_up 500000 0
expect "can.main is up"
asked "77F#"    # the master's heartbeat

step "bus-off: restarted by us"
echo off >/tmp/bus
expect "can.main is down: can0: bus-off"
expect "can.main is up"
asked "open"
asked "77F#"

step "bus-off: restarted by the kernel"
set_up 500000 1500
expect "can.main is up"
step "now"
echo off >/tmp/bus
expect "can0: bus-off; the kernel restarts it after 1500 ms"
expect "can.main is up"
asked "77F#"
end

step "bus-off: nobody may restart it"
set_up 500000 0
start "setpriv --inh-caps=-net_admin --bounding-set=-net_admin"
asked "77F#"
echo off >/tmp/bus
expect "can0: bus-off, and restarting it needs CAP_NET_ADMIN"
step "but a person"
ip link set can0 type can restart
expect "can.main is up"
asked "77F#"
end

kill $adapter
echo "== all well"
