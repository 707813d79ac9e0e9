// The service worker: it keeps the page on the device, and tells when the robot has a newer one.
import { signal } from "@preact/signals";

/** A newer page is there and waits. */
export const updateReady = signal(false);
let waiting: ServiceWorker | null = null;

export async function install(): Promise<void> {
  if (!("serviceWorker" in navigator)) return;
  const had = navigator.serviceWorker.controller !== null;
  try {
    const registration = await navigator.serviceWorker.register("/sw.js");
    const seen = (worker: ServiceWorker | null) => {
      if (!worker) return;
      const ready = () => {
        if (worker.state !== "installed" || !had) return;
        waiting = worker;
        updateReady.value = true;
      };
      ready();
      worker.addEventListener("statechange", ready);
    };
    seen(registration.waiting);
    registration.addEventListener("updatefound", () => seen(registration.installing));
  } catch {
    // Without it the page works as long as the robot serves it.
  }
}

export function applyUpdate(): void {
  navigator.serviceWorker.addEventListener("controllerchange", () => location.reload());
  waiting?.postMessage("take over");
}
