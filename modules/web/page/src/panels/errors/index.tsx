// What went wrong, the reports of one fault and subject together; and what modules say.
import { signal } from "@preact/signals";
import { Search } from "lucide-preact";
import type { ErrorGroup, HoldRow, Text } from "../../protocol";
import { standing as holding } from "../../holds";
import { drive, system } from "../../state";
import { Badge, Button, Card, type Column, Empty, Table } from "../../ui";
import { rich, t } from "../../words";
import { holdRemedy, holdWords } from "../../words/said";
import { count, moment } from "../format";
import { lost } from "../lacks";
import { fault } from "./faults";
import { Details } from "./details";
import { stopOf, stops } from "./stops";
import { about, hasAll, level, severity, standing as is } from "./words";
import "../panels.css";

const filter = signal("");
const standingOnly = signal(false);
const gravely = signal(false);
/** The fault whose details are shown. */
const opened = signal<string | null>(null);
const key = (group: ErrorGroup): string => `${group.module} ${group.number} ${group.subject}`;

function found(group: ErrorGroup, words: string[]): boolean {
  return hasAll([group.module, about(group), group.cause, group.message, severity(group)[1]], words);
}

function Is({ group }: { group: ErrorGroup }) {
  switch (is(group)) {
    case "stands":
      return <Badge tone={severity(group)[0]}>{t("active")}</Badge>;
    case "unknown":
      return <Badge tone="warn">{t("not known")}</Badge>;
    case "over":
      return <Badge tone="off">{t("cleared")}</Badge>;
  }
}

const columns = (): Column<ErrorGroup>[] => [
  {
    head: t("What"),
    title: true,
    by: (group) => group.cause || group.message,
    cell: (group) => (
      <button type="button" class="p-link p-what" aria-haspopup="dialog" onClick={() => (opened.value = key(group))}>
        <span>{group.cause || group.message || fault(group.number).means}</span>
        <span class="muted">
          <b>{about(group)}</b>
          {group.standing || group.message === group.cause ? `: ${fault(group.number).means}` : group.message && `, ${t("cleared")}: ${group.message}`}
        </span>
        {group.standing && fault(group.number).remedy ? <span>{fault(group.number).remedy}</span> : null}
      </button>
    ),
  },
  {
    head: t("Status"),
    by: (group) => ["stands", "unknown", "over"].indexOf(is(group)),
    cell: (group) => <Is group={group} />,
  },
  { head: t("Severity"), by: (group) => -group.severity, cell: (group) => severity(group)[1] },
  { head: t("Module"), by: (group) => group.module, cell: (group) => group.module },
  { head: t("Count"), figure: true, by: (group) => group.count, cell: (group) => count(group.count) },
  { head: t("First seen"), figure: true, by: (group) => group.first, cell: (group) => moment(group.first) },
  { head: t("Last seen"), figure: true, by: (group) => group.last, cell: (group) => moment(group.last) },
];

/** How many stand that are more than a notice: what the navigation shows. */
export function standing(): number {
  return system.value?.errors.filter((group) => group.standing && group.severity > 0).length ?? 0;
}

function Summary() {
  const now = standing();
  if (lost()) return <Badge tone="off">{t("not known now")}</Badge>;
  return now ? <Badge tone="bad">{t("{n} active", { n: now })}</Badge> : <Badge tone="good">{t("none active")}</Badge>;
}

/** What stops the robot, with what to do, over the errors that belong to it. */
function heading(row: HoldRow): string {
  return t("Stops the robot: {words}. {remedy}", { words: holdWords(row), remedy: holdRemedy(row) });
}

/** Rows under what stops the robot; nothing where none of them belongs to a stop. */
function under(rows: ErrorGroup[]): { of: (group: ErrorGroup) => string; heads: string[] } | undefined {
  const causes = lost() ? [] : holding(drive.value?.holds ?? []);
  const found = stops(rows, causes);
  if (found.length === 0) return undefined;
  const others = t("Other errors");
  const of = (group: ErrorGroup): string => {
    const row = stopOf(group, causes);
    return row ? heading(row) : others;
  };
  return { of, heads: [...new Set(found.map(heading)), others] };
}

const TEXT_KEYS = (text: Text, place: number) => `${text.timestamp} ${text.module} ${place}`;

/** What modules say, the latest first. */
function Texts({ words }: { words: string[] }) {
  const texts = (system.value?.texts ?? []).filter((text) => !gravely.value || text.level >= 2);
  const rows = texts.filter((text) => hasAll([text.module, text.text, level(text)[1]], words));
  return (
    <Card title={t("Texts")} class="p-three" flush>
      <div class="p-bar">
        <Button pressed={gravely.value} onClick={() => (gravely.value = !gravely.value)}>
          {t("Warnings and errors only")}
        </Button>
        <p class="muted p-grow">{t("What modules have to say, the latest first; a hundred of them are shown here, all are in the log.")}</p>
      </div>
      {rows.length === 0 ? <p class="empty">{texts.length ? t("None of them matches.") : t("Nothing has been said since the server started.")}</p> : null}
      <ol class={`p-texts ${lost() ? "is-stale" : ""}`} tabIndex={0} aria-label={t("texts of the modules")}>
        {rows.map((text, place) => (
          <li key={TEXT_KEYS(text, place)}>
            <time>{moment(text.timestamp)}</time>
            <b>{text.module}</b>
            <span>
              {text.level === 1 ? null : <Badge tone={level(text)[0]}>{level(text)[1]}</Badge>} {text.text}
            </span>
          </li>
        ))}
      </ol>
    </Card>
  );
}

export function Errors() {
  const groups = system.value?.errors;
  if (!groups) return <Empty>{t("No data yet.")}</Empty>;
  const words = filter.value.toLowerCase().split(/\s+/).filter(Boolean);
  const chosen = groups.find((group) => key(group) === opened.value);
  const rows = groups.filter((group) => (group.standing || !standingOnly.value) && found(group, words));
  return (
    <div class="stack">
      <Card title={t("Errors")} class="p-three" flush aside={<Summary />}>
        <div class="p-bar">
          <label class="p-search">
            <Search size={18} aria-hidden />
            <span class="visually-hidden">{t("Filter by module, number or words")}</span>
            <input
              type="search"
              value={filter.value}
              placeholder={t("Module, number or words")}
              onInput={(event) => (filter.value = event.currentTarget.value)}
            />
          </label>
          <Button pressed={standingOnly.value} onClick={() => (standingOnly.value = !standingOnly.value)}>
            {t("Active only")}
          </Button>
          <p class="muted p-grow">
            {rich("A fault is {active} until its module reports it {cleared}; while the module does not run it is {unknown}. Open a row for its reports.", {
              active: <b>{t("active")}</b>,
              cleared: <b>{t("cleared")}</b>,
              unknown: <b>{t("not known")}</b>,
            })}{" "}
            {t("Cleared faults stay here with their count; nothing needs to be acknowledged.")}
          </p>
        </div>
        <Table
          caption={t("Errors by kind")}
          columns={columns()}
          rows={rows}
          groups={under(rows)}
          id={key}
          stale={(group) => lost() || is(group) !== "stands"}
          empty={groups.length ? t("None of them matches.") : t("Nothing is active, and nothing has been reported since the server started.")}
        />
      </Card>
      {chosen ? <Details group={chosen} onClose={() => (opened.value = null)} /> : null}
      <Texts words={words} />
    </div>
  );
}
