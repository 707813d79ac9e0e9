import { deepEqual } from "node:assert/strict";
import { test } from "node:test";
import { axes } from "./axes";

test("series of one unit share an axis, and those of another one have their own", () => {
  deepEqual(axes([]), { sides: [], left: "", right: null });
  deepEqual(axes(["m/s", "m/s"]), { sides: ["left", "left"], left: "m/s", right: null });
  deepEqual(axes(["m/s", "rad", "m/s"]), { sides: ["left", "right", "left"], left: "m/s", right: "rad" });
  deepEqual(axes(["", "rad", "V"]), { sides: ["left", "right", "right"], left: "", right: "" });
});
