/** An icon of so many px each side, as PNG. */
export function png(size: number): Buffer;
/** A part of a PNG, with its length and check. */
export function chunk(name: string, data: Buffer): Buffer;
