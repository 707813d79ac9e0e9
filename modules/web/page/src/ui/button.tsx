// A button of at least 48 px. One that may not be pressed says why: `whyNot` is its description, its tooltip, and
// what is said when it is pressed all the same; where only control is missing, that is offered then.
import type { LucideIcon } from "lucide-preact";
import type { ComponentChildren, JSX } from "preact";
import { useEffect, useId, useRef } from "preact/hooks";
import { explain } from "../operate";

export interface ButtonProps {
  onClick: () => void;
  children?: ComponentChildren;
  icon?: LucideIcon;
  kind?: "normal" | "primary" | "danger" | "quiet";
  /** Why it may not be pressed now; null: it may. */
  whyNot?: string | null;
  /** For one that only has an icon. */
  label?: string;
  pressed?: boolean;
  class?: string;
  type?: "button" | "submit";
}

export function Button(props: ButtonProps): JSX.Element {
  const { onClick, children, icon: Icon, kind = "normal", whyNot = null, label, pressed, type = "button" } = props;
  const id = useId();
  // What a press does when it was explained first: what the button does then, if it is still there and may be pressed.
  const newest = useRef<ButtonProps | null>(null);
  newest.current = props;
  useEffect(() => () => void (newest.current = null), []);
  const press = () => {
    const now = newest.current;
    if (now && (now.whyNot ?? null) === null) now.onClick();
  };
  const button = (
    <button
      type={type}
      class={`button ${kind} ${props.class ?? ""}`}
      aria-label={label}
      title={whyNot ?? label}
      aria-disabled={whyNot !== null}
      aria-describedby={whyNot === null ? undefined : id}
      aria-pressed={pressed}
      onClick={() => (whyNot === null ? onClick() : explain(whyNot, press))}
    >
      {Icon ? <Icon size={20} aria-hidden /> : null}
      {children ? <span>{children}</span> : null}
    </button>
  );
  if (whyNot === null) return button;
  // Beside the button, not in it: a reason is no part of its name.
  return (
    <>
      {button}
      <span id={id} class="visually-hidden">
        {whyNot}
      </span>
    </>
  );
}
