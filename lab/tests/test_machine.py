"""The runner with real machines that panic and hang: QEMU and a kernel in the cache, or it is skipped."""

import os
import shutil
import unittest

from own_lab import OwnLab

CACHE = os.environ.get("LAB_CACHE") or os.path.expanduser("~/.cache/advee-lab")


@unittest.skipUnless(shutil.which("qemu-system-x86_64"), "there is no qemu-system-x86_64")
@unittest.skipUnless(os.path.isdir(os.path.join(CACHE, "kernel-std")), "no kernel is in the cache: lab/lab --fetch")
class Machine(OwnLab):
    def test_machines_that_panic_and_hang_do_not_take_the_other_checks_with_them(self):
        os.remove(self.path("bin", "qemu-system-x86_64"))
        self.check("lies", "printf '\\001end lies 0\\n'; echo end 0; exit 5")
        self.check("panics", "sleep 1; echo c >/proc/sysrq-trigger; sleep 60")
        self.check("hangs", "echo it spins; while :; do :; done", limit=5)
        self.check("awaited", "echo now the machine resets; sleep 1; echo b >/proc/sysrq-trigger; sleep 60", reset=True)
        self.check("next", "printf 'a fresh machine'")
        status, said = self.run_lab(LAB_CACHE=CACHE)
        self.assertEqual(status, 1, said)
        self.assertIn("exit status 5", said)
        self.assertRegex(said, "the machine ended by itself; its console:(.|\n)*Kernel panic - not syncing: sysrq triggered crash")
        self.assertIn("not done within 5 s; its console:", said)
        self.assertIn("lab: 2 passed, 3 failed, 0 skipped", said)
        self.assertEqual(self.log("next"), "a fresh machine\n")


if __name__ == "__main__":
    unittest.main()
