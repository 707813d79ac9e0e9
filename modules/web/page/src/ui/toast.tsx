// Short news at the edge of the screen, spoken by screen readers, gone by itself; bad news stays until it is closed.
// While a dialog is open only the newest is shown, below the dialog, which leaves room for it: a notice covers no button.
import { X } from "lucide-preact";
import { useEffect, useRef } from "preact/hooks";
import { t } from "../words";
import { TONE_ICONS } from "./badge";
import { Button } from "./button";
import { close, news } from "./news";

/** Between a dialog and the notice below it, px. */
const GAP = 8;

export function Toasts() {
  const box = useRef<HTMLDivElement>(null);
  useEffect(() => {
    const shown = box.current as HTMLDivElement;
    const room = () => document.documentElement.style.setProperty("--notices", shown.offsetHeight > 0 ? `${shown.offsetHeight + GAP}px` : "0px");
    const sized = new ResizeObserver(room);
    sized.observe(shown);
    return () => sized.disconnect();
  }, []);
  return (
    <div ref={box} class="toasts" role="status" aria-live="polite">
      {news.value.map(({ id, tone, text, offer }) => {
        const Icon = TONE_ICONS[tone];
        return (
          <div key={id} class={`toast tone-${tone}`}>
            <Icon size={18} aria-hidden />
            <p>{text}</p>
            <Button kind="quiet" icon={X} label={t("Close")} onClick={() => close(id)} />
            {offer ? (
              <Button class="toast-offer" onClick={() => (close(id), offer.run())}>
                {offer.label}
              </Button>
            ) : null}
          </div>
        );
      })}
    </div>
  );
}
