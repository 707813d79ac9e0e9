// The second input: held beside the pad it lets the robot creep past its guard, slowly, and only while somebody watches.
import { Footprints, Lock } from "lucide-preact";
import { useRef } from "preact/hooks";
import { drive } from "../state";
import { ownGesture } from "../ui/gesture";
import { toast } from "../ui/news";
import { t } from "../words";
import { commanded, creeping, second, whyNoCreep } from "./session";

/** Only where the robot has a guard. */
export function Creep() {
  const pointer = useRef<number | null>(null);
  if (!drive.value?.bound) return null;
  const why = whyNoCreep.value ?? (commanded.value === null ? t("Hold the pad first, then this.") : null);
  const down = (event: PointerEvent) => {
    if (event.button !== 0 || pointer.current !== null) return;
    if (why !== null) return toast(why, "warn");
    (event.currentTarget as HTMLElement).setPointerCapture(event.pointerId);
    pointer.current = event.pointerId;
    second(true);
  };
  const up = (event: PointerEvent) => {
    if (event.pointerId !== pointer.current) return;
    pointer.current = null;
    second(false);
  };
  return (
    <div class="creep">
      <button
        type="button"
        class="button creep-button"
        aria-disabled={why !== null}
        aria-describedby="creep-why"
        aria-pressed={creeping.value}
        onTouchStart={ownGesture}
        onPointerDown={down}
        onPointerUp={up}
        onPointerCancel={up}
        onLostPointerCapture={up}
        onContextMenu={(event) => event.preventDefault()}
      >
        {why === null ? <Footprints size={20} aria-hidden /> : <Lock size={20} aria-hidden />}
        <span>{t("Creep")}</span>
      </button>
      <p id="creep-why" class="why-not">
        {creeping.value ? t("It creeps past what the guard senses: watch it.") : (why ?? t("Hold it beside the pad to creep past what the guard senses."))}
      </p>
    </div>
  );
}
