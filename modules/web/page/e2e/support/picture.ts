// A picture of a page as a small PNG: 256 colours, which is what a page of flat colours has but for the edges of its letters.
import type { Page } from "playwright-core";
import { deflateSync } from "node:zlib";
import { chunk } from "../../icons.mjs";

/** Its pixels as numbers of colours, and those, red, green and blue each. */
interface Indexed {
  width: number;
  height: number;
  pixels: string;
  colours: number[];
}

/** `painter`: any page; its canvas unpacks and counts. */
export async function small(painter: Page, png: Buffer): Promise<Buffer> {
  const { width, height, pixels, colours } = await painter.evaluate(async (base64): Promise<Indexed> => {
    const image = await createImageBitmap(await (await fetch(`data:image/png;base64,${base64}`)).blob());
    const { width, height } = image;
    const on = new OffscreenCanvas(width, height).getContext("2d") as OffscreenCanvasRenderingContext2D;
    on.drawImage(image, 0, 0);
    const { data } = on.getImageData(0, 0, width, height);
    // The colours that are there most often, none nearer to one before it than a sixteenth of the range.
    const counts = new Map<number, number>();
    const at = (n: number) => ((data[4 * n] as number) << 16) | ((data[4 * n + 1] as number) << 8) | (data[4 * n + 2] as number);
    for (let n = 0; n < width * height; n += 1) counts.set(at(n), (counts.get(at(n)) ?? 0) + 1);
    const far = (a: number, b: number) => Math.abs((a >> 16) - (b >> 16)) + Math.abs(((a >> 8) & 255) - ((b >> 8) & 255)) + Math.abs((a & 255) - (b & 255));
    const chosen: number[] = [];
    for (const apart of [12, 0]) {
      for (const [colour, count] of [...counts].sort((a, b) => b[1] - a[1])) {
        if (chosen.length === 256) break;
        const common = count > (width * height) / 2000;
        if (!chosen.includes(colour) && (common || chosen.every((each) => far(each, colour) > apart))) chosen.push(colour);
      }
    }
    const nearest = new Map<number, number>();
    const bytes = new Uint8Array(width * height);
    for (let n = 0; n < bytes.length; n += 1) {
      const colour = at(n);
      let index = nearest.get(colour);
      if (index === undefined) {
        index = chosen.reduce((best, each, other) => (far(each, colour) < far(chosen[best] as number, colour) ? other : best), 0);
        nearest.set(colour, index);
      }
      bytes[n] = index;
    }
    let pixels = "";
    for (let n = 0; n < bytes.length; n += 8192) pixels += String.fromCharCode(...bytes.subarray(n, n + 8192));
    return { width, height, pixels: btoa(pixels), colours: chosen.flatMap((colour) => [colour >> 16, (colour >> 8) & 255, colour & 255]) };
  }, png.toString("base64"));
  const indices = Buffer.from(pixels, "base64");
  const rows = Buffer.alloc(height * (width + 1));
  for (let y = 0; y < height; y += 1) indices.copy(rows, y * (width + 1) + 1, y * width, (y + 1) * width);
  const head = Buffer.alloc(13);
  head.writeUInt32BE(width, 0);
  head.writeUInt32BE(height, 4);
  head.set([8, 3, 0, 0, 0], 8);
  const parts: [string, Buffer][] = [["IHDR", head], ["PLTE", Buffer.from(colours)], ["IDAT", deflateSync(rows, { level: 9 })], ["IEND", Buffer.alloc(0)]];
  return Buffer.concat([Buffer.from([0x89, 0x50, 0x4e, 0x47, 0x0d, 0x0a, 0x1a, 0x0a]), ...parts.map(([name, body]) => chunk(name, body))]);
}
