// One module: all that is known of it, and its state commands.
import { Pause, Play, Power, Square } from "lucide-preact";
import { bytes, span } from "../../format";
import type { ModuleRow } from "../../protocol";
import { Button, Dialog, Facts, Slide } from "../../ui";
import { order } from "../../operate";
import { lacks } from "../lacks";
import { percent } from "../format";
import { announced, phase, State } from "./row";

type Target = "RUN" | "PAUSE" | "STOP" | "TERMINATE";

const COMMANDS = [
  { state: "RUN", verb: "Run", icon: Play, means: "It does its work." },
  { state: "PAUSE", verb: "Pause", icon: Pause, means: "It keeps its device safe and in contact, and does not act." },
  { state: "STOP", verb: "Stop", icon: Square, means: "As paused, and sensors are not polled. Only a command by hand leads out of it." },
  { state: "TERMINATE", verb: "Terminate", icon: Power, means: "Its process is ended, and kept down until it is to run." },
] as const;

export function ModuleDialog({ row, onClose }: { row: ModuleRow; onClose: () => void }) {
  const whyNot = lacks("engineer");
  const age = announced(row);
  const command = (state: Target) => order({ type: "state", module: row.module, state }, `${row.module} is commanded to ${state}.`);
  return (
    <Dialog title={row.module} open onClose={onClose}>
      <Facts
        facts={[
          { name: "State", value: <State row={row} /> },
          { name: "Wanted", value: row.wanted || "no watchdog guards it" },
          { name: "Process", value: row.pid ? `${phase(row)}, PID ${row.pid}` : phase(row) },
          { name: "Up", value: row.pid ? span(row.uptime) : "–" },
          { name: "Restarts", value: row.restarts },
          { name: "Last exit", value: row.last_exit || "–" },
          { name: "CPU", value: row.pid ? percent(row.cpu, 1) : "–" },
          { name: "Memory", value: row.pid ? bytes(row.rss) : "–" },
          { name: "Last message", value: age === null ? "never" : `${span(age)} ago` },
          { name: "Errors", value: row.faults === null ? "not known" : row.faults === 0 ? "none active" : `${row.faults} active` },
        ]}
      />
      {row.critical ? <p class="p-note">The robot does not move unless this module runs: what stops it is confirmed by a slide.</p> : null}
      <ul class="p-commands">
        {COMMANDS.map(({ state, verb, icon, means }) => (
          <li key={state}>
            {row.critical && state !== "RUN" ? (
              <Slide label={`${verb} ${row.module}`} tone="danger" whyNot={whyNot} onConfirm={() => command(state)} />
            ) : (
              <Button icon={icon} whyNot={whyNot} onClick={() => command(state)}>
                {verb}
              </Button>
            )}
            <p class="muted">{means}</p>
          </li>
        ))}
      </ul>
      {whyNot ? <p class="p-note">{whyNot}</p> : null}
    </Dialog>
  );
}
