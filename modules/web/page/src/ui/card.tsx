// A titled part of a view.
import type { LucideIcon } from "lucide-preact";
import type { ComponentChildren } from "preact";
import { useId } from "preact/hooks";

export function Card(props: {
  title: string;
  icon?: LucideIcon;
  /** Beside the title: an age, a badge, buttons. */
  aside?: ComponentChildren;
  /** Without padding: for a table or a picture that fills it. */
  flush?: boolean;
  class?: string;
  children: ComponentChildren;
}) {
  const id = useId();
  const Icon = props.icon;
  return (
    <section class={`card ${props.flush ? "flush" : ""} ${props.class ?? ""}`} aria-labelledby={id}>
      <header>
        <h2 id={id}>
          {Icon ? <Icon size={18} aria-hidden /> : null}
          {props.title}
        </h2>
        {props.aside ? <div class="aside">{props.aside}</div> : null}
      </header>
      <div class="body">{props.children}</div>
    </section>
  );
}
