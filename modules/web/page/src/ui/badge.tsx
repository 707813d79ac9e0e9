// A word with an icon and a colour, never a colour alone.
import { CircleAlert, CircleCheck, CircleMinus, Info, type LucideIcon, OctagonX } from "lucide-preact";
import type { ComponentChildren } from "preact";

export type Tone = "good" | "info" | "warn" | "bad" | "off";

export const TONE_ICONS: Record<Tone, LucideIcon> = {
  good: CircleCheck,
  info: Info,
  warn: CircleAlert,
  bad: OctagonX,
  off: CircleMinus,
};

export function Badge({ tone, icon, children }: { tone: Tone; icon?: LucideIcon; children: ComponentChildren }) {
  const Icon = icon ?? TONE_ICONS[tone];
  return (
    <span class={`badge tone-${tone}`}>
      <Icon size={14} aria-hidden />
      <span>{children}</span>
    </span>
  );
}
