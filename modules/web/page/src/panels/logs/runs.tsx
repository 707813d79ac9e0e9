// The runs on the robot's disk: their files to download, and each as a demo.
import { signal } from "@preact/signals";
import { BookOpenText, ChartLine, Download, MonitorPlay, RotateCw } from "lucide-preact";
import { useEffect } from "preact/hooks";
import { bytes } from "../../format";
import type { LogRun, Refused } from "../../protocol";
import { demo } from "../../state";
import { t } from "../../words";
import { said } from "../../words/said";
import { count } from "../format";
import { Badge, Button, Card, type Column, Empty, Table } from "../../ui";
import { demoLink, fileLink, started } from "./names";
import { Report } from "./report";
import { summaries, summarize, words } from "./summary";

/** s between two looks at the disk. */
const AGAIN = 10;

const runs = signal<LogRun[] | null>(null);
const trouble = signal<string | null>(null);
/** The run whose picture is shown. */
const reported = signal<string | null>(null);

async function load(): Promise<void> {
  try {
    const response = await fetch("/api/logs", { headers: { Accept: "application/json" } });
    const body = (await response.json()) as LogRun[] | Refused;
    if (response.ok && Array.isArray(body)) {
      runs.value = body;
      trouble.value = null;
    } else {
      trouble.value = "why" in body ? body.why : `the robot answered ${response.status}`;
    }
  } catch {
    trouble.value = "the robot does not answer";
  }
}

const columns = (): Column<LogRun>[] => [
  {
    head: t("Run"),
    title: true,
    by: (run) => run.run,
    cell: (run) => (
      <span class="p-name">
        {started(run.run)}
        {run.recording ? <Badge tone="good">{t("recording")}</Badge> : null}
        {demo.value?.run === run.run ? <Badge tone="info">{t("playing")}</Badge> : null}
        <Figures run={run.run} />
      </span>
    ),
  },
  {
    head: t("Size"),
    figure: true,
    by: (run) => run.bytes,
    // The rest is what the modules took in, for the replay.
    cell: (run) => (
      <span title={t("All files of the run: its log, and the inputs of its modules, from which it is replayed")}>
        {bytes(run.bytes)}
        <br />
        <span class="muted">{t("log {size}", { size: bytes(logged(run)) })}</span>
      </span>
    ),
  },
  {
    head: t("Look at"),
    cell: (run) => (
      <span class="p-look">
        <a class="button quiet" href={demoLink(run.run)} aria-label={t("Play the run {run} on this page", { run: started(run.run) })}>
          <MonitorPlay size={20} aria-hidden />
          <span>{t("Play")}</span>
        </a>
        <button type="button" class="button quiet" aria-label={t("Report of the run {run}", { run: started(run.run) })} onClick={() => (reported.value = run.run)}>
          <ChartLine size={20} aria-hidden />
          <span>{t("Report")}</span>
        </button>
      </span>
    ),
  },
  {
    head: t("Files"),
    cell: (run) => (
      <details class="p-files" open={run.files.length <= 2}>
        <summary>{t("{n} {n|file|files}", { n: run.files.length })}</summary>
        <ul>
          {run.files.map((file) => (
            <li key={file.name}>
              <a class="p-download" href={fileLink(run.run, file.name)} download={`${run.run}_${file.name.replaceAll("/", "_")}`}>
                <Download size={16} aria-hidden />
                {file.name}
                <span class="muted">{bytes(file.bytes)}</span>
              </a>
            </li>
          ))}
        </ul>
      </details>
    ),
  },
];

/** Size of the log itself, bytes. */
function logged(run: LogRun): number {
  return run.files.filter((file) => file.name.endsWith(".mcap")).reduce((sum, file) => sum + file.bytes, 0);
}

function Figures({ run }: { run: string }) {
  const summary = summaries.value.get(run);
  return summary ? <span class="p-figures muted">{words(summary)}</span> : null;
}

export function Runs() {
  useEffect(() => {
    void load();
    const timer = setInterval(() => !document.hidden && void load(), 1000 * AGAIN);
    const gone = new AbortController();
    void summarize(() => runs.value ?? [], gone.signal);
    return () => (gone.abort(), clearInterval(timer));
  }, []);
  const total = runs.value?.reduce((sum, run) => sum + run.bytes, 0) ?? 0;
  return (
    <Card
      title={t("Runs")}
      class="p-runs"
      flush
      aside={
        <span class="p-aside">
          <span class="muted">{runs.value ? `${t("{n} {n|run|runs}", { n: count(runs.value.length) })}, ${bytes(total)}` : ""}</span>
          <Button kind="quiet" icon={RotateCw} label={t("Look again")} onClick={() => void load()} />
        </span>
      }
    >
      {trouble.value ? (
        <p class="p-pad" role="alert">
          <Badge tone="bad">{t("not listed")}</Badge> {t("The runs cannot be listed: {why}.", { why: said(trouble.value) })}
        </p>
      ) : null}
      {runs.value ? (
        <Table caption={t("Recorded runs, the newest first")} columns={columns()} rows={runs.value} id={(run) => run.run} empty={t("Nothing has been recorded.")} />
      ) : trouble.value ? null : (
        <Empty>{t("Asking the robot.")}</Empty>
      )}
      {reported.value ? <Report run={reported.value} onClose={() => (reported.value = null)} /> : null}
      <p class="muted p-pad">
        {t("Playing shows a run on this page as if it happened now, with a time line; nothing can be commanded then.")}
        <br />
        <a class="p-help" href="/foxglove-help">
          <BookOpenText size={16} aria-hidden />
          {t("How to open a run, or this robot live, in Foxglove")}
        </a>
      </p>
    </Card>
  );
}
