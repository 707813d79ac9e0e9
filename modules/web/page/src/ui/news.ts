// Short news: kept here, shown by Toasts.
import { signal } from "@preact/signals";
import type { Tone } from "./badge";

/** What may be done about it. */
export interface Offer {
  label: string;
  run: () => void;
}

interface News {
  id: number;
  tone: Tone;
  text: string;
  offer?: Offer | undefined;
}
export const news = signal<News[]>([]);
let number = 0;

/** ms; good news is short; how many there are at most. */
const STAYS = 6000;
const STAYS_GOOD = 3500;
const MOST = 4;

/** Says it at the edge of the screen; bad news stays until it is closed. */
export function toast(text: string, tone: Tone = "info", offer?: Offer): void {
  const same = news.value.find((each) => each.text === text);
  if (same) close(same.id);
  const id = ++number;
  news.value = [...news.value, { id, tone, text, offer }].slice(-MOST);
  if (tone !== "bad") setTimeout(() => close(id), tone === "good" ? STAYS_GOOD : STAYS);
}

export function close(id: number): void {
  news.value = news.value.filter((each) => each.id !== id);
}
