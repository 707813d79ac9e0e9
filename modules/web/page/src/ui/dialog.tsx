// A dialog before the view. Not modal in the browser's sense on purpose: Stop stays in reach, for hands and keys alike.
// Escape closes it (and stops the robot, as everywhere).
import { X } from "lucide-preact";
import type { ComponentChildren } from "preact";
import { useEffect, useId, useRef } from "preact/hooks";
import { t } from "../words";
import { Button } from "./button";

export function Dialog(props: { title: string; open: boolean; onClose: () => void; wide?: boolean; children: ComponentChildren }) {
  const box = useRef<HTMLDivElement>(null);
  const id = useId();
  useEffect(() => {
    if (!props.open) return;
    const before = document.activeElement;
    (box.current?.querySelector<HTMLElement>("input") ?? box.current)?.focus();
    return () => before instanceof HTMLElement && before.focus();
  }, [props.open]);
  if (!props.open) return null;
  return (
    <div class="dialog-behind" onClick={(event) => event.target === event.currentTarget && props.onClose()}>
      <div
        ref={box}
        class={props.wide ? "dialog is-wide" : "dialog"}
        role="dialog"
        tabIndex={-1}
        aria-labelledby={id}
        onKeyDown={(event) => event.key === "Escape" && props.onClose()}
      >
        <header>
          <h2 id={id}>{props.title}</h2>
          <Button kind="quiet" icon={X} label={t("Close")} onClick={props.onClose} />
        </header>
        {props.children}
      </div>
    </div>
  );
}
