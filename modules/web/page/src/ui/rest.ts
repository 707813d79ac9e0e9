// The arrow keys that confirm a slide drive the robot, too. After a slide was confirmed by keys they drive again only when
// somebody chose to: focused the pad, or pressed anything with a pointer. One press too many moves nothing.
let resting = false;

/** A slide was confirmed by a key. */
export const restKeys = (): void => void (resting = true);

/** Whether arrow keys are at rest. */
export const keysRest = (): boolean => resting;

/** Something was focused or pressed; `pad`: the pad. */
export function chosen(what: "pad" | "pointer" | "other"): void {
  if (what !== "other") resting = false;
}

export function watchChoice(): () => void {
  const focused = (event: FocusEvent) => chosen(event.target instanceof Element && event.target.closest(".pad") ? "pad" : "other");
  const pressed = () => chosen("pointer");
  addEventListener("focusin", focused);
  addEventListener("pointerdown", pressed, { capture: true });
  return () => {
    removeEventListener("focusin", focused);
    removeEventListener("pointerdown", pressed, { capture: true });
  };
}
