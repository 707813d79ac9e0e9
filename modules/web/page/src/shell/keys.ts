// Space and Escape stop the robot, wherever the focus is; in a field one types in, Space is a blank and Escape still stops.
import { stop, unpaired } from "../operate";
import { demo } from "../state";
import { watchChoice } from "../ui/rest";

export function watchKeys(): () => void {
  const key = (event: KeyboardEvent) => {
    // A recorded run is not stopped.
    if (demo.value || event.repeat || event.ctrlKey || event.altKey || event.metaKey) return;
    const at = event.target instanceof HTMLElement ? event.target : null;
    if (event.key === "Escape" ? unpaired.value : event.key !== " " || types(at) || (unpaired.value && at !== document.body)) return;
    event.preventDefault();
    void stop();
  };
  // A button pressed by Space acts on keyup: that is Stop's key here.
  const up = (event: KeyboardEvent) => {
    if (event.key === " " && !demo.value && !unpaired.value && event.target instanceof HTMLElement && !types(event.target)) event.preventDefault();
  };
  addEventListener("keydown", key, { capture: true });
  addEventListener("keyup", up, { capture: true });
  const endChoice = watchChoice();
  return () => {
    endChoice();
    removeEventListener("keydown", key, { capture: true });
    removeEventListener("keyup", up, { capture: true });
  };
}

/** Whether keys are text, or choose, there. */
export function types(at: HTMLElement | null): boolean {
  return at !== null && (at.isContentEditable || /^(INPUT|TEXTAREA|SELECT)$/.test(at.tagName));
}
