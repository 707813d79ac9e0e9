// Battery, power channels, temperatures and fans.
import { BatteryCard } from "./battery";
import { Channels } from "./channels";
import { Fans, Thermometers } from "./temperatures";
import "../panels.css";

export function Power() {
  return (
    <div class="p-halves">
      <div class="stack">
        <BatteryCard />
        <Thermometers />
        <Fans />
      </div>
      <Channels />
    </div>
  );
}
