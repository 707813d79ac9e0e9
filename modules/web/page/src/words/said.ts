// What is kept in English, by the page or as the robot's web server said it, in the language of the page when it is shown.
import type { HoldRow } from "../protocol";
import { drive } from "../state";
import { words } from "./language";

/** A text of the page or of the web server; what is not known in the language of the page stays as it is. */
export function said(text: string): string {
  const other = words.value;
  if (other === null || text === "") return text;
  const own = (other.texts as Readonly<Record<string, string>>)[text];
  return own ?? held(text) ?? other.robot(text, said) ?? text;
}

/** A cause for which the robot does not act, alone or with more after it, such as an error code. */
function held(text: string): string | null {
  const row = drive.value?.holds.find(({ words }) => words !== "" && text.startsWith(words));
  const known = row && words.value?.hold(row);
  if (!row || !known) return null;
  const rest = text.slice(row.words.length);
  return `${known.words}${rest === "" ? "" : (words.value?.robot(rest, said) ?? rest)}`;
}

/** Sentence of a cause. */
export const holdWords = (row: HoldRow): string => words.value?.hold(row)?.words ?? row.words;
/** What to do about a cause; empty: not known. */
export const holdRemedy = (row: HoldRow): string => words.value?.hold(row)?.remedy ?? row.remedy;
/** The subject of a cause as people call it. */
export const holdWho = (row: HoldRow): string => words.value?.hold(row)?.who ?? row.who;
