import { deepEqual } from "node:assert/strict";
import { test } from "node:test";
import { offFrom } from "./layers";

test("what was kept is shown again; at first all but the sonars", () => {
  deepEqual([...offFrom(null)], ["sonar"]);
  deepEqual([...offFrom("")], []);
  deepEqual([...offFrom("plan,people,nonsense")], ["people", "plan"]);
});
