// How the page begins: who we are, a code in the address, the sockets.
import { closeCommand, openCommand } from "./connection/command";
import { closeView, openView } from "./connection/view";
import { codeOf, learn, session } from "./access/pairing";
import { effect } from "@preact/signals";
import { install } from "./shell/update";
import { me, recorded, tick, viewLink } from "./state";

/** ms until it is asked again who we are, while there is no answer. */
const AGAIN = 1000;

export async function start(): Promise<void> {
  tick();
  codeOf(location);
  if (DEV && new URLSearchParams(location.search).has("fixture")) {
    (await import("./fixture")).begin();
    return;
  }
  // Who we are decides what there is to see: both sockets are opened when that is known, and anew when it changes.
  let as = "";
  effect(() => {
    const role = me.value?.role ?? "nobody";
    const is = `${role} ${session.value}`;
    if (is === as) return;
    as = is;
    queueMicrotask(() => {
      if (role === "nobody") return closeView(), closeCommand();
      openView();
      if (!recorded) openCommand();
    });
  });
  // A socket that does not open may be one that is not for us any more: an engineer may have forgotten this device.
  effect(() => {
    if (!viewLink.value.open && me.peek() !== null) void learn();
  });
  void ask();
  if (!DEV) void install();
}

async function ask(): Promise<void> {
  if (!(await learn())) setTimeout(ask, AGAIN);
}
