import { equal } from "node:assert/strict";
import { test } from "node:test";
import { chosen, keysRest, restKeys } from "./rest";

test("after a slide by keys they drive again only when the pad was focused, or something pressed", () => {
  equal(keysRest(), false);
  restKeys();
  chosen("other");
  equal(keysRest(), true, "the focus that falls to Stop is no choice");
  chosen("pad");
  equal(keysRest(), false);
  restKeys();
  chosen("pointer");
  equal(keysRest(), false);
});
