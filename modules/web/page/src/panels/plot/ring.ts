// A bounded past of one number: the oldest sample makes room for the newest.

export class Ring {
  readonly #at: Float64Array;
  readonly #values: Float64Array;
  #next = 0;
  #length = 0;

  constructor(capacity: number) {
    this.#at = new Float64Array(capacity);
    this.#values = new Float64Array(capacity);
  }

  get length(): number {
    return this.#length;
  }

  /** The instant of the newest sample; none: −∞. */
  get last(): number {
    return this.#length ? (this.#at[(this.#next + this.#at.length - 1) % this.#at.length] as number) : -Infinity;
  }

  /** Takes a sample; null is one too: a gap. One that is not newer than the last is left out; one that is much older is of a
   *  scale that began anew, and what was before is dropped. */
  push(at: number, value: number | null): void {
    if (at < this.last - 1) this.clear();
    if (!(at > this.last)) return;
    this.#at[this.#next] = at;
    this.#values[this.#next] = value ?? NaN;
    this.#next = (this.#next + 1) % this.#at.length;
    this.#length = Math.min(this.#length + 1, this.#at.length);
  }

  clear(): void {
    this.#next = 0;
    this.#length = 0;
  }

  /** The newest value; null where it is a gap or there is none. */
  newest(): number | null {
    if (!this.#length) return null;
    const value = this.#values[(this.#next + this.#values.length - 1) % this.#values.length] as number;
    return Number.isFinite(value) ? value : null;
  }

  /** The value that held at an instant: the newest sample that is not after it; null: a gap, or none is as old. */
  at(instant: number): number | null {
    for (let n = 1; n <= this.#length; n++) {
      const place = (this.#next + this.#at.length - n) % this.#at.length;
      if ((this.#at[place] as number) > instant) continue;
      const value = this.#values[place] as number;
      return Number.isFinite(value) ? value : null;
    }
    return null;
  }

  /** Samples from `since` on, the oldest first; gaps are null. */
  from(since: number): { at: number[]; values: (number | null)[] } {
    const at: number[] = [];
    const values: (number | null)[] = [];
    for (let n = 0; n < this.#length; n++) {
      const place = (this.#next + this.#at.length - this.#length + n) % this.#at.length;
      const when = this.#at[place] as number;
      if (when < since) continue;
      const value = this.#values[place] as number;
      at.push(when);
      values.push(Number.isFinite(value) ? value : null);
    }
    return { at, values };
  }
}

/** Several pasts on one scale of time, for a plot: the instants of all, and each series' values there. `undefined`: it has no
 *  sample at that instant (a line goes on through it); null: a gap. */
export function align(series: readonly { at: number[]; values: (number | null)[] }[]): [number[], ...(number | null | undefined)[][]] {
  const instants = [...new Set(series.flatMap((one) => one.at))].sort((a, b) => a - b);
  const place = new Map(instants.map((at, n) => [at, n]));
  const columns = series.map((one) => {
    const column: (number | null | undefined)[] = new Array<undefined>(instants.length).fill(undefined);
    one.at.forEach((at, n) => {
      column[place.get(at) as number] = one.values[n] ?? null;
    });
    return column;
  });
  return [instants, ...columns];
}

/** The same as comma-separated values: a line for each instant, an empty cell where a series has none. */
export function csv(names: readonly string[], series: readonly { at: number[]; values: (number | null)[] }[]): string {
  const [at, ...columns] = align(series);
  const cell = (text: string) => (/[",\n]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text);
  const head = ["s", ...names].map(cell).join(",");
  return [head, ...at.map((when, n) => [when.toFixed(6), ...columns.map((column) => column[n] ?? "")].join(","))].join("\n") + "\n";
}

/** At most about so many samples, so that a long window draws as fast as a short one: of each bucket its lowest and highest. */
export function thin(one: { at: number[]; values: (number | null)[] }, most: number): { at: number[]; values: (number | null)[] } {
  const size = one.at.length;
  if (size <= most) return one;
  const buckets = Math.max(1, Math.floor(most / 2));
  const keep: number[] = [];
  for (let bucket = 0; bucket < buckets; bucket++) {
    const begin = Math.floor((bucket * size) / buckets);
    const end = Math.floor(((bucket + 1) * size) / buckets);
    let low = begin;
    let high = begin;
    let gap = -1;
    for (let n = begin; n < end; n++) {
      const value = one.values[n] ?? null;
      if (value === null) {
        gap = n;
        continue;
      }
      if ((one.values[low] ?? Infinity) > value) low = n;
      if ((one.values[high] ?? -Infinity) < value) high = n;
    }
    keep.push(...new Set([low, high, gap].filter((n) => n >= 0).sort((a, b) => a - b)));
  }
  return { at: keep.map((n) => one.at[n] as number), values: keep.map((n) => one.values[n] ?? null) };
}
