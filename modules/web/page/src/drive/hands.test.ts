import { deepEqual, equal } from "node:assert/strict";
import { test } from "node:test";
import { Gamepads, Keys } from "./hands";

test("keys add up, opposite ones cancel, and the last one up is the release", () => {
  const keys = new Keys();
  deepEqual(keys.down("ArrowUp", false), { act: "press", wish: { speed: 1, steering: 0 } });
  deepEqual(keys.down("KeyA", false), { act: "move", wish: { speed: 1, steering: 1 } });
  deepEqual(keys.down("ArrowDown", false), { act: "move", wish: { speed: 0, steering: 1 } });
  deepEqual(keys.up("ArrowUp"), { act: "move", wish: { speed: -1, steering: 1 } });
  deepEqual(keys.up("ArrowDown"), { act: "move", wish: { speed: 0, steering: 1 } });
  deepEqual(keys.up("KeyA"), { act: "release" });
});

test("a repeat is no press, and a key that is unknown is none", () => {
  const keys = new Keys();
  equal(keys.down("ArrowUp", true), null);
  equal(keys.down("KeyQ", false), null);
  equal(keys.up("ArrowUp"), null);
});

test("after a lost key-up the key's repeats move nothing until it is pressed anew", () => {
  const keys = new Keys();
  keys.down("KeyW", false);
  deepEqual(keys.lost(), { act: "release" });
  equal(keys.down("KeyW", true), null);
  equal(keys.lost(), null);
  deepEqual(keys.down("KeyW", false), { act: "press", wish: { speed: 1, steering: 0 } });
});

test("Q and E go sideways where the base can", () => {
  const keys = new Keys();
  keys.sideways = true;
  deepEqual(keys.down("KeyQ", false), { act: "press", wish: { speed: 0, steering: 0, sideways: 1 } });
  deepEqual(keys.down("KeyW", false), { act: "move", wish: { speed: 1, steering: 0, sideways: 1 } });
  deepEqual(keys.down("KeyE", false), { act: "move", wish: { speed: 1, steering: 0, sideways: 0 } });
});

const MIDDLE = { second: false, speed: 0, steering: 0 };
const STILL = { speed: 0, steering: 0 };

test("a gamepad drives while its button is held, from the middle on", () => {
  const pads = new Gamepads();
  equal(pads.read({ deadMan: false, ...MIDDLE }), null);
  deepEqual(pads.read({ deadMan: true, ...MIDDLE }), { act: "press", wish: STILL });
  deepEqual(pads.read({ ...MIDDLE, deadMan: true, speed: 1, steering: 0.05 }), { act: "move", wish: { speed: 1, steering: 0 } });
  deepEqual(pads.read({ ...MIDDLE, deadMan: false, speed: 1 }), { act: "release" });
});

test("a button that was held when it appeared, or came back, must be let go first", () => {
  const pads = new Gamepads();
  equal(pads.read({ deadMan: true, ...MIDDLE }), null);
  pads.read({ deadMan: false, ...MIDDLE });
  pads.read({ deadMan: true, ...MIDDLE });
  deepEqual(pads.read(null), { act: "release" });
  equal(pads.read({ deadMan: true, ...MIDDLE }), null);
});

test("a press with a stick pushed, and a hold that ended, need the button let go", () => {
  const pads = new Gamepads();
  pads.read({ deadMan: false, ...MIDDLE });
  equal(pads.read({ ...MIDDLE, deadMan: true, speed: 0.5 }), null);
  equal(pads.read({ deadMan: true, ...MIDDLE }), null);
  pads.read({ deadMan: false, ...MIDDLE });
  equal(pads.read({ deadMan: true, ...MIDDLE })?.act, "press");
  pads.over();
  equal(pads.read({ ...MIDDLE, deadMan: true, speed: 1 }), null);
});

test("both shoulders are the second input, from a press on while one of them drives", () => {
  const pads = new Gamepads();
  const see = (deadMan: boolean, second: boolean) => {
    const stick = { ...STILL, deadMan, second };
    const act = pads.read(stick)?.act ?? null;
    return [act, pads.second(stick)];
  };
  deepEqual(see(false, false), [null, null]);
  deepEqual(see(true, false), ["press", null]);
  deepEqual(see(true, true), ["move", true]);
  deepEqual(see(true, true), ["move", null]);
  deepEqual(see(true, false), ["move", false]);
  deepEqual(see(false, false), ["release", null]);
  // Pressed together, or before, it is no deliberate act.
  deepEqual(see(true, true), ["press", null]);
  deepEqual(see(true, true), ["move", null]);
  deepEqual(see(true, false), ["move", false]);
  deepEqual(see(true, true), ["move", true]);
  // A hold that ended takes it along.
  pads.over();
  deepEqual(see(true, true), [null, null]);
});
