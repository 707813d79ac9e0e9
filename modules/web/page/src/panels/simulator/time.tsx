// The time of a simulation that was started with --speed: it stands still, passes, or begins anew.
import { Clock, Pause, Play, RotateCcw, StepForward } from "lucide-preact";
import { num } from "../../format";
import type { DataRun } from "../../protocol";
import { fresh, system } from "../../state";
import { Badge, Button, Card, Facts } from "../../ui";
import { order } from "../../operate";
import { lacks } from "../lacks";
import { inWords, offered } from "./speeds";

const say = (action: "pause" | "run" | "speed" | "step" | "reset", value = 0) => void order({ type: "simulation", action, value });

export function TimeCard() {
  const run = fresh(system.value?.run);
  // A simulation in real time takes no such commands.
  return run ? <Controls run={run} /> : null;
}

function Controls({ run }: { run: DataRun }) {
  const whyNot = lacks("engineer");
  const rate = fresh(system.value?.clock)?.rate;
  const facts = [
    { name: "World", value: run.world },
    { name: "Achieved", value: rate === undefined || rate === null ? "–" : num(rate, 2, "×") },
    { name: "In step", value: run.in_step.join(", ") || "none" },
    { name: "Not in step", value: run.not_in_step.join(", ") || "none" },
    { name: "Refused motion commands", value: String(run.refused) },
  ];
  return (
    <Card title="Time" icon={Clock} aside={<Badge tone={run.paused ? "warn" : "info"}>{run.paused ? "stands still" : "passes"}</Badge>}>
      <p class="row">
        {run.paused ? (
          <Button kind="primary" icon={Play} whyNot={whyNot} onClick={() => say("run")}>
            Run
          </Button>
        ) : (
          <Button icon={Pause} whyNot={whyNot} onClick={() => say("pause")}>
            Pause
          </Button>
        )}
        <Button icon={StepForward} whyNot={whyNot} onClick={() => say("step")}>
          Step 50 ms
        </Button>
        <Button icon={StepForward} whyNot={whyNot} onClick={() => say("step", 1)}>
          Step 1 s
        </Button>
        <Button kind="danger" icon={RotateCcw} whyNot={whyNot} onClick={() => say("reset")}>
          Reset
        </Button>
      </p>
      <label class="field">
        Speed
        <select disabled={whyNot !== null} value={String(run.speed)} onChange={(event) => say("speed", Number(event.currentTarget.value))}>
          {offered(run.speed).map((speed) => (
            <option key={speed} value={String(speed)}>
              {inWords(speed)}
            </option>
          ))}
        </select>
      </label>
      <Facts facts={facts} />
      <p class="muted">
        {run.refusal ? `The last command was refused: ${run.refusal}.` : "After a reset the robot begins anew in its world, with the same seed, and whoever has control must take it again."} {whyNot}
      </p>
    </Card>
  );
}
