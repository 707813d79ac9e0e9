// How near is near: what needs a look, and what needs one at once.
import type { Sounding } from "./readings";

export type Near = "close" | "near" | "far";

/** By the distance that a ranger measured, m. */
export function near(distance: number): Near {
  return distance < 0.5 ? "close" : distance < 1 ? "near" : "far";
}

/** Marks beside the figure, so that it is not told by the colour alone. */
export const GLYPHS: Readonly<Record<Near, string>> = { close: "‼", near: "!", far: "" };

/** Infrared rangers look at the floor: nearer or farther, m, and the board pulls the PAUSE line (docs/facts/boards.md). */
const FLOOR = { least: 0.08, most: 0.2 };

export type Floor = "floor" | "hole" | "unknown";

/** Whether an infrared ranger sees the floor where it should be. */
export function floor({ known, distance }: Pick<Sounding, "known" | "distance">): Floor {
  if (known === "unknown") return "unknown";
  return distance !== null && distance >= FLOOR.least && distance <= FLOOR.most ? "floor" : "hole";
}
