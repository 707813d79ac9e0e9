import { deepEqual, equal } from "node:assert/strict";
import { test } from "node:test";
import type { BeaconUse } from "../protocol";
import { beaconState, normalized, statesOf } from "./beacons";

const beacon = (change: Partial<BeaconUse> = {}): BeaconUse => ({
  id: 1, x: 0, y: 0, active: true, permitted: true, last: 9e6, residual: 0.01, deviation: 0.02, fits: true, accepted: 7, refused: 0, ...change,
});

test("a beacon is in the state that explains most", () => {
  const changes: Partial<BeaconUse>[] = [{}, { fits: false }, { last: 4e6 }, { last: 0 }, { active: false }, { active: false, permitted: false }];
  deepEqual(changes.map((change) => beaconState(beacon(change), 10e6)), ["used", "refused", "unseen", "unseen", "unselected", "excluded"]);
});

test("a residual is compared with what was expected of it, where there is one", () => {
  equal(normalized({ residual: -0.04, deviation: 0.02 }), -2);
  deepEqual([[null, 0.02], [0.1, null], [0.1, 0]].map(([residual, deviation]) => normalized({ residual, deviation } as BeaconUse)), [null, null, null]);
});

test("states go by number, and there are none while nothing is known", () => {
  deepEqual([...statesOf({ timestamp: 10e6, beacons: [beacon(), beacon({ id: 2, fits: false })] })], [[1, "used"], [2, "refused"]]);
  equal(statesOf(null).size, 0);
});
