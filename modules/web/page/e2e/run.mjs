// Runs the tests of the page in a browser, or (--screenshots) takes its pictures for docs/pictures/web. Further arguments go to
// node: --test-name-pattern=map, say.
import { spawn } from "node:child_process";
import { rm } from "node:fs/promises";
import { build } from "esbuild";

const [mode, rest] = process.argv[2] === "--screenshots" ? ["screenshots", process.argv.slice(3)] : ["tests", process.argv.slice(2)];
// Below node_modules, so that what is not bundled is found.
const outdir = "node_modules/.e2e";
await rm(outdir, { recursive: true, force: true });
await build({
  entryPoints: [`e2e/${mode}.ts`],
  bundle: true,
  platform: "node",
  format: "esm",
  packages: "external",
  sourcemap: "inline",
  outdir,
  outExtension: { ".js": ".mjs" },
  logLevel: "warning",
});
const child = spawn(process.execPath, ["--enable-source-maps", ...rest, `${outdir}/${mode}.mjs`], { stdio: "inherit" });
for (const signal of ["SIGINT", "SIGTERM"]) process.on(signal, () => child.kill(signal));
child.on("exit", (code) => (process.exitCode = code ?? 1));
