// How values are written: a number with its unit, an angle, an age, a size. Null and NaN are a dash.
export const NONE = "–";

/** `num(1.234, 2, "m/s")` is `1.23 m/s`. */
export function num(value: number | null | undefined, digits = 1, unit = ""): string {
  if (value === null || value === undefined || !Number.isFinite(value)) return NONE;
  const text = value.toFixed(digits);
  // No "-0.0".
  const shown = Number(text) === 0 ? text.replace("-", "") : text.replace("-", "−");
  return unit ? `${shown} ${unit}` : shown;
}

/** An angle in radians, written in degrees. */
export function deg(value: number | null | undefined, digits = 0): string {
  return value === null || value === undefined ? NONE : num((value * 180) / Math.PI, digits) + "°";
}

/** A time span in s, in its two greatest units: `4.2 s`, `2 min 5 s`, `3 h 20 min`, `2 d 1 h`. */
export function span(seconds: number | null | undefined): string {
  if (seconds === null || seconds === undefined || !Number.isFinite(seconds)) return NONE;
  if (seconds < 0.95) return `${Math.round(seconds * 10) / 10} s`;
  if (seconds < 10) return `${num(seconds, 1)} s`;
  const s = Math.round(seconds);
  if (s < 60) return `${s} s`;
  if (s < 3600) return two(s, 60, "min", "s");
  if (s < 86400) return two(Math.round(s / 60), 60, "h", "min");
  return two(Math.round(s / 3600), 24, "d", "h");
}

function two(value: number, each: number, great: string, small: string): string {
  const rest = value % each;
  return `${Math.floor(value / each)} ${great}${rest ? ` ${rest} ${small}` : ""}`;
}

/** `1.2 kB`, `34 MB`. */
export function bytes(count: number | null | undefined): string {
  if (count === null || count === undefined || !Number.isFinite(count)) return NONE;
  const units = ["B", "kB", "MB", "GB", "TB"];
  let value = count;
  let unit = 0;
  while (value >= 999.5 && unit < units.length - 1) {
    value /= 1000;
    unit += 1;
  }
  return `${unit === 0 || value >= 99.5 ? Math.round(value) : value.toFixed(1)} ${units[unit]}`;
}

/** The time of day of a message's timestamp, microseconds since the UNIX epoch, as clocks here show it. */
export function time(micros: number): string {
  return new Date(micros / 1000).toLocaleTimeString([], { hour: "2-digit", minute: "2-digit", second: "2-digit" });
}
