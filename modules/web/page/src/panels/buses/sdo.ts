// What stands in an object of a CANopen dictionary: bytes to values and back, and the objects one asks for by name.

export const TYPES = ["u8", "i8", "u16", "i16", "u32", "i32", "u64", "i64", "f32", "text", "hex"] as const;
export type Type = (typeof TYPES)[number];

const SIZES: Readonly<Record<Exclude<Type, "text" | "hex">, number>> = {
  u8: 1,
  i8: 1,
  u16: 2,
  i16: 2,
  u32: 4,
  i32: 4,
  u64: 8,
  i64: 8,
  f32: 4,
};

/** Longest that fits a command (4 KiB of JSON) with room to spare, bytes. */
export const DATA_MAX = 1024;

/** Hexadecimal to bytes; blanks are ignored, null when it is none. */
export function fromHex(text: string): Uint8Array | null {
  const digits = text.replace(/^0x/i, "").replace(/[\s:]/g, "");
  if (digits.length % 2 || !/^[0-9a-f]*$/i.test(digits)) return null;
  return Uint8Array.from({ length: digits.length / 2 }, (_, n) => parseInt(digits.slice(2 * n, 2 * n + 2), 16));
}

export function toHex(data: Uint8Array, separator = ""): string {
  return Array.from(data, (byte) => byte.toString(16).padStart(2, "0")).join(separator);
}

/** What the bytes mean as that type; null when they are too few or too many. */
export function interpret(data: Uint8Array, type: Type): string | null {
  if (type === "hex") return toHex(data, " ").toUpperCase();
  if (type === "text") {
    const end = data.indexOf(0);
    const text = new TextDecoder("utf-8", { fatal: false }).decode(end < 0 ? data : data.subarray(0, end));
    return text.replace(/[\u0000-\u001f\u007f]/g, "·");
  }
  if (data.length !== SIZES[type]) return null;
  const view = new DataView(data.buffer, data.byteOffset, data.length);
  switch (type) {
    case "u8":
      return String(view.getUint8(0));
    case "i8":
      return String(view.getInt8(0));
    case "u16":
      return String(view.getUint16(0, true));
    case "i16":
      return String(view.getInt16(0, true));
    case "u32":
      return String(view.getUint32(0, true));
    case "i32":
      return String(view.getInt32(0, true));
    case "u64":
      return String(view.getBigUint64(0, true));
    case "i64":
      return String(view.getBigInt64(0, true));
    case "f32":
      return String(Number(view.getFloat32(0, true).toPrecision(7)));
  }
}

/** Bounds of what somebody stores as a floating-point number; beyond them four bytes are hardly one. */
const FLOAT = { least: 1e-6, most: 1e9 };

function likely(type: Type, value: string): boolean {
  if (type === "text") return /^[\x20-\x7e]+$/.test(value);
  const size = Math.abs(Number(value));
  return type !== "f32" || (size >= FLOAT.least && size <= FLOAT.most);
}

/** All that the bytes may well mean. */
export function interpretations(data: Uint8Array): { type: Type; value: string }[] {
  return TYPES.flatMap((type) => {
    const value = interpret(data, type);
    return value === null || !likely(type, value) ? [] : [{ type, value }];
  });
}

/** What was written as that type, as bytes, or why it cannot be. Whole numbers decimal or 0x. */
export function encode(text: string, type: Type): { data: Uint8Array } | { why: string } {
  if (type === "hex") {
    const data = fromHex(text);
    if (!data || data.length === 0) return { why: "Pairs of hexadecimal digits are expected." };
    return bounded(data);
  }
  if (type === "text") {
    const data = new TextEncoder().encode(text);
    return data.length ? bounded(data) : { why: "Some text is expected." };
  }
  const size = SIZES[type];
  const data = new Uint8Array(size);
  const view = new DataView(data.buffer);
  const word = text.trim().replace("−", "-");
  if (type === "f32") {
    const value = Number(word);
    if (word === "" || !Number.isFinite(Math.fround(value))) return { why: "A number is expected." };
    view.setFloat32(0, value, true);
    return { data };
  }
  if (!/^(-?\d+|0x[0-9a-f]+)$/i.test(word)) return { why: "A whole number is expected, decimal or 0x and hexadecimal." };
  const value = BigInt(word);
  const bits = BigInt(8 * size);
  const signed = type.startsWith("i");
  const low = signed ? -(1n << (bits - 1n)) : 0n;
  const high = signed ? (1n << (bits - 1n)) - 1n : (1n << bits) - 1n;
  if (value < low || value > high) return { why: `${type} holds ${low} to ${high}.` };
  const raw = BigInt.asUintN(Number(bits), value);
  for (let n = 0; n < size; n++) data[n] = Number((raw >> BigInt(8 * n)) & 0xffn);
  return { data };
}

function bounded(data: Uint8Array): { data: Uint8Array } | { why: string } {
  return data.length <= DATA_MAX ? { data } : { why: `At most ${DATA_MAX} bytes.` };
}

/** A number between the bounds, decimal or 0x; null when it is none. */
export function wholeNumber(text: string, low: number, high: number): number | null {
  const word = text.trim();
  if (!/^(\d+|0x[0-9a-f]+)$/i.test(word)) return null;
  const value = Number(word);
  return value >= low && value <= high ? value : null;
}

/** An index is always hexadecimal, with or without 0x. */
export function index(text: string): number | null {
  const word = text.trim().replace(/^0x/i, "");
  return /^[0-9a-f]{1,4}$/i.test(word) ? parseInt(word, 16) : null;
}

export interface Known {
  index: number;
  subindex: number;
  type: Type;
  name: string;
  writable: boolean;
}

/** Objects that most drives have (CiA 301 7.5.2, CiA 402-2). */
export const OBJECTS: readonly Known[] = [
  { index: 0x1000, subindex: 0, type: "u32", name: "Device type", writable: false },
  { index: 0x1001, subindex: 0, type: "u8", name: "Error register", writable: false },
  { index: 0x1003, subindex: 0, type: "u8", name: "Errors remembered", writable: true },
  { index: 0x1003, subindex: 1, type: "u32", name: "Latest error", writable: false },
  { index: 0x1008, subindex: 0, type: "text", name: "Device name", writable: false },
  { index: 0x1009, subindex: 0, type: "text", name: "Hardware version", writable: false },
  { index: 0x100a, subindex: 0, type: "text", name: "Software version", writable: false },
  { index: 0x1016, subindex: 1, type: "u32", name: "Heartbeat watched", writable: true },
  { index: 0x1017, subindex: 0, type: "u16", name: "Heartbeat period, ms", writable: true },
  { index: 0x1018, subindex: 1, type: "u32", name: "Vendor", writable: false },
  { index: 0x1018, subindex: 2, type: "u32", name: "Product", writable: false },
  { index: 0x1018, subindex: 3, type: "u32", name: "Revision", writable: false },
  { index: 0x1018, subindex: 4, type: "u32", name: "Serial number", writable: false },
  { index: 0x603f, subindex: 0, type: "u16", name: "Error code", writable: false },
  { index: 0x6040, subindex: 0, type: "u16", name: "Controlword", writable: true },
  { index: 0x6041, subindex: 0, type: "u16", name: "Statusword", writable: false },
  { index: 0x6060, subindex: 0, type: "i8", name: "Mode of operation", writable: true },
  { index: 0x6061, subindex: 0, type: "i8", name: "Mode shown", writable: false },
  { index: 0x6064, subindex: 0, type: "i32", name: "Position", writable: false },
  { index: 0x606c, subindex: 0, type: "i32", name: "Velocity", writable: false },
  { index: 0x6078, subindex: 0, type: "i16", name: "Current", writable: false },
  { index: 0x607a, subindex: 0, type: "i32", name: "Target position", writable: true },
  { index: 0x607d, subindex: 1, type: "i32", name: "Lower position limit", writable: true },
  { index: 0x607d, subindex: 2, type: "i32", name: "Upper position limit", writable: true },
  { index: 0x6083, subindex: 0, type: "u32", name: "Acceleration", writable: true },
  { index: 0x6084, subindex: 0, type: "u32", name: "Deceleration", writable: true },
  { index: 0x6085, subindex: 0, type: "u32", name: "Quick stop deceleration", writable: true },
  { index: 0x6098, subindex: 0, type: "i8", name: "Homing method", writable: true },
  { index: 0x60ff, subindex: 0, type: "i32", name: "Target velocity", writable: true },
  { index: 0x6502, subindex: 0, type: "u32", name: "Modes supported", writable: false },
];

export function known(index: number, subindex: number): Known | undefined {
  return OBJECTS.find((object) => object.index === index && object.subindex === subindex);
}
