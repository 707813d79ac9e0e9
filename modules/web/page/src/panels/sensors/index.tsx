// What the robot senses of its surroundings and of itself.
import { SonarPicture } from "./picture";
import { BeaconCard, GamepadCard, ImuCards, LidarCards, OdometryCard, ScannerCard } from "./own";
import { RangerTables } from "./rangers";
import "../panels.css";

export function Sensors() {
  return (
    <div class="p-halves">
      <div class="stack">
        <SonarPicture />
        <BeaconCard />
        <ScannerCard />
        <OdometryCard />
        <ImuCards />
        <GamepadCard />
      </div>
      <div class="stack">
        <LidarCards />
        <RangerTables />
      </div>
    </div>
  );
}
