// Builds the page into dist/: one script, one of each language and one style sheet under names that say what is in them, so that
// a browser may keep them for good, and every file beside its compressed form. The robot's program takes dist/ in as it is (modules/web/build/page.rs).
// With --dev: a server for whoever works on the page, which builds anew at each load, with the fixture (?fixture).
import { createHash } from "node:crypto";
import { build, context } from "esbuild";
import { copyFile, mkdir, readFile, rm, writeFile, readdir } from "node:fs/promises";
import { gzipSync } from "node:zlib";
import { png } from "./icons.mjs";

const DEV = process.argv.includes("--dev");
const out = DEV ? "dev" : "dist";
await rm(out, { recursive: true, force: true });
await mkdir(`${out}/assets`, { recursive: true });
await mkdir(`${out}/icons`, { recursive: true });

const options = {
  entryPoints: ["src/main.tsx"],
  bundle: true,
  minify: !DEV,
  sourcemap: DEV,
  format: "esm",
  charset: "utf8",
  splitting: true,
  target: ["es2022"],
  outdir: `${out}/assets`,
  entryNames: DEV ? "[name]" : "[name]-[hash]",
  chunkNames: "[name]-[hash]",
  define: { DEV: String(DEV) },
  metafile: true,
  legalComments: "none",
  logLevel: "warning",
};

async function page(script, style) {
  const page = (await readFile("src/index.html", "utf8"))
    .replace("{script}", `/${script}`)
    .replace("{style}", style ? `<link rel="stylesheet" href="/${style}">` : "");
  await writeFile(`${out}/index.html`, page);
}

/** What makes it an application of its own on phone and desk: its name, its icons. */
async function installable() {
  await copyFile("src/icon.svg", `${out}/icons/icon.svg`);
  for (const size of [180, 192, 512]) await writeFile(`${out}/icons/icon-${size}.png`, png(size));
  await copyFile("src/manifest.json", `${out}/manifest.webmanifest`);
}

if (DEV) {
  await installable();
  await page("assets/main.js", "assets/main.css");
  const building = await context(options);
  await building.watch();
  const port = Number(process.env.PORT ?? 8090);
  await building.serve({ servedir: out, host: "127.0.0.1", port });
  console.log(`web: http://127.0.0.1:${port}/?fixture`);
} else {
  const built = await build(options);
  const outputs = Object.keys(built.metafile.outputs).map((path) => path.slice(out.length + 1));
  const script = outputs.find((path) => /^assets\/main-.*\.js$/.test(path));
  const languages = outputs.filter((path) => path.endsWith(".js") && path !== script);
  const style = outputs.find((path) => path.endsWith(".css"));
  await page(script, style);
  await installable();

  // The service worker keeps what the page consists of, under a name that changes with any of it.
  const shell = [`/${script}`, ...languages.map((path) => `/${path}`), `/${style}`, "/manifest.webmanifest", "/icons/icon.svg", "/icons/icon-192.png", "/icons/icon-512.png"];
  const digest = createHash("sha256");
  for (const path of ["/index.html", ...shell]) digest.update(await readFile(`${out}${path}`));
  const version = digest.digest("hex").slice(0, 12);
  await build({
    entryPoints: ["src/worker/sw.ts"],
    bundle: true,
    minify: true,
    target: ["es2022"],
    outfile: `${out}/sw.js`,
    define: { VERSION: JSON.stringify(version), SHELL: JSON.stringify(["/", ...shell]) },
    legalComments: "none",
    logLevel: "warning",
  });

  let total = 0;
  let files = 0;
  for (const entry of await readdir(out, { recursive: true, withFileTypes: true })) {
    if (!entry.isFile()) continue;
    const path = `${entry.parentPath ?? entry.path}/${entry.name}`;
    const packed = gzipSync(await readFile(path), { level: 9 });
    await writeFile(`${path}.gz`, packed);
    total += packed.length;
    files += 1;
  }
  console.log(`web: ${files} files, ${(total / 1000).toFixed(1)} kB compressed`);
}
