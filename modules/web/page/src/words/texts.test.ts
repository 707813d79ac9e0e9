// Every text of the page has its Czech one, and there is no Czech one without a text: by a walk over the source.
import { deepEqual, equal, ok } from "node:assert/strict";
import { readdirSync, readFileSync } from "node:fs";
import { createRequire } from "node:module";
import { test } from "node:test";
import type * as Typescript from "typescript";
import { TEXTS } from "./cs/page";

const ts = createRequire(`${(globalThis as unknown as { process: { cwd(): string } }).process.cwd()}/package.json`)("typescript") as typeof Typescript;

/** Without what shows nothing, is generated, or stays English: the views for engineers, and the artificial robot. */
const LEFT_OUT = /\.test\.ts$|\.d\.ts$|^(words|worker)\/|^(fixture|protocol|numbers|units)\.ts$|^panels\/(buses|messages|simulator|plot)\//;

/** Attributes in which nobody reads. */
const NO_TEXT = /^(class|d|viewBox|key|style|type|href|id|tone|kind)$/;
/** Several words, a word with a capital, or something that ends as a sentence does. */
const READ = [/\p{L}{2,}[,:;.]? \p{L}+/u, /^\p{Lu}\p{Ll}+[….!?]*$/u, /\p{L}.*[.!?…]$/u];
/** What looks like a text and is none: names of keys, fonts, queries, commands, names of languages and of faults. */
const NO_TEXTS = new Set([
  "Escape", "take over", "(prefers-color-scheme: dark)", "button, a, summary, [role=slider], canvas", "11px system-ui, sans-serif", "600 11px system-ui, sans-serif",
  "700 11px system-ui, sans-serif", "12px system-ui, sans-serif", "advee web code", "Language, jazyk", "English", "Čeština", "Uncaught", "Foreign", "Unknown",
  // Keys, a command line, and a line of a world's file.
  "Delete", "Backspace", "Enter", "advee up --sim --speed 1 --world ./", "# ---- drawn on the map; below this line the scenario editor writes anew",
  // With a number or a name, by cs/robot.ts.
  "the robot answered ",
]);

/** All literals of the page's source, and those among them that people read. */
function literals(): { all: Set<string>; read: Map<string, string> } {
  const all = new Set<string>();
  const read = new Map<string, string>();
  const files = readdirSync("src", { recursive: true }).filter((path) => /\.tsx?$/.test(path) && !LEFT_OUT.test(path));
  ok(files.length > 60, `${files.length} files`);
  for (const path of files) {
    const source = ts.createSourceFile(path, readFileSync(`src/${path}`, "utf8"), ts.ScriptTarget.ES2022, true, path.endsWith("x") ? ts.ScriptKind.TSX : ts.ScriptKind.TS);
    const visit = (node: Typescript.Node): void => {
      if (ts.isJsxText(node) && /\p{L}/u.test(node.text)) read.set(node.text.trim(), path);
      if (ts.isStringLiteralLike(node) || ts.isTemplateHead(node) || ts.isTemplateMiddleOrTemplateTail(node)) {
        all.add(node.text);
        if (!ts.isImportDeclaration(node.parent) && !NO_TEXT.test(attribute(node)) && READ.some((each) => each.test(node.text))) read.set(node.text, path);
      }
      ts.forEachChild(node, visit);
    };
    visit(source);
  }
  return { all, read };
}

/** The attribute that a literal is in; empty: none. */
function attribute(node: Typescript.Node): string {
  let at = node.parent;
  while (at && !ts.isJsxAttribute(at) && !ts.isJsxElement(at) && !ts.isStatement(at)) at = at.parent;
  return at && ts.isJsxAttribute(at) ? at.name.getText() : "";
}

const { all, read } = literals();

test("every text of the page has its Czech one", () => {
  const missing = [...read].filter(([text]) => !(text in TEXTS) && !NO_TEXTS.has(text));
  deepEqual(missing, []);
});

test("every Czech text is one of the page", () => {
  deepEqual(Object.keys(TEXTS).filter((text) => !all.has(text)), []);
  deepEqual([...NO_TEXTS].filter((text) => !read.has(text)), [], "exceptions that are none");
});

/** Names of values, each once. */
const names = (text: string): string[] => [...new Set([...text.matchAll(/\{(\w+)(?:\|[^}]*)?\}/g)].map(([, name]) => name as string))].sort();

test("both texts have the same values, and nouns that are counted have their three forms", () => {
  for (const [english, czech] of Object.entries(TEXTS)) {
    deepEqual(names(czech), names(english), english);
    ok(czech.trim() === czech && czech !== "", english);
    for (const [, forms] of czech.matchAll(/\{\w+\|([^}]*)\}/g)) ok([3, 4].includes(forms?.split("|").length ?? 0), `${english}: ${forms}`);
    const end = (text: string) => /[.!?…:]$/.exec(text)?.[0] ?? "";
    if (english !== "No.") equal(end(czech), end(english), english);
    equal(/["']/.test(czech), false, `${english}: „“`);
  }
});
