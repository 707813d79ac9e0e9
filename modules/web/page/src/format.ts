// How values are written in the language of the page: a number with its unit, an angle, an age, a size. Null and NaN are a dash.
import { language, words } from "./words/language";

export const NONE = "–";

/** A number as the language writes it. */
export const written = (text: string): string => text.replace(".", words.value?.point ?? ".");
/** With its unit. */
export const united = (figure: string | number, unit: string): string => `${figure}${words.value?.blank ?? " "}${unit}`;

/** `num(1.234, 2, "m/s")` is `1.23 m/s`. */
export function num(value: number | null | undefined, digits = 1, unit = ""): string {
  if (value === null || value === undefined || !Number.isFinite(value)) return NONE;
  const text = value.toFixed(digits);
  // No "-0.0".
  const shown = written(Number(text) === 0 ? text.replace("-", "") : text.replace("-", "−"));
  return unit ? united(shown, unit) : shown;
}

/** An angle in radians, written in degrees. */
export function deg(value: number | null | undefined, digits = 0): string {
  return value === null || value === undefined ? NONE : num((value * 180) / Math.PI, digits) + "°";
}

/** A time span in s, in its two greatest units: `4.2 s`, `2 min 5 s`, `3 h 20 min`, `2 d 1 h`. */
export function span(seconds: number | null | undefined): string {
  if (seconds === null || seconds === undefined || !Number.isFinite(seconds)) return NONE;
  if (seconds < 0.95) return united(written(String(Math.round(seconds * 10) / 10)), "s");
  if (seconds < 10) return num(seconds, 1, "s");
  const s = Math.round(seconds);
  if (s < 60) return united(s, "s");
  if (s < 3600) return two(s, 60, "min", "s");
  if (s < 86400) return two(Math.round(s / 60), 60, "h", "min");
  return two(Math.round(s / 3600), 24, "d", "h");
}

function two(value: number, each: number, great: string, small: string): string {
  const rest = value % each;
  return `${united(Math.floor(value / each), great)}${rest ? ` ${united(rest, small)}` : ""}`;
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
  return united(written(unit === 0 || value >= 99.5 ? String(Math.round(value)) : value.toFixed(1)), units[unit] ?? "");
}

/** The time of day of a message's timestamp, microseconds since the UNIX epoch, as clocks here show it. */
export function time(micros: number): string {
  return new Date(micros / 1000).toLocaleTimeString(language.value === "en" ? [] : language.value, { hour: "2-digit", minute: "2-digit", second: "2-digit" });
}

/** A day of the calendar: `2026-05-17`, or as the language has it. */
export function day(year: number, month: number, of: number): string {
  const two = (value: number) => String(value).padStart(2, "0");
  return words.value?.day(year, month, of) ?? `${year}-${two(month)}-${two(of)}`;
}
