// Builds the page into dist/: one script and one style sheet under names that say what is in them, so that a browser may keep
// them for good, and every file beside its compressed form. The robot's program takes dist/ in as it is (robot/build.rs).
import { build } from "esbuild";
import { mkdir, readFile, rm, writeFile, readdir } from "node:fs/promises";
import { gzipSync } from "node:zlib";

const out = "dist";
await rm(out, { recursive: true, force: true });
await mkdir(`${out}/assets`, { recursive: true });
const built = await build({
  entryPoints: ["src/main.tsx"],
  bundle: true,
  minify: true,
  format: "esm",
  target: ["es2022"],
  outdir: `${out}/assets`,
  entryNames: "[name]-[hash]",
  metafile: true,
  legalComments: "none",
  logLevel: "warning",
});
const outputs = Object.keys(built.metafile.outputs).map((path) => path.slice(out.length + 1));
const script = outputs.find((path) => path.endsWith(".js"));
const style = outputs.find((path) => path.endsWith(".css"));
const page = (await readFile("src/index.html", "utf8"))
  .replace("{script}", `/${script}`)
  .replace("{style}", style ? `<link rel="stylesheet" href="/${style}">` : "");
await writeFile(`${out}/index.html`, page);

let total = 0;
for (const entry of await readdir(out, { recursive: true, withFileTypes: true })) {
  if (!entry.isFile()) continue;
  const path = `${entry.parentPath ?? entry.path}/${entry.name}`;
  const packed = gzipSync(await readFile(path), { level: 9 });
  await writeFile(`${path}.gz`, packed);
  total += packed.length;
}
console.log(`web: ${outputs.length} files, ${(total / 1000).toFixed(1)} kB compressed`);
