import { deepEqual, equal } from "node:assert/strict";
import { test } from "node:test";
import { FAULTS } from "../numbers";
import { follow, type Follows, GOAL_REFUSED, refusal } from "./follow";

test("a goal that was sent is shown while it is the robot's, whoever sends another one", () => {
  const sent: Follows = { since: 10 };
  const goal = (id: number, status: number) => ({ id, status });
  // The planner still has the goal before it.
  deepEqual(follow(sent, 7, goal(7, 1), 10.1), sent);
  deepEqual(follow(sent, 7, goal(8, 1), 10.2), { id: 8 });
  deepEqual(follow({ id: 8 }, 7, goal(8, 3), 20), { id: 8 }, "blocked on the way it is still the goal");
  equal(follow({ id: 8 }, 7, goal(8, 2), 30), "over", "reached");
  equal(follow({ id: 8 }, 7, goal(9, 1), 30), "over", "another one is driven to");
  equal(follow({ id: 8 }, 7, null, 30), "over");
  equal(follow(sent, 7, goal(7, 4), 14), "over", "it was never taken");
});

test("the latest refusal is found by its number", () => {
  equal(FAULTS.get(GOAL_REFUSED)?.name, "GoalRefused");
  deepEqual(refusal([{ number: 0x0703, timestamp: 3 }, { number: GOAL_REFUSED, timestamp: 2 }, { number: GOAL_REFUSED, timestamp: 1 }]), { number: GOAL_REFUSED, timestamp: 2 });
  equal(refusal([]), null);
});
