// Short news at the edge of the screen, spoken by screen readers, gone by itself; bad news stays until it is closed.
import { X } from "lucide-preact";
import { t } from "../words";
import { TONE_ICONS } from "./badge";
import { Button } from "./button";
import { close, news } from "./news";

export function Toasts() {
  return (
    <div class="toasts" role="status" aria-live="polite">
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
