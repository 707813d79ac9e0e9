// The latest messages in order of time, beside every view: what began, what happened, what was commanded. What goes on for
// hours is one old line.
import { signal } from "@preact/signals";
import { Pause, Play, X } from "lucide-preact";
import { useEffect } from "preact/hooks";
import { ALL, watch } from "../connection/view";
import { bytes, span, time } from "../format";
import { choose } from "../panels/messages/store";
import type { RecentPart, RecentRow } from "../protocol";
import { connection, recent, recorded } from "../state";
import { Button, Empty } from "../ui";
import { t } from "../words";

const KEY = "advee-recent";
/** A series goes on while its last message is not older than this, s. */
const GOES_ON = 1.5;

function kept(): boolean {
  try {
    return localStorage.getItem(KEY) === "shown";
  } catch {
    return false;
  }
}

/** It is shown; kept on this device. */
export const recentShown = signal(kept());

export function toggleRecent(): void {
  recentShown.value = !recentShown.value;
  try {
    localStorage.setItem(KEY, recentShown.value ? "shown" : "hidden");
  } catch {
    // A browser that keeps nothing: until the page is left.
  }
}

/** What is shown while the list is held; null: it follows. */
const held = signal<RecentPart | null>(null);
const filter = signal("");
/** What the wall clock is ahead of the messages' scale of time, s. */
let ahead: number | null = null;

/** Clock time of an instant of the part; of a recorded run, how long before its newest message. */
function moment(part: RecentPart, at: number): string {
  if (recorded) return span(part.at - at);
  const offset = Date.now() / 1000 - part.at;
  // The least delayed part tells best; a scale that began anew tells by a leap.
  if (part === recent.value) ahead = ahead === null || Math.abs(offset - ahead) > 5 ? offset : Math.min(ahead, offset);
  return time((at + (ahead ?? offset)) * 1e6);
}

export function Recent() {
  useEffect(() => watch(ALL), []);
  const part = held.value ?? recent.value;
  const words = filter.value.toLowerCase().split(/\s+/).filter(Boolean);
  const rows = part?.recent.filter((row) => words.every((word) => `${row.channel} ${row.words}`.toLowerCase().includes(word)));
  const label = t("Recent messages");
  return (
    <aside class="recent" aria-label={label}>
      <header>
        <h2>{label}</h2>
        {held.value ? (
          <Button kind="quiet" icon={Play} label={t("Follow")} onClick={() => (held.value = null)} />
        ) : (
          <Button kind="quiet" icon={Pause} label={t("Hold the list")} onClick={() => (held.value = recent.value)} />
        )}
        <Button kind="quiet" icon={X} label={t("Close")} onClick={toggleRecent} />
      </header>
      <label>
        <span class="visually-hidden">{t("Filter")}</span>
        <input type="search" value={filter.value} placeholder={t("Filter")} onInput={(event) => (filter.value = event.currentTarget.value)} />
      </label>
      {part && rows?.length ? (
        <ol class={connection.value.state === "lost" ? "is-stale" : ""} tabIndex={0} aria-label={label}>
          {rows.map((row) => (
            <Line key={`${row.channel} ${row.since}`} part={part} row={row} />
          ))}
        </ol>
      ) : (
        <Empty>{part?.recent.length ? t("None of them matches.") : t("No data yet.")}</Empty>
      )}
    </aside>
  );
}

function Line({ part, row }: { part: RecentPart; row: RecentRow }) {
  const goesOn = row.count > 1 && part.at - row.until < GOES_ON;
  return (
    <li class={goesOn ? "goes-on" : ""}>
      <p>
        <time>{moment(part, row.since)}</time>
        <button type="button" lang="en" title={t("Look at its fields")} onClick={() => look(row.channel)}>
          {row.channel}
        </button>
        {row.count > 1 ? <b>×{row.count}</b> : null}
      </p>
      <p class="muted" lang="en">
        {row.words || bytes(row.length)}
      </p>
    </li>
  );
}

function look(channel: string): void {
  choose(channel);
  location.hash = "#/messages";
}
