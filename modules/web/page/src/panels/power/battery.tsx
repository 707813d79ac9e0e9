// The battery: how full it is, and for how long.
import { BatteryMedium } from "lucide-preact";
import { num } from "../../format";
import { stale, system } from "../../state";
import { EMPTY, LOW } from "../../shell/health";
import { Age, Badge, Card, Empty, Facts, type Tone } from "../../ui";
import { minutes, percent } from "../format";

function judged(charge: number | null): { tone: Tone; word: string } {
  if (charge === null) return { tone: "off", word: "charge not known" };
  if (charge < EMPTY) return { tone: "bad", word: "almost empty" };
  return charge < LOW ? { tone: "warn", word: "low" } : { tone: "good", word: "good" };
}

export function BatteryCard() {
  const shown = system.value?.power;
  const value = shown?.value;
  if (!shown || !value) {
    return (
      <Card title="Battery" icon={BatteryMedium}>
        <Empty>No data yet.</Empty>
      </Card>
    );
  }
  const { tone, word } = judged(value.charge);
  const current = value.channels.reduce((sum, channel) => sum + (channel.current ?? 0), 0);
  return (
    <Card title="Battery" icon={BatteryMedium} aside={<Age shown={shown} />}>
      <div class={stale(shown) ? "is-stale" : ""}>
        <p class="p-big">
          <span>{percent(value.charge)}</span> <Badge tone={tone}>{word}</Badge>
        </p>
        <meter class={`p-meter tone-${tone}`} min={0} max={1} low={EMPTY} high={LOW} optimum={1} value={value.charge ?? 0} aria-label="Charge" />
        <Facts
          facts={[
            { name: "Lasts", value: minutes(value.remaining) },
            { name: "Voltage", value: num(value.voltage, 1, "V") },
            { name: "Channels draw", value: num(current, 2, "A") },
          ]}
        />
      </div>
    </Card>
  );
}
