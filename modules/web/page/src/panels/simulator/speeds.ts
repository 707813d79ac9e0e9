// The speeds of a simulation. Pure.
/** Simulated seconds per real second; 0: as fast as possible. */
export const SPEEDS: readonly number[] = [0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100, 0];

/** A speed in words. */
export const inWords = (speed: number | null): string => (speed === 0 ? "as fast as possible" : speed === null ? "not known" : `${speed} ×`);

/** Those offered, with the present one. */
export function offered(speed: number | null): number[] {
  return speed === null || SPEEDS.includes(speed) ? [...SPEEDS] : [speed, ...SPEEDS];
}
