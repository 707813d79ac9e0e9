// What the robot senses of its surroundings and of itself.
import { SonarPicture } from "./picture";
import { BeaconCard, GamepadCard, OdometryCard } from "./own";
import { RangerTables } from "./rangers";
import "../panels.css";

export function Sensors() {
  return (
    <div class="p-halves">
      <div class="stack">
        <SonarPicture />
        <BeaconCard />
        <OdometryCard />
        <GamepadCard />
      </div>
      <div class="stack">
        <RangerTables />
      </div>
    </div>
  );
}
