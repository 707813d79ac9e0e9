// Which of two axes a series belongs to. Pure.

export interface Axes {
  /** Of each series. */
  sides: ("left" | "right")[];
  /** What each axis is labelled with; empty: no unit, or several. Without a right one all series share the left one. */
  left: string;
  right: string | null;
}

/** Series of the first unit are on the left, those of all others on the right. */
export function axes(units: readonly string[]): Axes {
  const [first = "", ...others] = [...new Set(units)];
  return {
    sides: units.map((unit) => (unit === first ? "left" : "right")),
    left: first,
    right: others.length === 0 ? null : others.length === 1 ? (others[0] as string) : "",
  };
}
