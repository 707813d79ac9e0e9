import { deepEqual, equal } from "node:assert/strict";
import { test } from "node:test";
import { bytes, day, deg, num, span } from "../format";
import { positionWords, goalWords, guardWords, measureWords } from "../map/words";
import { against, count, figure, minutes } from "../panels/format";
import { words as figures } from "../panels/logs/summary";
import type { DataGoal, DrivePart, RunSummary } from "../protocol";
import { battery } from "../shell/health";
import { filled, rich, t } from ".";
import { CS, tied } from "./cs";
import { language, preferred, words } from "./language";

/** Runs it in Czech. */
function inCzech(body: () => void): void {
  words.value = CS;
  try {
    body();
  } finally {
    words.value = null;
  }
}

/** Blanks that no line ends at, as others. */
const plain = (text: string): string => text.replaceAll("\u00A0", " ");

test("the language is the first of the browser's that the page has; Slovaks read Czech", () => {
  const lists = [["cs-CZ", "en"], ["sk"], ["en-GB", "cs"], ["de-DE", "cs"], ["de"], [], ["csb"]];
  deepEqual(lists.map(preferred), ["cs", "cs", "en", "cs", "en", "en", "en"]);
});

test("a text is English until the words of another language are here", () => {
  equal(language.value, "en");
  equal(t("Take control"), "Take control");
  equal(t("Run¦state"), "Run");
  inCzech(() => {
    equal(language.value, "cs");
    equal(t("Take control"), "Převzít řízení");
    deepEqual([t("Run¦state"), t("Run")], ["Spustit", "Záznam"]);
    equal(t("{name} has control", { name: "Jana" }), "Řízení má Jana");
  });
  equal(t("{name} has control", { name: "Jana" }), "Jana has control");
  deepEqual(rich("It is {state} and draws {current}.", { state: "on", current: "1 A" }), ["It is ", "on", " and draws ", "1 A", "."]);
});

test("nouns have the forms of their numbers: 1, 2 to 4, 5 and more, and of decimals", () => {
  const runs = (n: number) => t("{n} {n|run|runs}", { n: count(n) });
  deepEqual([0, 1, 2, 12].map(runs), ["0 runs", "1 run", "2 runs", "12 runs"]);
  inCzech(() => {
    const all = [0, 1, 2, 4, 5, 11, 22, 101, 1234].map(runs).map(plain);
    deepEqual(all, ["0 záznamů", "1 záznam", "2 záznamy", "4 záznamy", "5 záznamů", "11 záznamů", "22 záznamů", "101 záznamů", "1\u202F234 záznamů"]);
    deepEqual([1, 2.5, "2,5", "1,0"].map((n) => filled("{n|minuta|minuty|minut|minuty}", { n }, CS.form)), ["minuta", "minuty", "minuty", "minuta"]);
    const within = (n: number) => plain(t("It pairs one device as an operator's within {n} minutes.", { n }));
    deepEqual([1, 10].map((n) => within(n).replace(/.*během /, "")), ["1 minuty.", "10 minut."]);
    const run: RunSummary = { seconds: 1213, distance: 94.2, contacts: 2, stops: 1, errors: 5, warnings: 0 };
    equal(plain(figures(run)), "20 min 13 s, 94,2 m, 2 dotyky, 1 zastavení, 5 chyb");
  });
});

test("Czech figures have a comma, and stay with their unit", () => {
  inCzech(() => {
    deepEqual([num(1.234, 2, "m/s"), num(-0.5, 1), num(null, 1, "V"), deg(0.1, 1)], ["1,23\u00A0m/s", "−0,5", "–", "5,7°"]);
    deepEqual([0.25, 3.21, 59.4, 22_440, 180_000].map(span), ["0,3\u00A0s", "3,2\u00A0s", "59\u00A0s", "6\u00A0h 14\u00A0min", "2\u00A0d 2\u00A0h"]);
    deepEqual([999, 1234].map(bytes), ["999\u00A0B", "1,2\u00A0kB"]);
    deepEqual([figure(0.5), figure(-1.5e-7)], ["0,5", "−1,5e−7"]);
    deepEqual([against(36, 60, "°C"), minutes(59), minutes(null)].map(plain), ["36,0 z 60 °C", "méně než minuta", "není známo"]);
    equal(day(2026, 5, 7), "7.\u00A05.\u00A02026");
  });
  equal(day(2026, 5, 7), "2026-05-07");
});

test("no line ends after a word of one letter, nor between a number and what it counts", () => {
  equal(tied("k bodu a v poli, V cestě; O 10 s zpět do 3 s"), "k\u00A0bodu a\u00A0v\u00A0poli, V\u00A0cestě; O\u00A010\u00A0s\u00A0zpět do 3\u00A0s");
  equal(tied("{n} {n|bod|body|bodů} za {most} ms"), "{n}\u00A0{n|bod|body|bodů} za {most}\u00A0ms");
  equal(tied("modul neběží"), "modul neběží");
});

test("sentences with figures are Czech ones", () => {
  const estimate = { timestamp: 0, x: 1.234, y: -2, theta: Math.PI / 2, speed: 0, rotation: 0, covariance: [], quality: 3 };
  const part = {
    estimate: { age: 0, period: 0.05, freshness: "fresh", value: estimate },
    ellipse: { long: 0.1, short: 0.05, angle: 0, heading: 0.02 },
    bound: { words: "at most 0.32 m/s forward: sonar 3", speed: 0.32, limits: true, creeping: false },
    guard: { value: { fields: [{ kind: 1, occupied: true }] } },
    motion: { value: null },
    commands: [],
    velocity_commands: [],
  } as unknown as DrivePart;
  const goal: DataGoal = { timestamp: 0, id: 1, waypoint: 3, status: 1, remaining: 2.04, message: "" };
  inCzech(() => {
    equal(plain(positionWords(part)), "Poloha 1,23; −2,00 m, směr 90°; přesná, ±0,10 m a ±1,1°.");
    equal(plain(guardWords(part)), "Nejvýše 0,32 m/s vpřed: sonar 3. Ve výstražném poli něco je.");
    equal(plain(goalWords(goal)), "Jede k bodu 4, zbývá 2,0 m.");
    equal(plain(goalWords({ ...goal, message: "drives to waypoint 4 of 12, for ever" })), "Jede k bodu 4 z 12, stále dokola, zbývá 2,0 m.");
    equal(plain(measureWords([{ x: 1, y: 1 }, { x: 4, y: 5 }, { x: 4, y: 3 }])), "7,00 m, 2 úseky, poslední 2,00 m, směr −90°.");
    equal(plain(battery({ charge: 0.71, remaining: 22440 } as Parameters<typeof battery>[0] & object).title), "Baterie 71\u202F%, zbývá 6 h 14 min");
  });
});
