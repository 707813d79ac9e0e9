// One module: all that is known of it, and its state commands.
import { Pause, Play, Power, Square } from "lucide-preact";
import { bytes, span } from "../../format";
import type { ModuleRow } from "../../protocol";
import { Button, Dialog, Facts, Slide } from "../../ui";
import { order } from "../../operate";
import { t } from "../../words";
import { level } from "../errors/words";
import { lacks } from "../lacks";
import { percent } from "../format";
import { announced, lastExit, phase, State } from "./row";

type Target = "RUN" | "PAUSE" | "STOP" | "TERMINATE";

const COMMANDS = [
  { state: "RUN", verb: "Run¦state", on: "Run {module}", icon: Play, means: "It does its work." },
  { state: "PAUSE", verb: "Pause", on: "Pause {module}", icon: Pause, means: "It keeps its device safe and in contact, and does not act." },
  { state: "STOP", verb: "Stop", on: "Stop {module}", icon: Square, means: "As paused, and sensors are not polled. Only a command by hand leads out of it." },
  { state: "TERMINATE", verb: "Terminate", on: "Terminate {module}", icon: Power, means: "Its process is ended, and kept down until it is to run." },
] as const;

export function ModuleDialog({ row, onClose }: { row: ModuleRow; onClose: () => void }) {
  const whyNot = lacks("engineer");
  const age = announced(row);
  const command = (state: Target) => order({ type: "state", module: row.module, state }, t("{module} is commanded to {state}.", { module: row.module, state }));
  return (
    <Dialog title={row.module} open onClose={onClose}>
      <Facts
        facts={[
          { name: t("State"), value: <State row={row} /> },
          { name: t("Wanted"), value: row.wanted || t("no watchdog guards it") },
          { name: t("Process"), value: row.pid ? `${phase(row)}, PID ${row.pid}` : phase(row) },
          { name: t("Up"), value: row.pid ? span(row.uptime) : "–" },
          { name: t("Restarts"), value: row.restarts },
          { name: t("Last exit"), value: lastExit(row) },
          { name: t("CPU"), value: row.pid ? percent(row.cpu, 1) : "–" },
          { name: t("Memory"), value: row.pid ? bytes(row.rss) : "–" },
          { name: t("Last message"), value: age === null ? t("never") : t("{time} ago", { time: span(age) }) },
          { name: t("Errors"), value: row.faults === null ? t("not known") : row.faults === 0 ? t("none active") : t("{n} active", { n: row.faults }) },
        ]}
      />
      {row.critical ? <p class="p-note">{t("The robot does not move unless this module runs: what stops it is confirmed by a slide.")}</p> : null}
      <ul class="p-commands">
        {COMMANDS.map(({ state, verb, on, icon, means }) => (
          <li key={state}>
            {row.critical && state !== "RUN" ? (
              <Slide label={t(on, { module: row.module })} tone="danger" whyNot={whyNot} onConfirm={() => command(state)} />
            ) : (
              <Button icon={icon} whyNot={whyNot} onClick={() => command(state)}>
                {t(verb)}
              </Button>
            )}
            <p class="muted">{t(means)}</p>
          </li>
        ))}
      </ul>
      <Levels row={row} whyNot={whyNot} />
      {whyNot ? <p class="p-note">{whyNot}</p> : null}
    </Dialog>
  );
}

/** Names of the levels, in the order of their values. */
const LEVELS = ["DEBUG", "INFO", "WARNING", "ERROR"];

/** From which level a module prints and sends its texts and reports. The module is asked when this is opened. */
function Levels({ row, whyNot }: { row: ModuleRow; whyNot: string | null }) {
  const ask = (print: string, send: string, done?: string) => order({ type: "level", module: row.module, print, send }, done);
  const change = (print: string, send: string) => void ask(print, send, t("{module} is commanded to change its levels.", { module: row.module }));
  return (
    <details class="p-levels" onToggle={(event) => event.currentTarget.open && whyNot === null && void ask("UNCHANGED", "UNCHANGED")}>
      <summary>{t("Levels of texts and reports")}</summary>
      <div class="p-form">
        <Threshold name={t("Printed from")} value={row.print_from} whyNot={whyNot} onChange={(print) => change(print, "UNCHANGED")} />
        <Threshold name={t("Sent from")} value={row.send_from} whyNot={whyNot} onChange={(send) => change("UNCHANGED", send)} />
        <Button whyNot={whyNot} onClick={() => change("CONFIGURED", "CONFIGURED")}>
          {t("As configured")}
        </Button>
      </div>
      {row.levels_changed ? <p class="p-note">{t("Changed until its process ends.")}</p> : null}
    </details>
  );
}

function Threshold({ name, value, whyNot, onChange }: { name: string; value: string; whyNot: string | null; onChange: (level: string) => void }) {
  return (
    <label class="field">
      {name}
      <select value={value} disabled={whyNot !== null} onChange={(event) => onChange(event.currentTarget.value)}>
        {value === "" ? <option value="">{t("not known")}</option> : null}
        {LEVELS.map((each, n) => (
          <option key={each} value={each}>
            {level({ level: n })[1]}
          </option>
        ))}
      </select>
    </label>
  );
}
