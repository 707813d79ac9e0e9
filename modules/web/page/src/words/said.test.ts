import { deepEqual, equal, ok } from "node:assert/strict";
import { readdirSync, readFileSync } from "node:fs";
import { test } from "node:test";
import { fault } from "../panels/errors/faults";
import { FAULTS as KNOWN, HOLD } from "../numbers";
import type { DrivePart, HoldRow } from "../protocol";
import { drive } from "../state";
import { CS } from "./cs";
import { FAULTS, REMEDIES } from "./cs/faults";
import { hold, HOLDS } from "./cs/holds";
import { SENTENCES } from "./cs/robot";
import { words } from "./language";
import { holdRemedy, holdWords, said } from "./said";

const row = (code: number, subject = "", english = `words of ${code}`): HoldRow => ({
  module: "driver_canbus", code, name: "", subject, who: subject, words: english, remedy: "do it", latched: false, since: 0,
});

function inCzech(holds: HoldRow[], body: () => void): void {
  words.value = CS;
  drive.value = { holds } as unknown as DrivePart;
  try {
    body();
  } finally {
    words.value = null;
    drive.value = null;
  }
}
const plain = (text: string): string => text.replaceAll("\u00A0", " ");

test("every cause of docs/holds.md has its Czech sentence and what to do, with a subject where the English one has one", () => {
  const rows = [...readFileSync("../../../docs/holds.md", "utf8").matchAll(/^\| (\d+) \| (\w+) \| (.*?) \| .*? \| (.*?) \|$/gm)];
  equal(rows.length, Object.keys(HOLD).length);
  for (const [, number, name, sentence] of rows) {
    const found = hold({ code: Number(number), subject: "SUBJECT" });
    ok(found, name);
    equal(found?.words.includes("SUBJECT"), (sentence as string).includes("SUBJECT"), name);
    equal(/^\p{Ll}/u.test(HOLDS[Number(number) as keyof typeof HOLDS][0].replace("{}", "x")), true, `${name}: a sentence may stand after a colon`);
    ok(/^\p{Lu}.*\.$/u.test(found?.remedy ?? ""), `${name}: ${found?.remedy}`);
  }
  deepEqual(Object.keys(HOLDS).map(Number), Object.values(HOLD));
});

test("every fault of docs/faults.md has its Czech meaning, and what to do", () => {
  deepEqual(Object.keys(FAULTS).map(Number), [...KNOWN.keys()]);
  deepEqual(Object.keys(REMEDIES).map(Number), [...KNOWN.keys()]);
  for (const [number, remedy] of Object.entries(REMEDIES)) ok(/^\p{Lu}.*\.$/u.test(remedy), `${number}: ${remedy}`);
  inCzech([], () => deepEqual(Object.values(fault(0x0703)).map(plain), ["FanFailed", "Ventilátor se netočí, ačkoli má.", "Očistěte ventilátor a zkontrolujte jeho konektor, jinak jej vyměňte."]));
  equal(fault(0x0703).means, "A fan does not turn although it is driven.");
});

test("causes name their subject as people call it", () => {
  inCzech([], () => {
    equal(holdWords(row(HOLD.PauseBumper, "bumper3")), "je aktivní PAUSE: nárazník 3");
    equal(plain(holdRemedy(row(HOLD.PauseFloor, "sd1_front"))), "Odtlačte robota rukou zpět, až budou přední snímače podlahy nad rovnou podlahou.");
    equal(holdWords(row(HOLD.DriveFault, "propulsion")), "pohon pojezdu hlásí závadu");
    equal(holdWords(row(HOLD.DriveLost, "left")), "pohon left neodpovídá nebo vypadl z\u00A0provozu");
    equal(holdWords(row(HOLD.NotHomed, "steering")), "zatáčení ještě nezná výchozí polohu");
    equal(plain(holdWords(row(HOLD.Overruled, "web:Jana"))), "Jana (web) má nižší prioritu než ten, kdo řídí");
    equal(plain(holdWords(row(HOLD.Overruled, "drive@robot:812"))), "advee drive na počítači robot má nižší prioritu než ten, kdo řídí");
    equal(plain(holdWords(row(HOLD.InTheWay, "5.5, -5.7"))), "v cestě někdo stojí, místo 5,5; -5,7");
    equal(holdWords(row(999, "x", "of a later version")), "of a later version");
  });
  equal(holdWords(row(HOLD.PauseBumper, "bumper3", "PAUSE is engaged by bumper3")), "PAUSE is engaged by bumper3");
});

test("what the web server says is Czech where it is known, and stays as it is where it is not", () => {
  const propulsion = row(HOLD.DriveFault, "propulsion", "the propulsion drive is in fault");
  inCzech([propulsion], () => {
    const all: [string, string][] = [
      ["the propulsion drive is in fault, error code 0x2310", "pohon pojezdu hlásí závadu, kód chyby 0x2310"],
      ["the robot is stopping: the propulsion drive is in fault", "robot zastavuje: pohon pojezdu hlásí závadu"],
      ["0.53 m/s; commanded by Jana (web)", "0,53 m/s; řídí Jana (web)"],
      ["0.53 m/s; commanded by a terminal (advee diag)", "0,53 m/s; řídí terminál (advee diag)"],
      ["advee drive on robot", "advee drive na počítači robot"],
      ["Jana (web)", "Jana (web)"],
      ["PAUSE: the red button", "PAUSE: červené tlačítko"],
      ["the robot is at standstill without a command", "robot stojí a nemá žádný povel"],
      ["turns on the spot at 20 deg/s; commanded by planner", "otáčí se na místě, 20°/s; řídí plánovač"],
      ["the PAUSE line is engaged by bumper 2; release it, then resume", "je aktivní PAUSE: nárazník 2; uvolněte jej, pak zvolte Pokračovat"],
      ["planner is down: SIGKILL: killed; the robot does not move without it", "modul planner – neběží (SIGKILL: násilně ukončen); bez něj robot nejede"],
      ["creeping; otherwise must not move backward: nothing is known of sonar 3", "popojíždí; jinak nesmí se pohnout vzad: snímač sonar 3 nic neposílá"],
      ["waits for whoever stands in the way at 5.5, 5.7", "čeká: v cestě někdo stojí, místo 5,5; 5,7"],
      ["goal 7 refused: cannot reach waypoint 1: no way leads to the goal; the robot goes on to the goal before it", "k bodu 1 nedojede: k cíli nevede žádná cesta; robot jede dál k předchozímu cíli"],
      ["cannot reach waypoint 2: it is outside the map, which is 0…20.5 by -2…12 m", "k bodu 2 nedojede: leží mimo mapu (0 až 20,5 krát -2 až 12 m)"],
      ["3 of 16 range finders do not measure", "neměří 3 z 16 dálkoměrů"],
      ["Jana has taken over from you", "řízení od vás převzalo zařízení Jana"],
      ["The connection was lost, and with it the control.", "Spojení se přerušilo, a tím i řízení."],
      ["fan2 does not turn", "fan2 does not turn"],
      ["", ""],
    ];
    for (const [english, czech] of all) equal(plain(said(english)), czech, english);
  });
  equal(said("position lost"), "position lost");
});

test("each sentence is one of the robot's source", () => {
  const folders = ["../../../foundation/diagnostics/src", "../../../modules/web/src", "../../../modules/planner/src", "../../../messages/src", "../../../modules/drivers/src/canbus", "../../../foundation/module/src", "src"];
  const source = folders
    .flatMap((folder) => readdirSync(folder, { recursive: true }).map((path) => `${folder}/${path}`))
    .filter((path) => /\.rs$|^src\/(?!words\/).*\.tsx?$/.test(path))
    .map((path) => readFileSync(path, "utf8"))
    .join("\n")
    .replace(/\\\n\s*/g, "");
  for (const [pattern] of SENTENCES) {
    // The longest piece between what is filled in; brackets that are in the text are kept apart meanwhile.
    const kept = pattern.source.replaceAll("\\(", "\u0001").replaceAll("\\)", "\u0002");
    const pieces = kept.replace(/^\^|\$$/g, "").split(/\(.*?\)\??|\\S\+|\\d\+?|\.\*|\)\?/);
    const longest = pieces
      .map((piece) => piece.replaceAll("\u0001", "(").replaceAll("\u0002", ")").replace(/\\(.)/g, "$1").replace(/\?$| \($/, ""))
      .sort((one, other) => other.length - one.length)[0] as string;
    ok(longest.length < 3 || source.includes(longest), `${pattern}: “${longest}”`);
  }
});
