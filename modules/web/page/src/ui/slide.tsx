// Slide to confirm: the thumb must be dragged to the end, or brought there by the right arrow key, step by step. Neither
// a stray tap nor one key does it. One that is off says why when it is pressed, and offers control where that is missing.
import { Check, ChevronsRight } from "lucide-preact";
import { useRef, useState } from "preact/hooks";
import { explain } from "../operate";
import { t } from "../words";
import { ownGesture } from "./gesture";
import { restKeys } from "./rest";

/** Of the way: from here on it counts as the end; what one key does. */
const END = 0.95;
const STEP = 0.25;
const THUMB = 52;

export function Slide(props: {
  label: string;
  onConfirm: () => void;
  tone?: "normal" | "danger" | "good";
  /** Why it may not be done now; null: it may. */
  whyNot?: string | null;
}) {
  const { label, onConfirm, tone = "normal", whyNot = null } = props;
  const track = useRef<HTMLDivElement>(null);
  const grip = useRef<{ pointer: number; x: number } | null>(null);
  const [way, setWay] = useState(0);

  const confirm = () => {
    grip.current = null;
    setWay(0);
    onConfirm();
  };
  const reset = () => {
    grip.current = null;
    setWay(0);
  };
  const down = (event: PointerEvent) => {
    if (whyNot !== null || grip.current || event.button !== 0) return;
    (event.currentTarget as HTMLElement).setPointerCapture(event.pointerId);
    grip.current = { pointer: event.pointerId, x: event.clientX };
  };
  const move = (event: PointerEvent) => {
    if (grip.current?.pointer !== event.pointerId || !track.current) return;
    const room = Math.max(1, track.current.clientWidth - THUMB);
    setWay(Math.min(1, Math.max(0, (event.clientX - grip.current.x) / room)));
  };
  const up = (event: PointerEvent) => {
    if (grip.current?.pointer !== event.pointerId) return;
    if (way >= END) confirm();
    else reset();
  };
  const key = (event: KeyboardEvent) => {
    if (whyNot !== null) {
      if (event.key === "Enter") explain(whyNot, null);
      return;
    }
    const by = { ArrowRight: STEP, ArrowUp: STEP, ArrowLeft: -STEP, ArrowDown: -STEP }[event.key];
    if (by === undefined || event.repeat) return;
    event.preventDefault();
    event.stopPropagation();
    const next = Math.min(1, Math.max(0, way + by));
    if (next >= END) {
      restKeys();
      confirm();
    } else setWay(next);
  };

  return (
    <div ref={track} class={`slide ${tone} ${whyNot === null ? "" : "is-off"}`} title={whyNot ?? undefined} onClick={() => whyNot !== null && explain(whyNot, null)}>
      <div class="slide-done" style={{ width: `calc(${THUMB}px + (100% - ${THUMB}px) * ${way})` }} />
      <span class="slide-label" aria-hidden>
        {whyNot ?? label}
      </span>
      <div
        class="slide-thumb"
        role="slider"
        tabIndex={0}
        aria-label={t("{what}: slide to confirm, or press the right arrow key four times", { what: label })}
        aria-valuemin={0}
        aria-valuemax={100}
        aria-valuenow={Math.round(way * 100)}
        aria-valuetext={way === 0 ? t("not confirmed") : t("{percent} percent", { percent: Math.round(way * 100) })}
        aria-disabled={whyNot !== null}
        style={{ transform: `translateX(calc((${track.current?.clientWidth ?? 0}px - ${THUMB}px) * ${way}))` }}
        onTouchStart={whyNot === null ? ownGesture : undefined}
        onPointerDown={down}
        onPointerMove={move}
        onPointerUp={up}
        onPointerCancel={reset}
        onLostPointerCapture={reset}
        onKeyDown={key}
        onBlur={reset}
      >
        {way >= END ? <Check size={22} aria-hidden /> : <ChevronsRight size={22} aria-hidden />}
      </div>
    </div>
  );
}
