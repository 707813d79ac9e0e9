// One fault: its cause, its reports, what else was reported at the time, and the recorded run from there on.
import { MonitorPlay } from "lucide-preact";
import type { ErrorGroup, Report } from "../../protocol";
import { standing as holding } from "../../holds";
import { demo, drive, may, system } from "../../state";
import { momentLink } from "../../timeline/moments";
import { Badge, Dialog, Facts } from "../../ui";
import { t } from "../../words";
import { holdWords } from "../../words/said";
import { count, moment } from "../format";
import { begun, started } from "../logs/names";
import { lost } from "../lacks";
import { fault, place } from "./faults";
import { stopOf } from "./stops";
import { about, beside, of, severity, standing } from "./words";

/** s before a report from which on the run is played. */
const BEFORE = 5;

export function Details({ group, onClose }: { group: ErrorGroup; onClose: () => void }) {
  const reports = system.value?.reports ?? [];
  const own = reports.filter((report) => of(group, report));
  const others = beside(group, reports);
  const stop = lost() ? null : stopOf(group, holding(drive.value?.holds ?? []));
  const { means, remedy } = fault(group.number);
  const { file, entry } = place(group.number);
  const log = system.value?.log.value;
  const at = log?.run ? group.last / 1e6 - begun(log.run) : NaN;
  return (
    <Dialog title={about(group)} open onClose={onClose}>
      <p>
        <b>{group.cause || group.message || means}</b>
      </p>
      {group.message && group.message !== group.cause && group.cause ? <p>{t("Last report: {message}", { message: group.message })}</p> : null}
      <p class="muted">{means}</p>
      {remedy ? <p>{t("What to do: {remedy}", { remedy })}</p> : null}
      {stop ? <p>{t("It belongs to what stops the robot: {words}.", { words: holdWords(stop) })}</p> : null}
      <Facts
        facts={[
          { name: t("Module"), value: group.module },
          { name: t("Status"), value: { stands: t("active"), unknown: t("not known"), over: t("cleared") }[standing(group)] },
          { name: t("Severity"), value: severity(group)[1] },
          { name: t("Reports"), value: count(group.count) },
          { name: t("First"), value: moment(group.first) },
          { name: t("Last"), value: moment(group.last) },
        ]}
      />
      <Reports title={t("Its reports")} rows={own} />
      <Reports title={t("Reported within 2 s of it")} rows={others} named />
      <div class="row">
        {log?.run && !demo.value && at >= 0 ? (
          <a class="button" href={momentLink(log.run, Math.max(0, at - BEFORE), "#/map")} aria-label={t("Play the run {run} from this report on", { run: started(log.run) })}>
            <MonitorPlay size={20} aria-hidden /> <span>{t("Play from here")}</span>
          </a>
        ) : null}
        <a class="button" href="#/modules" onClick={onClose}>
          {t("Modules")}
        </a>
      </div>
      <p class="muted">{t("In the documentation: {file}, {entry}.", { file, entry })}</p>
    </Dialog>
  );
}

function Reports({ title, rows, named }: { title: string; rows: Report[]; named?: boolean }) {
  if (rows.length === 0) return null;
  return (
    <>
      <h3>{title}</h3>
      <ol class="p-reports">
        {rows.map((row, n) => (
          <li key={n}>
            <time class="figure">{moment(row.timestamp)}</time>
            <span>
              {row.severity === 0 ? <Badge tone="off">{t("cleared")}</Badge> : null} {row.fatal ? <Badge tone="bad">{t("fatal")}</Badge> : null}{" "}
              {named ? <b>{row.module}: </b> : null}
              {row.message}
              {row.file && may("engineer") ? <small class="p-source">{`${row.file}:${row.line}`}</small> : null}
            </span>
          </li>
        ))}
      </ol>
    </>
  );
}
