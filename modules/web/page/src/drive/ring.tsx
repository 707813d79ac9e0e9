// The proximity ring around the knob, and the nearest distance in figures, of sonars and lidars: the robot looks up, as the
// pad drives.
import { useEffect } from "preact/hooks";
import { num } from "../format";
import { sonars } from "../panels/sensors/readings";
import { drive, fresh, scene, sensors, stale } from "../state";
import { t } from "../words";
import { beams, type Level, nearest, ring, SECTORS } from "./near";
import { commanded } from "./session";

/** ms of the vibration when something comes into the way that the robot needs to stop. */
const PULSE = 40;
/** Half of the gap between two arcs, rad; the radius, of a picture from -50 to 50. */
const GAP = 0.05;
const RADIUS = 37;

function soundings() {
  const part = sensors.value;
  if (!part || !scene.value) return null;
  const { outline, sonar } = scene.value;
  const { shown, rows } = sonars(part, sonar.field_of_view);
  const seen = part.scans.flatMap((scan) => (scan.value ? beams(scan.value, !stale(scan) && scan.value.status === 0, outline) : []));
  if (rows === undefined && part.scans.length === 0) return null;
  const guard = fresh(drive.value?.guard);
  return { grey: rows !== undefined && stale(shown), rows: [...(rows ?? []), ...seen], fields: guard && drive.value?.bound ? guard.fields : null };
}

export function Ring() {
  const all = soundings();
  if (!all || all.grey) return null;
  return (
    <svg class="ring" viewBox="-50 -50 100 100" aria-hidden>
      {ring(all.rows, all.fields).map((level, n) => (level === null ? null : <path key={n} class={`ring-${level}`} d={arc(n)} />))}
    </svg>
  );
}

function arc(n: number): string {
  const step = (2 * Math.PI) / SECTORS;
  const at = (angle: number) => `${(-RADIUS * Math.sin(angle)).toFixed(2)} ${(-RADIUS * Math.cos(angle)).toFixed(2)}`;
  return `M${at((n - 0.5) * step + GAP)}A${RADIUS} ${RADIUS} 0 0 0 ${at((n + 0.5) * step - GAP)}`;
}

const WORDS: Record<Level, string> = { free: "", unknown: "?", near: "!", close: "‼" };

/** The nearest that is measured, and how many directions are not known. */
export function Nearest() {
  const all = soundings();
  const found = all && !all.grey ? nearest(all.rows, all.fields) : null;
  const level = found?.level ?? "free";
  const drives = commanded.value !== null;
  useEffect(() => {
    if (level === "close" && drives) navigator.vibrate?.(PULSE);
  }, [level, drives]);
  if (!all) return null;
  const unknown = all.rows.filter(({ known }) => known === "unknown").length;
  const nothing = all.grey || (unknown > 0 && unknown === all.rows.length);
  return (
    <p class={`nearest figure tone-${level === "close" ? "bad" : level === "near" ? "warn" : "off"}`}>
      {nothing ? t("Range finders not known") : found ? `${WORDS[level]} ${num(found.distance, 2, "m")} ${t(found.side)}` : t("Nothing within range")}
      {!nothing && unknown > 0 ? <b class="tone-bad"> · {t("{n} not known", { n: unknown })}</b> : null}
    </p>
  );
}
