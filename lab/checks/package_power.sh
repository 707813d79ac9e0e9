#!/bin/sh
# halt_command: the robot's user may not shut down the computer; the program that it runs instead does.
set -eu
. "$LAB_SOURCE/lab/checks/package.sh"
running
as_robot() { setpriv --reuid=advee --regid=advee --clear-groups "$@"; }

grep 'halt_command = .*advee-power", "poweroff"' /opt/advee/conf/robot.toml || fail "the robot would run something else"
if as_robot systemctl poweroff; then fail "its user may shut down the computer"; fi
if as_robot /opt/advee/bin/advee-power suspend; then fail "it may request anything"; fi
is active || fail "it does not run"
echo "now the machine resets"
as_robot /opt/advee/bin/advee-power poweroff
sleep 60
fail "the request is not executed"
