#!/bin/sh
# The simulated robot with real-time priorities on PREEMPT_RT: jitter of SYNC and heartbeat on a SocketCAN bus, and of
# the heartbeats of its threads, idle and under load.
set -eu
. "$LAB_SOURCE/lab/checks/lib.sh"
needs ip hackbench
# From memory, and once before: a page read over a share takes seconds.
cp "$(command -v hackbench)" "$HOME/"
"$ADVEE" bench jitter --for 0.2 --lcm-url memq:// >/dev/null
"$HOME/hackbench" --help >/dev/null 2>&1 || true
export LCM_DEFAULT_URL="udpm://239.255.76.67:7667?ttl=0&shm=auto"

ip link add can0 type vcan
ip link set can0 txqueuelen 10 up
# The module that sends on the bus, and the other end of the bus.
rt_priorities driver_canbus=42 simulator=40
run="--run-dir /run/advee"
robot="--config $HOME/conf/advee --set can.main.interface=can0 --set can.main.sync_s=0.01 --set log.folder=$HOME/log"
"$ADVEE" $robot $run up --sim --headless --goal none >"$log" 2>&1 &
up=$!
step "the robot comes up"
expect "all .* modules RUN"
has_priorities

look() { # NAME: both at once
    "$ADVEE" $run bench jitter --beats --priority 45 --for 3 >"$HOME/beats" &
    beats=$!
    sleep 0.5
    "$ADVEE" $run bench jitter --can can0 --for 2 >"$HOME/can" || fail "can: $(cat "$HOME/can")"
    wait $beats || fail "beats: $(cat "$HOME/beats")"
    echo "-- $1"
    cat "$HOME/can" "$HOME/beats"
    # SYNC each 10 ms and the heartbeat each 50 ms within 1 ms; no thread near the 200 ms that are a hang.
    awk '/ SYNC / { seen = 1; if ($8 > 1000) exit 1 } END { exit !seen }' "$HOME/can" || fail "SYNC is uneven"
    awk '/heartbeat 127/ { seen = 1; if ($9 > 1000) exit 1 } END { exit !seen }' "$HOME/can" || fail "the heartbeat is uneven"
    awk '/^driver_canbus main/ { seen = 1; if ($8 > 60000) exit 1 } END { exit !seen }' "$HOME/beats" || fail "its heartbeats are uneven"
}

look idle
nice -n 19 "$HOME/hackbench" -l 1000000 -g 1 >/dev/null 2>&1 &
nice -n 19 sh -c "while :; do :; done" &
sleep 0.5
look loaded
grep -q "hang\|killed" "$log" && fail "a module was judged as hanging"
kill -TERM $up
wait $up || fail "it did not end in good order"
