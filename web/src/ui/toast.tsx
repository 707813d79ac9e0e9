// Short news at the edge of the screen, spoken by screen readers, gone by itself; bad news stays until it is closed.
import { signal } from "@preact/signals";
import { X } from "lucide-preact";
import { TONE_ICONS, type Tone } from "./badge";
import { Button } from "./button";

interface Toast {
  id: number;
  tone: Tone;
  text: string;
}
const toasts = signal<Toast[]>([]);
let number = 0;

/** ms; good news is short; how many there are at most. */
const STAYS = 6000;
const STAYS_GOOD = 3500;
const MOST = 4;

export function toast(text: string, tone: Tone = "info"): void {
  const same = toasts.value.find((each) => each.text === text);
  if (same) close(same.id);
  const id = ++number;
  toasts.value = [...toasts.value, { id, tone, text }].slice(-MOST);
  if (tone !== "bad") setTimeout(() => close(id), tone === "good" ? STAYS_GOOD : STAYS);
}

function close(id: number): void {
  toasts.value = toasts.value.filter((each) => each.id !== id);
}

export function Toasts() {
  return (
    <div class="toasts" role="status" aria-live="polite">
      {toasts.value.map(({ id, tone, text }) => {
        const Icon = TONE_ICONS[tone];
        return (
          <div key={id} class={`toast tone-${tone}`}>
            <Icon size={18} aria-hidden />
            <p>{text}</p>
            <Button kind="quiet" icon={X} label="Close" onClick={() => close(id)} />
          </div>
        );
      })}
    </div>
  );
}
