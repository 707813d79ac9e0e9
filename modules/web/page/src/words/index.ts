// Texts in the language of the page. The English one is the key of the others: `t("Take control")`. Values have names,
// a counted noun has its forms: `t("{n} {n|run|runs}", { n: 3 })`, so that each language has its own order and plurals.
import type { ComponentChildren } from "preact";
import { type Text, words } from "./language";

export type { Text };

/** Names of the values in a text. */
type Names<K extends string> = K extends `${string}{${infer Name}}${infer Rest}` ? (Name extends `${infer Counted}|${string}` ? Counted : Name) | Names<Rest> : never;
type Values<K extends string, V> = [Names<K>] extends [never] ? [] : [values: Record<Names<K>, V>];
/** A text without values. */
export type Plain = { [K in Text]: K extends `${string}{${string}` ? never : K }[Text];

/** A text that means two things says which after this sign. */
const english = (text: string): string => text.split("¦")[0] as string;

/** The text in the language of the page. */
export function t<K extends Text>(text: K, ...values: Values<K, string | number>): string {
  const [of] = values as [Record<string, string | number>?];
  const said = words.value?.texts[text] ?? english(text);
  return of === undefined ? said : filled(said, of, words.value?.form ?? oneOrMore);
}

/** The same with elements as values. */
export function rich<K extends Text>(text: K, values: Record<Names<K>, ComponentChildren>): ComponentChildren[] {
  const said = words.value?.texts[text] ?? english(text);
  return said.split(/\{(\w+)\}/).map((part, n) => (n % 2 === 0 ? part : values[part as Names<K>]));
}

/** Puts values into their places, and chooses the forms of counted nouns. */
export function filled(text: string, values: Readonly<Record<string, string | number>>, form: (count: number) => number): string {
  return text.replace(/\{(\w+)(?:\|([^}]*))?\}/g, (_, name: string, forms?: string) => {
    const value = values[name] ?? "";
    if (forms === undefined) return String(value);
    const all = forms.split("|");
    return all[form(quantity(value))] ?? all.at(-1) ?? "";
  });
}

/** A number as it was, or as it is written. */
const quantity = (value: string | number): number => (typeof value === "number" ? value : Number(value.replace(/[\s\u202F]/g, "").replace(",", ".")));

const oneOrMore = (count: number): number => (count === 1 ? 0 : 1);
