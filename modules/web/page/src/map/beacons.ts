// What the estimator makes of each beacon, apart from how it is shown.
import type { BeaconUse, DataBeaconUse } from "../protocol";
import type { Tone } from "../ui";
import type { Plain } from "../words";

export type BeaconState = "used" | "refused" | "unseen" | "unselected" | "excluded";

/** µs without a bearing after which a beacon counts as not seen: five sweeps of the scanner. */
const SEEN = 5e6;

/** The state that explains most; `timestamp` is that of the message. The terminal has the same rules. */
export function beaconState(beacon: BeaconUse, timestamp: number): BeaconState {
  if (!beacon.permitted) return "excluded";
  if (!beacon.active) return "unselected";
  if (beacon.last <= 0 || timestamp - beacon.last > SEEN) return "unseen";
  return beacon.fits ? "used" : "refused";
}

export const STATES: Readonly<Record<BeaconState, readonly [Tone, Plain]>> = {
  used: ["good", "used¦beacon"],
  refused: ["bad", "refused¦beacon"],
  unseen: ["warn", "not seen"],
  unselected: ["off", "not selected"],
  excluded: ["off", "excluded"],
};

/** The residual in standard deviations; null without one. */
export function normalized({ residual, deviation }: Pick<BeaconUse, "residual" | "deviation">): number | null {
  return residual === null || deviation === null || !(deviation > 0) ? null : residual / deviation;
}

/** States by the beacons' numbers; empty while they are not known. */
export function statesOf(uses: DataBeaconUse | null): ReadonlyMap<number, BeaconState> {
  return new Map(uses?.beacons.map((beacon) => [beacon.id, beaconState(beacon, uses.timestamp)]));
}
