// How figures of machines are written; what all views share is in ../format.ts.
import { day, NONE, num, span, time, written } from "../format";
import { t } from "../words";

/** A share, 0..1. */
export function percent(value: number | null | undefined, digits = 0): string {
  return value === null || value === undefined ? NONE : num(100 * value, digits, "%");
}

/** A value and its limit, where it has one: `36.0 of 60 °C`. */
export function against(value: number | null, limit: number | undefined, unit: string): string {
  return limit === undefined ? num(value, 1, unit) : t("{value} of {limit}", { value: num(value, 1), limit: num(limit, 0, unit) });
}

/** s as milliseconds, without the unit. */
export function milliseconds(seconds: number | null | undefined): string {
  return seconds === null || seconds === undefined ? NONE : num(1e3 * seconds, 1);
}

/** 0x and at least so many digits; a negative number is the two's complement of so many. */
export function hex(value: number, digits = 4): string {
  const wrapped = value < 0 ? value + 16 ** digits : value;
  return `0x${Math.trunc(wrapped).toString(16).toUpperCase().padStart(digits, "0")}`;
}

/** A whole number in groups of three. */
export function count(value: number | null | undefined): string {
  if (value === null || value === undefined || !Number.isFinite(value)) return NONE;
  return Math.round(value)
    .toString()
    .replace(/\B(?=(\d{3})+$)/g, "\u202F");
}

/** Microseconds since the UNIX epoch as the time of day, with the date before it where that is not today's. */
export function moment(microseconds: number, now = new Date()): string {
  const at = new Date(microseconds / 1000);
  if (microseconds <= 0 || Number.isNaN(at.getTime())) return NONE;
  if (at.toDateString() === now.toDateString()) return time(microseconds);
  return `${day(at.getFullYear(), at.getMonth() + 1, at.getDate())} ${time(microseconds)}`;
}

/** s as hours and whole minutes, as one counts what a battery lasts. */
export function minutes(seconds: number | null | undefined): string {
  if (seconds === null || seconds === undefined || !Number.isFinite(seconds) || seconds < 0) return t("not known");
  return seconds < 60 ? t("less than a minute") : span(60 * Math.floor(seconds / 60));
}

/** Any number, with as many digits as tell. */
export function figure(value: number): string {
  const size = Math.abs(value);
  const rounded = Number(value.toPrecision(6));
  const text = size !== 0 && (size >= 1e6 || size < 1e-3) ? rounded.toExponential() : String(rounded);
  return written(text).replaceAll("-", "−");
}
