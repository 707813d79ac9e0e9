// The battery: how full it is, and for how long.
import { BatteryMedium } from "lucide-preact";
import { num } from "../../format";
import { stale, system } from "../../state";
import { EMPTY, LOW } from "../../shell/health";
import { Age, Badge, Card, Empty, Facts, type Tone } from "../../ui";
import { type Plain, t } from "../../words";
import { minutes, percent } from "../format";

function judged(charge: number | null): { tone: Tone; word: Plain } {
  if (charge === null) return { tone: "off", word: "charge not known" };
  if (charge < EMPTY) return { tone: "bad", word: "almost empty" };
  return charge < LOW ? { tone: "warn", word: "low" } : { tone: "good", word: "good" };
}

export function BatteryCard() {
  const shown = system.value?.power;
  const value = shown?.value;
  if (!shown || !value) {
    return (
      <Card title={t("Battery")} icon={BatteryMedium}>
        <Empty>{t("No data yet.")}</Empty>
      </Card>
    );
  }
  const { tone, word } = judged(value.charge);
  const current = value.channels.reduce((sum, channel) => sum + (channel.current ?? 0), 0);
  return (
    <Card title={t("Battery")} icon={BatteryMedium} aside={<Age shown={shown} />}>
      <div class={stale(shown) ? "is-stale" : ""}>
        <p class="p-big">
          <span>{percent(value.charge)}</span> <Badge tone={tone}>{t(word)}</Badge>
        </p>
        <meter class={`p-meter tone-${tone}`} min={0} max={1} low={EMPTY} high={LOW} optimum={1} value={value.charge ?? 0} aria-label={t("Charge")} />
        <Facts
          facts={[
            { name: t("Lasts"), value: minutes(value.remaining) },
            { name: t("Voltage"), value: num(value.voltage, 1, "V") },
            { name: t("Channels draw"), value: num(current, 2, "A") },
          ]}
        />
      </div>
    </Card>
  );
}
