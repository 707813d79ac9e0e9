// The unit of a field, behind its value.
import { unit } from "./tree";

export function Unit({ type, path }: { type: string; path: string }) {
  const text = unit(type, path);
  return text ? <span class="p-unit">{text}</span> : null;
}
