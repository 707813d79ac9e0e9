// How near is near: what needs a look, and what needs one at once.
import type { Range } from "../../protocol";

export type Near = "close" | "near" | "far";

/** By the distance that a ranger measured, m. */
export function near(distance: number): Near {
  return distance < 0.5 ? "close" : distance < 1 ? "near" : "far";
}

/** Marks beside the figure, so that it is not told by the colour alone. */
export const GLYPHS: Readonly<Record<Near, string>> = { close: "‼", near: "!", far: "" };

/** The distance, m; null where nothing was heard. */
export function measured(range: Range): number | null {
  return range.valid ? range.distance : null;
}

/** Infrared rangers look at the floor: nearer or farther, m, and the board pulls the PAUSE line (docs/facts/boards.md). */
const FLOOR = { least: 0.08, most: 0.2 };

/** Whether an infrared ranger sees the floor where it should be. */
export function floor(range: Range): boolean {
  const distance = measured(range);
  return distance !== null && distance >= FLOOR.least && distance <= FLOOR.most;
}
