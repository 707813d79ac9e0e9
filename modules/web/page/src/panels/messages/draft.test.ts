import { deepEqual, equal, ok } from "node:assert/strict";
import { test } from "node:test";
import { beginning, command, type Draft, wrong } from "./draft";

const OFFERS = [
  { channel: "LL_CMD_OUTPUT", type: "lowlevel.cmd_output_t", message: '{"timestamp":0,"name":"","value":0.0,"source":""}' },
  { channel: "LL_EVENT_STOP", type: "lowlevel.event_stop_t", message: '{"timestamp":0,"engaged":false,"source":""}' },
];
const HEARD = [
  { channel: "LL_CMD_MOTION", type: "lowlevel.cmd_motion_t" },
  { channel: "MY_LIGHTS", type: "" },
];

test("a text begins with the last message, else with an empty one, and never has what the server sets", () => {
  deepEqual(JSON.parse(beginning("LL_CMD_OUTPUT", null, OFFERS)), { name: "", value: 0 });
  deepEqual(JSON.parse(beginning("LL_CMD_OUTPUT", { timestamp: 5, name: "lamp", value: null, source: "web:Jana" }, OFFERS)), { name: "lamp", value: null });
  deepEqual(JSON.parse(beginning("LL_EVENT_STOP", null, OFFERS)), { engaged: false, source: "" }, "of a module's message the source is a field as any other");
  equal(beginning("MY_LIGHTS", null, OFFERS), "{}");
});

test("what the server would refuse is said before", () => {
  const draft = (change: Partial<Draft>): Draft => ({ channel: "LL_CMD_OUTPUT", type: "", text: '{"name": "lamp", "value": 1}', ...change });
  const why = (change: Partial<Draft>) => wrong(draft(change), OFFERS, HEARD);
  equal(why({}), null);
  equal(why({ channel: "MY_LIGHTS", type: "lowlevel.cmd_output_t" }), null);
  ok(/Choose a channel/.test(why({ channel: "" }) ?? ""));
  ok(/robot itself speaks/.test(why({ channel: "LL_CMD_MOTION" }) ?? ""));
  ok(/choose the type/.test(why({ channel: "MY_LIGHTS" }) ?? ""));
  ok(/no JSON/.test(why({ text: "{" }) ?? ""));
  for (const text of ["[]", "null", "1"]) ok(/is an object/.test(why({ text }) ?? ""), text);
  equal(why({ text: JSON.stringify({ name: "x".repeat(3900) }) }), null);
  ok(/too long/.test(why({ text: JSON.stringify({ name: "ž".repeat(2100) }) }) ?? ""), "bytes count, not letters");
});

test("blanks for people are not sent", () => {
  deepEqual(command({ channel: "A", type: "b", text: '{\n  "c": 1\n}' }), { type: "publish", channel: "A", message_type: "b", message: '{"c":1}' });
});
