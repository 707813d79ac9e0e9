// What the table and the dialog say of a module in the same words.
import type { ModuleRow } from "../../protocol";
import { since, system } from "../../state";
import { Badge, type Tone } from "../../ui";
import { t } from "../../words";
import { said } from "../../words/said";
import { lost } from "../lacks";

/** It announces itself each second; older than twice that it is stale. */
const ANNOUNCED = 2;

/** s since a module announced itself, grown by the time since it was sent; null: never. */
export function announced(row: ModuleRow): number | null {
  return row.age === null || !system.value ? row.age : row.age + since(system.value);
}

/** By when it was sent: until the next row comes nothing newer can be known of it. */
export const isStale = (row: ModuleRow): boolean => lost() || (row.age ?? Infinity) > ANNOUNCED;

/** It is what it was told to be: also ended, where that was the command. */
export const asWanted = (row: ModuleRow): boolean => row.well || (row.wanted === "TERMINATE" && row.phase === "down");

function tone(row: ModuleRow): Tone {
  if (!asWanted(row)) return "bad";
  if (row.state === "RUN") return "good";
  return row.state === "PAUSE" || row.state === "STOP" ? "warn" : "off";
}

/** What it is, and what it should be where that is something else. */
export function State({ row }: { row: ModuleRow }) {
  if (!row.well && asWanted(row)) return <Badge tone="off">{t("ended as commanded")}</Badge>;
  const differs = row.wanted !== "" && row.wanted !== row.state;
  return (
    <span class="p-state">
      <Badge tone={tone(row)}>{row.state}</Badge>
      {differs ? <span class="p-wanted">{t("wanted {state}", { state: row.wanted })}</span> : null}
    </span>
  );
}

/** How its last process ended, in words. */
export const lastExit = (row: ModuleRow): string => (row.last_exit ? said(row.last_exit) : "–");

/** What a process does, in words. */
export function phase(row: ModuleRow): string {
  return row.phase === "stranger" ? t("not supervised") : said(row.phase);
}
