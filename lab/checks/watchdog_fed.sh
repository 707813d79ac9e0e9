#!/bin/sh
# The computer's own watchdog does not reset while all is healthy, during a restart, nor after a clean shutdown:
# the kernel's software watchdog and a device on PCI.
set -eu
. "$LAB_SOURCE/lab/checks/lib.sh"
. lab/checks/watchdog.sh

for kind in "Software Watchdog" "i6300ESB timer"; do
    step "$kind: fed while all is healthy"
    start "$kind"
    sleep 12
    step "$kind: our watchdog hangs, and is restarted"
    kill -STOP $(watchdog)
    expect "hangs: it is killed"
    sleep 6
    step "$kind: the module is killed, and restarted"
    kill -KILL "$(module)"
    expect "ModuleDied"
    sleep 6
    step "$kind: advee up is killed, and restarted in time"
    kill -KILL $up
    wait $up || true
    armed || fail "it was disarmed by a kill"
    start "$kind"
    sleep 6
    step "$kind: a clean shutdown"
    kill -INT $up
    wait $up || fail "exit code $?"
    ! armed || fail "it is still armed"
    sleep 12
done
