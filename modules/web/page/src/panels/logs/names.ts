// Names and addresses of recorded runs.

/** A run's name, which is when it began, as people write it; another name as it is. */
export function started(run: string): string {
  const parts = /^(\d{4})_(\d\d)_(\d\d)_(\d\d)_(\d\d)_(\d\d)(.*)$/.exec(run);
  if (!parts) return run;
  const [, year, month, day, hour, minute, second, rest] = parts;
  return `${year}-${month}-${day} ${hour}:${minute}:${second}${rest ? ` (${rest.replace(/^[_-]/, "")})` : ""}`;
}

/** Where a file of a run is. Folders in its name stay folders. */
export function fileLink(run: string, file: string): string {
  return `/api/logs/${encodeURIComponent(run)}/${file.split("/").map(encodeURIComponent).join("/")}`;
}

/** This page, playing a run. */
export function demoLink(run: string): string {
  return `/?demo=${encodeURIComponent(run)}#/map`;
}
