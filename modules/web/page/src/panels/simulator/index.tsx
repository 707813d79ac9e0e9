// The simulation: what is broken in it, where the robot really is, and how fast its time goes.
import { Breakage } from "./breakage";
import { DriftCard } from "./error";
import { Elsewhere } from "./elsewhere";
import { TimeCard } from "./time";
import "../panels.css";

export function Simulator() {
  return (
    <div class="p-halves">
      <div class="stack">
        <TimeCard />
        <DriftCard />
        <Breakage />
      </div>
      <Elsewhere />
    </div>
  );
}
