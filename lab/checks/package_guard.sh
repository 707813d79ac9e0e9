#!/bin/sh
# The chain of supervision under a real systemd: each link that dies or hangs is restarted, and the modules are adopted.
set -eu
. "$LAB_SOURCE/lab/checks/package.sh"
running
before=$(restarts)

step "the watchdog is killed: advee up starts a new one, which adopts the modules"
watchdog=$(module watchdog) power=$(module driver_power) up=$(main)
kill -9 "$watchdog"
within 10 other watchdog "$watchdog" || fail "it did not return"
within 20 all_run || fail "not all modules RUN again"
[ "$(module driver_power)" = "$power" ] || fail "driver_power was restarted"
[ "$(main)" = "$up" ] || fail "everything was restarted"
drive

step "the watchdog hangs: the same"
watchdog=$(module watchdog)
kill -STOP "$watchdog"
within 10 other watchdog "$watchdog" || fail "it did not return"
within 20 all_run || fail "not all modules RUN again"
[ "$(main)" = "$up" ] || fail "everything was restarted"

step "advee up is killed: systemd starts a new one, whose watchdog adopts the modules"
watchdog=$(module watchdog) power=$(module driver_power) up=$(main)
kill -9 "$up"
within 10 renewed "$up" || fail "systemd does not restart it"
within 10 gone "$watchdog" || fail "the watchdog outlives it"
within 20 other watchdog "$watchdog" || fail "no new watchdog"
within 30 all_run || fail "not all modules RUN again"
[ "$(restarts)" = $((before + 1)) ] || fail "it was started again $(restarts) times"
[ "$(module driver_power)" = "$power" ] || fail "driver_power was restarted"
homed
drive

step "advee up hangs: WatchdogSec"
up=$(main)
kill -STOP "$up"
within 40 renewed "$up" || fail "it was not ended"
within 40 all_run || fail "not all modules RUN again"
[ "$(restarts)" = $((before + 2)) ] || fail "it was started again $(restarts) times"
journalctl --no-pager -u advee | grep 'Watchdog timeout' || fail "the reason was not the watchdog"
homed
drive

step "limits of modules apply in its cgroup; with them advee up is restarted when killed, too"
sed -i '/^name = "logger"/a memory_max = 200000000' /opt/advee/conf/modules.toml
systemctl restart advee || fail "it does not start"
within 30 all_run || fail "not all modules RUN"
group=$(sed -n 's/^0:://p' "/proc/$(module logger)/cgroup")
limits=$(cat "/sys/fs/cgroup$group/memory.max")
[ "$limits" = $((200000000 / 4096 * 4096)) ] || fail "the limit is $limits"
watchdog=$(module watchdog)
kill -9 "$(main)"
within 30 other watchdog "$watchdog" || fail "no new watchdog"
within 40 all_run || fail "not all modules RUN again"
journalctl --no-pager -u advee | grep -c 'Failed to attach' || true
sed -i '/^memory_max = 200000000/d' /opt/advee/conf/modules.toml

step "a stop leaves no process"
systemctl stop advee
is inactive || fail "it is $(show ActiveState)"
[ -z "$(module watchdog)$(module driver_power)$(module simulator)" ] || fail "something is left over"

step "without systemd: advee-guard passes its arguments on, and one that has a server has the page"
serves() { [ -n "$(module web)" ]; }
up_runs() { # advee up, of whatever start: its process
    for process in /proc/[0-9]*; do
        # The list may be older than the process.
        if [ "$(tr '\0' ' ' 2>/dev/null <"$process/cmdline" | cut -d' ' -f2)" = up ]; then
            echo "${process#/proc/}"
        fi
    done
}
is_over() { [ -z "$(up_runs)" ]; }
export ADVEE_RUN=/run/advee-cron
/opt/advee/bin/advee-guard --sim --world empty --goal none --http 127.0.0.1:8081 || fail "it does not start"
within 60 serves || fail "the robot has no page: $(tail -n 20 /opt/advee/log/advee.log)"
kill "$(up_runs)"
within 30 is_over || fail "it does not end"
/opt/advee/bin/advee-guard --sim --world empty --goal none || fail "it does not start"
running_again() { [ -n "$(module driver_power)" ]; }
within 60 running_again || fail "it does not run: $(tail -n 20 /opt/advee/log/advee.log)"
! serves || fail "without a server in its arguments it has a page"
kill "$(up_runs)"
within 30 is_over || fail "it does not end"
