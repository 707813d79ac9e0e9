import { deepEqual } from "node:assert/strict";
import { test } from "node:test";
import { outline } from "./qr";

test("each run of dark modules is a rectangle within the margin", () => {
  deepEqual(outline(["101", "000", "011"]), { path: "M4 4h1v1h-1zM6 4h1v1h-1zM5 6h2v1h-2z", side: 11 });
  deepEqual(outline([]), { path: "", side: 8 });
});
