// A QR code as the path of a picture: a square of its own for each row of dark modules. Pure.

/** Modules that stay light around it, as the standard demands. */
export const MARGIN = 4;

/** Rows of `0` and `1` (dark), as the robot sends them: the path, and the length of a side with its margin, in modules. */
export function outline(rows: readonly string[]): { path: string; side: number } {
  const path = rows.flatMap((row, y) => [...row.matchAll(/1+/g)].map(({ 0: dark, index }) => `M${index + MARGIN} ${y + MARGIN}h${dark.length}v1h-${dark.length}z`));
  return { path: path.join(""), side: rows.length + 2 * MARGIN };
}
