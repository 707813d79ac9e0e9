import { deepEqual, equal, ok } from "node:assert/strict";
import { test } from "node:test";
import { type DriveCommand, Hold, STALL } from "./hold";

const AHEAD = { speed: 1, steering: 0 };

/** A hold that may begin, with what it says. */
function ready(): { hold: Hold; said: DriveCommand[] } {
  const said: DriveCommand[] = [];
  const hold = new Hold((command) => said.push(command));
  hold.limit(0.6, 0.5);
  hold.allow(null);
  return { hold, said };
}
function run(hold: Hold, from: number, to: number): void {
  for (let at = from; at < to; at += 10) hold.tick(at);
}
const kinds = (said: DriveCommand[]): string => said.map(({ type }) => type[0]).join("");

test("a press is said at once, then twenty times a second, and its end is one zero and silence", () => {
  const { hold, said } = ready();
  ok(hold.press("pad", AHEAD, 0));
  deepEqual(said[0], { type: "drive", hold: 1, seq: 1, t: 0, speed: 0.6, steering: 0 });
  run(hold, 0, 1000);
  equal(said.length, 20);
  hold.release("pad");
  deepEqual(said.at(-1), { type: "zero", hold: 1, seq: 21 });
  run(hold, 1000, 3000);
  equal(said.length, 21);
});

test("each press is a hold of its own, and numbers only grow", () => {
  const { hold, said } = ready();
  for (const at of [0, 100, 200]) {
    hold.press("keys", AHEAD, at);
    hold.release("keys");
  }
  deepEqual(said.map((each) => each.hold), [1, 1, 2, 2, 3, 3]);
  deepEqual(said.map((each) => each.seq), [1, 2, 3, 4, 5, 6]);
});

test("where the hand is scales with the limits and never goes beyond them", () => {
  const { hold, said } = ready();
  hold.press("pad", { speed: -3, steering: 0.5 }, 0);
  deepEqual({ ...said[0], t: 0 }, { type: "drive", hold: 1, seq: 1, t: 0, speed: -0.6, steering: 0.25 });
  hold.limit(0.2, 0.5);
  hold.tick(50);
  equal((said[1] as { speed: number }).speed, -0.2);
});

test("a base that does not steer turns, and goes sideways where it can", () => {
  const { hold, said } = ready();
  hold.limit(0.6, 0.5, { rotation: 1.2 });
  hold.press("pad", { speed: 0, steering: -0.5, sideways: 1 }, 0);
  deepEqual(said[0], { type: "drive", hold: 1, seq: 1, t: 0, speed: 0, steering: 0, rotation: -0.6 });
  hold.limit(0.6, 0.5, { rotation: 1.2, sideways: 0.4 });
  hold.tick(50);
  deepEqual(said[1], { type: "drive", hold: 1, seq: 2, t: 50, speed: 0, steering: 0, rotation: -0.6, sideways: 0.4 });
  hold.move("pad", { speed: 0, steering: 0, sideways: Number.NaN });
  equal(kinds(said), "ddz");
});

test("when driving is not allowed any more there is one zero, and it does not begin again by itself", () => {
  const { hold, said } = ready();
  hold.press("pad", AHEAD, 0);
  hold.allow("The connection is too slow.");
  equal(kinds(said), "dz");
  hold.allow(null);
  hold.move("pad", AHEAD);
  run(hold, 0, 500);
  equal(kinds(said), "dz");
  equal(hold.ended, "The connection is too slow.");
});

test("a press while it is not allowed begins nothing, then or later", () => {
  const { hold, said } = ready();
  hold.allow("Somebody else has control.");
  ok(!hold.press("pad", AHEAD, 0));
  hold.allow(null);
  hold.move("pad", AHEAD);
  run(hold, 0, 500);
  hold.release("pad");
  equal(said.length, 0);
});

test("a second hand ends the first one's hold and begins none", () => {
  const { hold, said } = ready();
  hold.press("pad", AHEAD, 0);
  ok(!hold.press("gamepad", AHEAD, 20));
  hold.move("pad", AHEAD);
  hold.move("gamepad", AHEAD);
  run(hold, 20, 500);
  equal(kinds(said), "dz");
});

test("what another hand does is not this one's end", () => {
  const { hold, said } = ready();
  hold.press("pad", AHEAD, 0);
  hold.release("keys");
  hold.move("gamepad", { speed: -1, steering: 0 });
  hold.tick(50);
  equal(kinds(said), "dd");
  equal((said[1] as { speed: number }).speed, 0.6);
});

test("a page that did not run for a while says zero instead of going on", () => {
  const { hold, said } = ready();
  hold.press("pad", AHEAD, 0);
  hold.tick(STALL + 1);
  equal(kinds(said), "dz");
  hold.tick(STALL + 60);
  equal(kinds(said), "dz");
});

test("a hold that the robot ended is over without a word; one that ended before is not this one", () => {
  const { hold, said } = ready();
  hold.press("pad", AHEAD, 0);
  hold.endedByRobot(0, "late");
  equal(hold.holding, "pad");
  hold.endedByRobot(1, "nothing valid came for 200 ms");
  equal(hold.holding, null);
  hold.release("pad");
  run(hold, 0, 500);
  equal(kinds(said), "d");
});

test("a place that is no number is a zero", () => {
  const { hold, said } = ready();
  ok(!hold.press("pad", { speed: Number.NaN, steering: 0 }, 0));
  hold.press("pad", AHEAD, 0);
  hold.move("pad", { speed: 1, steering: Number.POSITIVE_INFINITY });
  equal(kinds(said), "dz");
});

test("whatever happens in whatever order: only holds that were pressed move, none goes on after its zero", () => {
  let seed = 1;
  const random = (n: number): number => ((seed = (seed * 48_271) % 2_147_483_647) >> 8) % n;
  const sources = ["pad", "keys", "gamepad"] as const;
  for (let round = 0; round < 300; round++) {
    const { hold, said } = ready();
    let pressed = 0;
    let at = 0;
    for (let step = 0; step < 80; step++) {
      at += random(90);
      const source = sources[random(3)] as (typeof sources)[number];
      [
        () => (pressed += Number(hold.press(source, AHEAD, at))),
        () => hold.release(source),
        () => hold.move(source, { speed: random(3) - 1, steering: random(2) ? 0 : Number.NaN }),
        () => hold.allow(random(2) ? null : "no"),
        () => hold.endedByRobot(pressed - random(2), "late"),
        () => hold.letGo("hidden"),
        () => hold.tick(at),
        () => hold.tick(at),
      ][random(8)]?.();
    }
    const over = new Set<number>();
    let last = 0;
    for (const each of said) {
      ok(each.seq === last + 1, "numbers have no gap");
      last = each.seq;
      ok(each.hold <= pressed && !over.has(each.hold), "it was pressed and is not over");
      if (each.type === "zero") over.add(each.hold);
    }
  }
});

/** Of each command whether it creeps. */
const creeps = (said: DriveCommand[]): boolean[] => said.flatMap((each) => (each.type === "drive" ? [each.creep ?? false] : []));

test("the second input is said with each command while it is held, and its end at once", () => {
  const { hold, said } = ready();
  hold.press("pad", AHEAD, 0);
  hold.second(true, 20);
  run(hold, 20, 160);
  deepEqual(creeps(said), [false, true, true, true]);
  ok(hold.creeping);
  hold.second(false, 165);
  deepEqual(said.at(-1), { type: "drive", hold: 1, seq: 5, t: 165, speed: 0.6, steering: 0 });
  ok(!hold.creeping);
  run(hold, 170, 300);
  deepEqual(creeps(said).slice(4), [false, false, false]);
});

test("the second input counts from a press while a hand drives, and ends with the hand", () => {
  const { hold, said } = ready();
  hold.second(true, 0);
  hold.press("pad", AHEAD, 10);
  run(hold, 10, 100);
  deepEqual(creeps(said), [false, false], "held before, it is no deliberate act");
  hold.second(true, 105);
  run(hold, 105, 160);
  hold.release("pad");
  equal(said.at(-1)?.type, "zero");
  hold.press("pad", AHEAD, 200);
  run(hold, 200, 300);
  deepEqual(creeps(said), [false, false, true, false, false], "it is not resumed");
  equal(said.length, 6);
});

test("a page that did not run for a moment ends the hold by the second input, too", () => {
  const { hold, said } = ready();
  hold.press("pad", AHEAD, 0);
  hold.second(true, STALL + 1);
  equal(kinds(said), "dz");
  equal(hold.creeping, false);
});
