// Beacons one by one, for engineers: their residuals, and which of them may be used.
import { deg, num, span } from "../format";
import { order } from "../operate";
import { count } from "../panels/format";
import type { BeaconUse, DataBeaconUse } from "../protocol";
import { may, since, stale, system, whyNot } from "../state";
import { Age, Badge, Button, type Column, Table } from "../ui";
import { t } from "../words";
import { beaconState, normalized, STATES } from "./beacons";

function change({ id, permitted }: BeaconUse): void {
  const done = permitted ? t("Beacon {id} is to be left out.", { id }) : t("Beacon {id} is to be used again.", { id });
  void order({ type: "beacon", beacon: id, permitted: !permitted }, done);
}

function columns({ timestamp }: DataBeaconUse, age: number): Column<BeaconUse>[] {
  const seen = ({ last }: BeaconUse): number => (last > 0 ? age + Math.max(0, timestamp - last) / 1e6 : Infinity);
  return [
    { head: t("Beacon"), title: true, by: (row) => row.id, cell: (row) => row.id },
    {
      head: t("State"),
      by: (row) => beaconState(row, timestamp),
      cell: (row) => {
        const [tone, word] = STATES[beaconState(row, timestamp)];
        return <Badge tone={tone}>{t(word)}</Badge>;
      },
    },
    { head: t("Residual"), figure: true, by: (row) => Math.abs(row.residual ?? -1), cell: (row) => deg(row.residual, 2) },
    { head: t("Expected (1σ)"), figure: true, by: (row) => row.deviation ?? -1, cell: (row) => deg(row.deviation, 2) },
    { head: t("Ratio"), figure: true, by: (row) => Math.abs(normalized(row) ?? -1), cell: (row) => num(normalized(row), 1) },
    { head: t("Accepted"), figure: true, by: (row) => row.accepted, cell: (row) => count(row.accepted) },
    { head: t("Refused"), figure: true, by: (row) => row.refused, cell: (row) => count(row.refused) },
    { head: t("Last seen"), figure: true, by: seen, cell: (row) => (row.last > 0 ? t("{time} ago", { time: span(seen(row)) }) : t("never")) },
    {
      head: t("Use"),
      cell: (row) => (
        <Button pressed={row.permitted} whyNot={whyNot.value} label={t("Use beacon {id} for the position", { id: row.id })} onClick={() => change(row)}>
          {row.permitted ? t("on") : t("off")}
        </Button>
      ),
    },
  ];
}

/** Nothing for operators, and on a robot without beacons. */
export function BeaconTable() {
  const shown = system.value?.beacon_use;
  const value = shown?.value;
  if (!shown || !value || !may("engineer")) return null;
  return (
    <details class="map-beacons">
      <summary>{t("Beacons: residuals and use")}</summary>
      <p class="muted">
        {t("Residual: measured minus expected direction of the last bearing. One that is left out is neither looked for nor used, until it is switched on again or the estimator restarts.")} <Age shown={shown} />
      </p>
      <Table
        caption={t("Beacons: residuals and use")}
        columns={columns(value, (shown.age ?? 0) + since(shown))}
        rows={value.beacons}
        id={(row) => row.id}
        stale={() => stale(shown)}
      />
    </details>
  );
}
