#!/bin/sh
# Wake-up latency of cyclictest and of our own loop, in turns, idle and under load; times are instructions here (16 ns
# each), so the result is the amount of work of the kernel and the loop between the clock's interrupt and the module.
# With PREEMPT_RT the p99.9 of our loop may be 1.2 times that of cyclictest; an ordinary kernel's figures are only
# shown.
set -eu
. "$LAB_SOURCE/lab/checks/lib.sh"
needs cyclictest hackbench
# Not a divisor of the kernel's tick of 4 ms, so that the wake-ups occur at all phases of it.
interval=490
seconds=3
bus=udpm://239.255.76.67:7667

# From memory, and once before: a page read over a share during the measurement takes seconds.
cd "$HOME"
for program in cyclictest hackbench; do
    cp "$(command -v "$program")" "$HOME/"
    "$HOME/$program" --help >/dev/null 2>&1 || true
done
"$ADVEE" bench >/dev/null

theirs() { # FILE: appends a histogram, "us count" a line
    "$HOME/cyclictest" -m -p 80 -i $interval -D $seconds -q -h 50000 >said
    grep -E '^[0-9]{6} [0-9]+' said | grep -v ' 000000$' >>"$1" || true
    # Values beyond the histogram count as the maximum.
    beyond=$(sed -n 's/^# Histogram Overflows: 0*\([0-9]\)/\1/p' said)
    largest=$(sed -n 's/^# Max Latencies: 0*\([0-9]\)/\1/p' said)
    [ "${beyond:-0}" = 0 ] || echo "$largest $beyond" >>"$1"
}

ours() { # FILE BUS
    "$ADVEE" --lcm-url "$bus?$2" bench jitter --priority 80 --interval $interval --for $seconds --histogram >said
    sed -n '/us, count$/,$p' said | grep -E '^[0-9]{6}' >>"$1"
    awk '/^late by/ { if ($9 >= 100000) print $9, 1 }' said >>"$1"
    awk '/^late by/ { print $10 + 0 }' said >>"$1.missed"
}

quantile() { # FILE OF: the smallest time that so many of 1000 do not exceed
    sort -n "$1" | awk -v of="$2" '
        { us[NR] = $1 + 0; count[NR] = $2 + 0; all += $2 }
        END { for (n = 1; n <= NR; n++) { sum += count[n]; if (sum * 1000 >= all * of) { print us[n]; exit } } }'
}

row() { # NAME FILE
    all=$(awk '{ all += $2 } END { print all + 0 }' "$2")
    mean=$(awk '{ all += $2; sum += $1 * $2 } END { printf "%.1f", sum / all }' "$2")
    printf '%-22s %8s %6s %8s %6s %7s %7s\n' "$1" "$all" "$(quantile "$2" 0)" "$mean" "$(quantile "$2" 990)" \
        "$(quantile "$2" 999)" "$(quantile "$2" 1000)"
}

missed() { # FILE
    awk '{ all += $1 } END { print all }' "$1.missed"
}

measure() { # NAME ROUNDS
    for round in $(seq "$2"); do
        theirs "$1.theirs"
        ours "$1.ours" ttl=0
    done
    # With shared memory one program, here the only one, checks once a second for other receivers: two files of /proc,
    # 130 000 instructions. Shown separately.
    ours "$1.shared" "ttl=0&shm=auto"
}

measure idle 1
# Low priority, so that this script gets its turns; a real-time thread precedes all of them.
nice -n 19 "$HOME/hackbench" -l 1000000 -g 2 >/dev/null 2>&1 &
hackbench=$!
# Page allocation, short processes, a processor that is never idle.
nice -n 19 sh -c "while head -c 16M /dev/zero >filled && rm filled; do :; done" &
nice -n 19 sh -c "while :; do :; done" &
sleep 0.5
measure loaded 2
kill -0 $hackbench || fail "the load did not last"

echo "kernel $(uname -r), each $interval us, SCHED_FIFO 80; us of 16 ns instructions"
printf '%-22s %8s %6s %8s %6s %7s %7s\n' "" count min mean p99 p99.9 max
for load in idle loaded; do
    row "$load, cyclictest" $load.theirs
    row "$load, our loop" $load.ours
    row "$load, with shm=auto" $load.shared
    echo "  missed of these two: $(missed $load.ours), $(missed $load.shared)"
done
theirs=$(quantile loaded.theirs 999)
ours=$(quantile loaded.ours 999)
echo "loaded, p99.9: $ours us, cyclictest $theirs us: $(awk "BEGIN { printf \"%.2f\", $ours / $theirs }") times"
[ "$(cat /sys/kernel/realtime 2>/dev/null)" = 1 ] || exit 0
awk "BEGIN { exit !($ours <= 1.2 * $theirs) }" || fail "more than 1.2 times cyclictest's"
