// What the map shows, each on or off; kept on this device.
import { signal } from "@preact/signals";

export const LAYERS = ["persons", "people", "truth", "plan", "obstacles", "fields", "scan", "sonar", "floor", "beacons", "trail"] as const;
export type Layer = (typeof LAYERS)[number];

/** The fans of the sonars cover the plan. */
const OFF: readonly Layer[] = ["sonar"];
const KEY = "advee-layers-off";

/** Those that are off, from what was kept; `null` or nonsense: as at first. */
export function offFrom(kept: string | null): ReadonlySet<Layer> {
  if (kept === null) return new Set(OFF);
  const names = kept.split(",");
  return new Set(LAYERS.filter((layer) => names.includes(layer)));
}

function kept(): string | null {
  try {
    return localStorage.getItem(KEY);
  } catch {
    return null;
  }
}

export const off = signal<ReadonlySet<Layer>>(offFrom(globalThis.localStorage ? kept() : null));

export const isOn = (layer: Layer): boolean => !off.value.has(layer);

export function toggle(layer: Layer): void {
  const next = new Set(off.value);
  if (!next.delete(layer)) next.add(layer);
  off.value = next;
  try {
    localStorage.setItem(KEY, [...next].join(","));
  } catch {
    // A browser that keeps nothing: until the page is left.
  }
}
