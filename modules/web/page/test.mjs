// Runs the unit tests, src/**/*.test.ts, with node's own runner.
import { spawnSync } from "node:child_process";
import { mkdtemp, readdir, rm } from "node:fs/promises";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { build } from "esbuild";

const tests = (await readdir("src", { recursive: true })).filter((path) => path.endsWith(".test.ts"));
const outdir = await mkdtemp(join(tmpdir(), "advee-web-"));
try {
  await build({
    entryPoints: tests.map((path) => `src/${path}`),
    bundle: true,
    platform: "node",
    format: "esm",
    outdir,
    outbase: "src",
    outExtension: { ".js": ".mjs" },
    define: { DEV: "false" },
    logLevel: "warning",
  });
  const files = tests.map((path) => join(outdir, path.replace(/\.ts$/, ".mjs")));
  process.exitCode = spawnSync(process.execPath, ["--test", ...files], { stdio: "inherit" }).status ?? 1;
} finally {
  await rm(outdir, { recursive: true });
}
