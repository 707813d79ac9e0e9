// Czech, in a file of its own, which is loaded where it is chosen.
import type { Words } from "../language";
import { FAULTS, REMEDIES } from "./faults";
import { hold } from "./holds";
import { TEXTS } from "./page";
import { robot } from "./robot";

const BLANK = "\u00A0";
const RULES = new Intl.PluralRules("cs");
const FORMS: Partial<Record<Intl.LDMLPluralRule, number>> = { one: 0, few: 1, other: 2, many: 3 };

const SHORT = /(^|[^\p{L}\p{N}])([kosuvzai]) (?=\S)/giu;
const COUNTED = /(\d|\}) (?=(?:%|ms|s|m|min|h|GiB|m\/s)(?![\p{L}\p{N}])|\{\w+\|)/gu;

/** No line ends after a preposition or a conjunction of one letter, nor between a number and what it counts. */
export function tied(text: string): string {
  const short = (part: string) => part.replace(SHORT, `$1$2${BLANK}`);
  // Of two short words in a row the first one has the blank before the second.
  return short(short(text)).replace(COUNTED, `$1${BLANK}`);
}

const all = <T extends Readonly<Record<string | number, string>>>(texts: T): T => Object.fromEntries(Object.entries(texts).map(([key, text]) => [key, tied(text)])) as unknown as T;

export const CS: Words = {
  point: ",",
  blank: BLANK,
  form: (count) => FORMS[RULES.select(count)] ?? 2,
  day: (year, month, day) => `${day}.${BLANK}${month}.${BLANK}${year}`,
  texts: all(TEXTS),
  faults: all(FAULTS),
  remedies: all(REMEDIES),
  hold(row) {
    const found = hold(row);
    return found && { who: found.who, words: tied(found.words), remedy: tied(found.remedy) };
  },
  robot(text, said) {
    const found = robot(text, said);
    return found && tied(found);
  },
};
