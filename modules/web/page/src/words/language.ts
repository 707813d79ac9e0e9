// The language of the page: as the browser says, or as chosen on this device. English is in the code; another language is a
// file of its own, which is loaded when it is chosen.
import { computed, effect, signal } from "@preact/signals";
import type { HoldRow } from "../protocol";
import type { TEXTS } from "./cs/page";

/** Texts of the page, in English, as they are in its code. */
export type Text = keyof typeof TEXTS;

/** All that the page needs of a language other than English. */
export interface Words {
  /** Decimal sign, and the blank before a unit. */
  point: string;
  blank: string;
  /** Which of the forms of a counted noun this number takes. */
  form(count: number): number;
  /** A day, in figures. */
  day(year: number, month: number, day: number): string;
  texts: Readonly<Record<Text, string>>;
  /** A cause of docs/holds.md; null: it is not known here. */
  hold(row: Pick<HoldRow, "code" | "subject">): { words: string; remedy: string; who: string } | null;
  /** Meanings of docs/faults.md. */
  faults: Readonly<Record<number, string>>;
  /** What to do about them. */
  remedies: Readonly<Record<number, string>>;
  /** A sentence of the robot's web server; null: it is not known here. */
  robot(text: string, said: (part: string) => string): string | null;
}

export type Language = "en" | "cs";
export type Choice = "auto" | Language;
const KEY = "advee-language";

/** The first that the page has of those that the browser prefers. Slovaks read Czech. */
export function preferred(languages: readonly string[]): Language {
  for (const each of languages) {
    const [language] = each.toLowerCase().split("-");
    if (language === "cs" || language === "sk") return "cs";
    if (language === "en") return "en";
  }
  return "en";
}

/** Tests run without a browser: English. */
const inBrowser = "document" in globalThis;
const browsers = signal<Language>(inBrowser ? preferred(navigator.languages) : "en");

export const choice = signal<Choice>(stored());
const wanted = computed<Language>(() => (choice.value === "auto" ? browsers.value : choice.value));

/** The words of the language that is shown; null: English. */
export const words = signal<Words | null>(null);
/** What is shown: the language that is wanted, once its words are here. */
export const language = computed<Language>(() => (words.value === null ? "en" : "cs"));

/** Fetches what is wanted and shows it. Whether it could: if not, English is shown. */
async function show(): Promise<void> {
  if (wanted.value === "en") {
    words.value = null;
    return;
  }
  try {
    const { CS } = await import("./cs");
    // It may be another choice by now.
    if (wanted.value === "cs") words.value = CS;
  } catch {
    // The robot does not answer, or has a newer page: the next start of the page asks again.
  }
}

/** ms that the page waits for its words at its start; then it begins in English. */
const PATIENCE = 2000;
/** Fulfilled once the page may be shown. */
export let ready: Promise<void> = Promise.resolve();

if (inBrowser) {
  addEventListener("languagechange", () => (browsers.value = preferred(navigator.languages)));
  effect(() => {
    wanted.value;
    ready = Promise.race([show(), new Promise<void>((over) => setTimeout(over, PATIENCE))]);
    try {
      localStorage.setItem(KEY, choice.value);
    } catch {
      // A browser that keeps nothing shows its own language.
    }
  });
  effect(() => void (document.documentElement.lang = language.value));
}

function stored(): Choice {
  try {
    const was = globalThis.localStorage?.getItem(KEY);
    return was === "en" || was === "cs" ? was : "auto";
  } catch {
    return "auto";
  }
}
