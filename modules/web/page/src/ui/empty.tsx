// What stands where there is nothing to show, and why.
import type { ComponentChildren } from "preact";

export function Empty({ children }: { children: ComponentChildren }) {
  return <p class="empty">{children}</p>;
}
