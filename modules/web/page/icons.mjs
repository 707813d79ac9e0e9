// The icon as PNG, drawn from the same figures as src/icon.svg: a robot seen from above, its nose, and its two arcs of
// sight. Our own encoder: pixels, filtered by nothing, deflated.
import * as zlib from "node:zlib";

const BACK = [13, 59, 102];
const LINE = [244, 211, 94];
const BODY = [255, 255, 255];

/** Signed distance to a box with round corners, its middle at (x, y). */
const box = (px, py, x, y, w, h, r) => {
  const dx = Math.abs(px - x) - w / 2 + r;
  const dy = Math.abs(py - y) - h / 2 + r;
  return Math.hypot(Math.max(dx, 0), Math.max(dy, 0)) + Math.min(Math.max(dx, dy), 0) - r;
};
/** To an arc of `angle` either side of straight up, around (x, y). */
const arc = (px, py, x, y, radius, angle, width) => {
  const a = Math.atan2(px - x, y - py);
  if (Math.abs(a) <= angle) return Math.abs(Math.hypot(px - x, py - y) - radius) - width / 2;
  const end = Math.sign(a) * angle;
  return Math.hypot(px - x - radius * Math.sin(end), py - y + radius * Math.cos(end)) - width / 2;
};

/** What is drawn on the ground, later over earlier: colour, and distance to it in the icon's 64 units. */
const SHAPES = [
  [LINE, (x, y) => arc(x, y, 32, 34, 23, 0.75, 3.4)],
  [LINE, (x, y) => arc(x, y, 32, 34, 16.5, 0.75, 3.4)],
  [BODY, (x, y) => box(x, y, 32, 39, 20, 26, 5)],
  [BACK, (x, y) => box(x, y, 32, 31.5, 11, 3.4, 1.7)],
];

export function png(size) {
  const rows = Buffer.alloc(size * (1 + 3 * size));
  const unit = 64 / size;
  for (let row = 0; row < size; row++) {
    for (let column = 0; column < size; column++) {
      let colour = BACK;
      for (const [ink, distance] of SHAPES) {
        // Half a pixel of soft edge.
        const cover = Math.min(1, Math.max(0, 0.5 - distance((column + 0.5) * unit, (row + 0.5) * unit) / unit));
        colour = colour.map((old, i) => old + (ink[i] - old) * cover);
      }
      colour.forEach((value, i) => (rows[row * (1 + 3 * size) + 1 + 3 * column + i] = Math.round(value)));
    }
  }
  const head = Buffer.alloc(13);
  head.writeUInt32BE(size, 0);
  head.writeUInt32BE(size, 4);
  head.set([8, 2, 0, 0, 0], 8);
  return Buffer.concat([Buffer.from("89504e470d0a1a0a", "hex"), chunk("IHDR", head), chunk("IDAT", zlib.deflateSync(rows, { level: 9 })), chunk("IEND", Buffer.alloc(0))]);
}

export function chunk(name, data) {
  const length = Buffer.alloc(4);
  length.writeUInt32BE(data.length);
  const body = Buffer.concat([Buffer.from(name, "latin1"), data]);
  const sum = Buffer.alloc(4);
  sum.writeUInt32BE(crc32(body));
  return Buffer.concat([length, body, sum]);
}

/** node's own where it has one (20.15 on). */
function crc32(data) {
  if (zlib.crc32) return zlib.crc32(data);
  let crc = 0xffffffff;
  for (const byte of data) {
    crc ^= byte;
    for (let bit = 0; bit < 8; bit++) crc = crc & 1 ? (crc >>> 1) ^ 0xedb88320 : crc >>> 1;
  }
  return (crc ^ 0xffffffff) >>> 0;
}
