// A value with its age: grey, and said so, once it is older than twice its period.
import { Clock } from "lucide-preact";
import type { ComponentChildren } from "preact";
import { span, united } from "../format";
import type { Shown } from "../protocol";
import { age, stale } from "../state";
import { t } from "../words";

/** How old a value is, in words. */
export function Age({ shown }: { shown: Shown<unknown> | null | undefined }) {
  const old = shown ? age(shown) : null;
  const grey = stale(shown);
  return (
    <span class={grey ? "age is-stale" : "age"} title={grey ? t("older than it should be") : t("age of the value")}>
      <Clock size={12} aria-hidden />
      <span class="visually-hidden">{grey ? t("stale, age") : t("age")} </span>
      {old === null ? t("never received") : old < 1 && !grey ? `< ${united(1, "s")}` : span(old)}
    </span>
  );
}

/** Shows `children` of the value, greyed by itself when it is stale, and `none` where there was never one. */
export function Aged<T>(props: {
  shown: Shown<T> | null | undefined;
  children: (value: T) => ComponentChildren;
  none?: ComponentChildren;
  /** Without the age beside it: where a card shows it once for all its values. */
  bare?: boolean;
}) {
  const { shown, children, none = t("no data yet"), bare } = props;
  if (!shown || shown.value === null) return <div class="aged is-stale none">{none}</div>;
  return (
    <div class={stale(shown) ? "aged is-stale" : "aged"}>
      {children(shown.value)}
      {bare ? null : <Age shown={shown} />}
    </div>
  );
}
