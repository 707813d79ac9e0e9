// Whether the robot is well, beside whether it may be driven: the second word of the status. Pure.
import type { Concern, DataEstimate, DataPower, Ellipse, HoldRow } from "../protocol";
import { num, span } from "../format";
import type { Tone } from "../ui/badge";
import { t } from "../words";
import { holdWords, said } from "../words/said";

/** From best to worst. */
const ORDER: Tone[] = ["good", "info", "off", "warn", "bad"];

/** The worse of two: the colour of the bar is that of the worst. */
export const worse = (a: Tone, b: Tone): Tone => (ORDER.indexOf(b) > ORDER.indexOf(a) ? b : a);

export interface Second {
  tone: Tone;
  /** The weightiest, and how many more there are. */
  words: string;
  more: number;
}

/** The second word; null: all is well. A cause that the reason already names is not said twice. `cause`: what bars the motion;
 *  the concerns that are newer may be what follows from it. */
export function second(concerns: readonly Concern[], reason: string, cause: HoldRow | null = null): Second | null {
  const others = concerns.filter(({ words }) => words !== reason && !(cause?.who && words.includes(cause.who)));
  if (cause !== null) return { tone: "bad", words: holdWords(cause), more: others.length };
  const [first] = others;
  return first ? { tone: first.weight === "error" ? "bad" : "warn", words: said(first.words), more: others.length - 1 } : null;
}

export interface Vital {
  tone: Tone;
  text: string;
  /** For who hears it, and in the tooltip. */
  title: string;
  /** Behind the text where there is room. */
  more?: string;
}

/** How well the position is known: half of the longer axis of two standard deviations on either side. */
export function position(estimate: DataEstimate | null, ellipse: Ellipse | null): Vital {
  if (estimate === null) return { tone: "off", text: t("not known"), title: t("Position not known") };
  if (estimate.quality < 2) return { tone: "warn", text: estimate.quality === 1 ? t("searching") : t("lost"), title: t("The robot does not know where it is") };
  const text = ellipse === null ? ([t("coarse"), t("fine")][estimate.quality - 2] ?? t("not known")) : `±${num(ellipse.long, 2, "m")}`;
  const title = estimate.quality === 2 ? t("Position coarse, uncertainty 2σ") : t("Position fine, uncertainty 2σ");
  return { tone: estimate.quality === 2 ? "info" : "good", text, title };
}

/** The share of the charge below which the battery is low, and below which it is about to be empty. */
export const LOW = 0.3;
export const EMPTY = 0.15;

export function battery(power: DataPower | null): Vital {
  if (power === null || power.charge === null) return { tone: "off", text: t("not known"), title: t("Battery not known") };
  const percent = `${num(100 * power.charge, 0)}\u202F%`;
  const left = power.remaining === null || power.remaining < 0 ? null : span(Math.round(power.remaining / 60) * 60);
  const title = left === null ? t("Battery {percent}", { percent }) : t("Battery {percent}, {time} left", { percent, time: left });
  return { tone: power.charge < EMPTY ? "bad" : power.charge < LOW ? "warn" : "good", text: percent, title, ...(left === null ? {} : { more: left }) };
}
