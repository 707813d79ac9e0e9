// The recorder, and the runs on the robot's disk.
import { RecorderCard } from "./recorder";
import { Runs } from "./runs";
import "../panels.css";

export function Logs() {
  return (
    <div class="stack">
      <RecorderCard />
      <Runs />
    </div>
  );
}
