// Waits for conditions, with patience for slow machines; never for a time alone where something can be seen.
export const pass = (ms: number): Promise<void> => new Promise((over) => setTimeout(over, ms));

/** Until `condition` is true, looked at every 20 ms; what it was then. */
export async function until<T>(what: string | (() => string), seconds: number, condition: () => T | Promise<T>): Promise<NonNullable<T>> {
  const end = performance.now() + 1000 * seconds;
  for (;;) {
    const now = await condition();
    if (now) return now;
    if (performance.now() > end) throw new Error(`not within ${seconds} s: ${typeof what === "string" ? what : what()}`);
    await pass(20);
  }
}
