# What the checks of CAN share: sourced after lib.sh. The driver has can0, the simulator's drives have can1, where there are
# two interfaces on one bus.
# shellcheck shell=sh disable=SC2034,SC2086

run=$HOME/run
on="--sim --run-dir $run --set can.main.interface=can0"
boards='modules.simulator.args=["--set", "can.main.interface=can1"]'

# What is read once is in memory: else time goes on while the machine waits for a file.
warm() { # PROGRAM...: besides those that every check uses
    for program in sh ip awk candump cansend cat date grep kill sed seq sleep stdbuf tail wc "$@"; do
        path=$(command -v "$program") || continue
        [ ! -f "$path" ] || ldd "$path" | grep -o '/[^ ]*' | xargs cat "$path" >/dev/null
    done
    find conf -type f -exec cat {} + >/dev/null
    "$ADVEE" --version >/dev/null
}

set_up() { # INTERFACE BIT/S RESTART-MS: ms until the kernel restarts its controller
    ip link set "$1" down
    ip link set "$1" type can bitrate "$2" restart-ms "$3"
    ip link set "$1" up
}

start() { # ARGUMENT...: the robot; it is ready to drive
    "$ADVEE" up --headless $on "$@" >>"$log" 2>&1 &
    robot=$!
    expect "the steering is homed"
}

end() { # the robot, in good order
    kill -INT $robot
    wait $robot || fail "exit status $?"
}

keep_driving() { # it is driven in the background
    "$ADVEE" drive 0.3 0 >/dev/null &
    hand=$!
    within 10 moves || fail "it does not begin to move"
}

let_go() {
    kill -INT $hand
    wait $hand || true
}

moves() { [ "$(truth speed)" != 0.0 ]; }

stands() { ! moves; }

record() { # INTERFACE FILE: what is on the bus, until `recorded`
    stdbuf -oL candump -L "$1" >"$2" &
    candump=$!
    sleep 0.3
}

recorded() {
    kill $candump
    wait $candump || true
}

has() { grep -q -e "$2" "$1" || fail "never on the bus: $2"; } # FILE FRAME

# Adapters on USB (models/usb_can.py).

overrun() { # INTERFACE to send from: a driver that stands still loses frames, and counts them
    step "more frames than the driver takes"
    "$ADVEE" run driver_canbus $on >>"$log" 2>&1 &
    driver=$!
    sleep 1
    kill -STOP $driver
    cangen "$1" -g 0 -n 12000 -I 123 -L 8 -p 10
    kill -CONT $driver
    sleep 1
    cansend "$1" 123#00 # the next frame brings the count
    expect "the receive buffer overflowed: [0-9]* frames are lost"
    kill $driver
    wait $driver || fail "exit status $?"
}

plug_in() { # KIND...
    mkfifo "$HOME/bus"
    touch "$HOME/asked"
    python3 "$LAB_SOURCE/lab/models/usb_can.py" "$HOME/bus" "$HOME/asked" "$@" &
    adapter=$!
    within 60 grep -q ready "$HOME/asked" || fail "there are no adapters"
}

adapter() { echo "$1 0" >"$HOME/bus"; } # WHAT: happens to the driver's

opened() { grep -c "^0 open" "$HOME/asked" || true; } # how often the driver's adapter was
