// The pad: press and hold to drive, up is forward. A second finger on it, a lost pointer or a cancelled one is a zero.
import { ChevronDown, ChevronLeft, ChevronRight, ChevronUp, Lock } from "lucide-preact";
import { useEffect, useRef } from "preact/hooks";
import { clock } from "../state";
import { ownGesture } from "../ui/gesture";
import { t } from "../words";
import type { Wish } from "./hold";
import { Ring } from "./ring";
import { commanded, fingerOn, goesSideways, hold, letGo, padSideways, shown, whyNoDrive } from "./session";

/** Share of the half side around the middle that is the middle; and what is the end already. */
const DEAD = 0.08;
const END = 0.9;

export function Pad() {
  const pad = useRef<HTMLDivElement>(null);
  const knob = useRef<HTMLDivElement>(null);
  /** Pointers on the pad, and the one that drives. */
  const pointers = useRef(new Set<number>());
  const driver = useRef<number | null>(null);
  const off = whyNoDrive.value;
  const now = commanded.value;
  const held = now?.source === "pad";

  const place = (x: number, y: number) => knob.current?.style.setProperty("transform", `translate(${x}px, ${y}px)`);
  useEffect(() => () => void (fingerOn.value = false), []);
  useEffect(() => {
    if (!held) {
      driver.current = null;
      place(0, 0);
    }
  }, [held]);

  /** Where the pad was when it was pressed: should the page move it meanwhile, the hand has not moved. */
  const area = useRef<DOMRect | null>(null);
  const wish = (event: PointerEvent): Wish => {
    const box = area.current as DOMRect;
    const half = box.width / 2;
    const x = within((event.clientX - box.left - half) / half / END);
    const y = within((event.clientY - box.top - half) / half / END);
    place(x * half * 0.72, y * half * 0.72);
    const [speed, left] = [-outside(y), -outside(x)];
    return goesSideways.value && padSideways.value ? { speed, steering: 0, sideways: left } : { speed, steering: left };
  };
  const down = (event: PointerEvent) => {
    event.preventDefault();
    pad.current?.setPointerCapture(event.pointerId);
    pointers.current.add(event.pointerId);
    fingerOn.value = true;
    if (pointers.current.size > 1) return letGo("A second finger was on the pad.");
    if (event.button !== 0) return;
    area.current = (pad.current as HTMLDivElement).getBoundingClientRect();
    if (hold.press("pad", wish(event), clock())) driver.current = event.pointerId;
    else place(0, 0);
    shown();
  };
  const move = (event: PointerEvent) => {
    if (event.pointerId !== driver.current) return;
    // A button that was let go elsewhere: its up was never told.
    if (event.pointerType === "mouse" && (event.buttons & 1) === 0) return up(event);
    hold.move("pad", wish(event));
    shown();
  };
  const up = (event: PointerEvent) => {
    pointers.current.delete(event.pointerId);
    fingerOn.value = pointers.current.size > 0;
    if (event.pointerId !== driver.current) return;
    driver.current = null;
    hold.release("pad");
    place(0, 0);
    shown();
  };

  return (
    <div class="pad-frame">
      <div
        ref={pad}
        class={`pad ${held ? "is-held" : ""} ${off === null ? "" : "is-off"}`}
        role="application"
        tabIndex={0}
        aria-label={t("Drive pad. Hold to drive; arrow keys or W A S D drive while they are held.")}
        aria-disabled={off !== null}
        aria-describedby="pad-why"
        onTouchStart={ownGesture}
        onPointerDown={down}
        onPointerMove={move}
        onPointerUp={up}
        onPointerCancel={up}
        onLostPointerCapture={up}
        onContextMenu={(event) => event.preventDefault()}
      >
        <ChevronUp class="pad-up" size={30} aria-hidden />
        <ChevronDown class="pad-down" size={30} aria-hidden />
        <ChevronLeft class="pad-left" size={30} aria-hidden />
        <ChevronRight class="pad-right" size={30} aria-hidden />
        <Ring />
        <div ref={knob} class="pad-knob" />
        {off === null ? null : (
          <p id="pad-why" class="pad-why">
            <Lock size={22} aria-hidden />
            {off}
          </p>
        )}
      </div>
    </div>
  );
}

const within = (value: number): number => Math.max(-1, Math.min(1, value));
function outside(value: number): number {
  const size = Math.abs(value);
  return size < DEAD ? 0 : (Math.sign(value) * (size - DEAD)) / (1 - DEAD);
}
