// Names and addresses of recorded runs.
import { day } from "../../format";

/** A run's name, which is when it began, as people write it; another name as it is. */
export function started(run: string): string {
  const parts = /^(\d{4})_(\d\d)_(\d\d)_(\d\d)_(\d\d)_(\d\d)(.*)$/.exec(run);
  if (!parts) return run;
  const [, year, month, date, hour, minute, second, rest] = parts;
  return `${day(Number(year), Number(month), Number(date))} ${hour}:${minute}:${second}${rest ? ` (${rest.replace(/^[_-]/, "")})` : ""}`;
}

/** When a run began, s since the UNIX epoch: its name is the time in UTC. NaN for another name. */
export function begun(run: string): number {
  const parts = /^(\d{4})_(\d\d)_(\d\d)_(\d\d)_(\d\d)_(\d\d)/.exec(run)?.slice(1).map(Number);
  if (!parts) return NaN;
  const [year, month, day, hour, minute, second] = parts as [number, number, number, number, number, number];
  return Date.UTC(year, month - 1, day, hour, minute, second) / 1000;
}

/** Where a file of a run is. Folders in its name stay folders. */
export function fileLink(run: string, file: string): string {
  return `/api/logs/${encodeURIComponent(run)}/${file.split("/").map(encodeURIComponent).join("/")}`;
}

/** The picture of a run. */
export function reportLink(run: string): string {
  return `/api/runs/${encodeURIComponent(run)}/report.png`;
}

/** A run in figures. */
export function summaryLink(run: string): string {
  return `/api/runs/${encodeURIComponent(run)}/summary`;
}

/** This page, playing a run. */
export function demoLink(run: string): string {
  return `/?demo=${encodeURIComponent(run)}#/map`;
}
