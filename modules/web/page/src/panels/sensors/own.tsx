// Lidars, beacons, odometry, inertial measurement units and the gamepad.
import { deg, num, span } from "../../format";
import type { DataBeacons, Scan } from "../../protocol";
import { drive, sensors, since, stale } from "../../state";
import { Age, Badge, Card, type Column, Empty, Facts, Table } from "../../ui";
import { type Plain, t } from "../../words";
import { count } from "../format";
import { side, tilt } from "./geometry";

interface Sighting {
  id: number;
  bearing: number | null;
  strength: number | null;
  /** s */
  age: number;
}

/** Each beacon has an instant of its own: what it is old is that before the message, and what the message is old by now. */
function sightings(value: DataBeacons, age: number): Sighting[] {
  return value.beacons.map(({ id, bearing, strength, timestamp }) => {
    const before = Math.max(0, (value.timestamp - timestamp) / 1e6);
    return { id, bearing, strength, age: age + before };
  });
}

const columns = (): Column<Sighting>[] => [
  { head: t("Beacon"), title: true, by: (row) => row.id, cell: (row) => row.id },
  { head: t("Bearing"), figure: true, by: (row) => row.bearing ?? Infinity, cell: (row) => deg(row.bearing, 1) },
  { head: t("Seen"), cell: (row) => (row.bearing === null ? "–" : t(side(row.bearing))) },
  { head: t("Strength"), figure: true, by: (row) => row.strength ?? -Infinity, cell: (row) => num(row.strength, 2) },
  { head: t("Age"), figure: true, by: (row) => row.age, cell: (row) => span(row.age) },
];

export function BeaconCard() {
  const shown = sensors.value?.beacons;
  if (!shown) return null;
  const rows = shown.value ? sightings(shown.value, (shown.age ?? 0) + since(shown)) : null;
  return (
    <Card title={t("Beacons seen")} class="p-fits" flush aside={<Age shown={shown} />}>
      {rows ? (
        <Table
          caption={t("Beacons seen in the last sweep")}
          columns={columns()}
          rows={rows}
          id={(row) => row.id}
          stale={() => stale(shown)}
          empty={t("None was seen in the last sweep.")}
        />
      ) : (
        <Empty>{t("No data yet.")}</Empty>
      )}
    </Card>
  );
}

/** What the beacon scanner says of itself; nothing on a robot without one. */
export function ScannerCard() {
  const shown = sensors.value?.scanner;
  const value = shown?.value;
  if (!shown || !value) return null;
  return (
    <Card title={t("Beacon scanner")} aside={<Age shown={shown} />}>
      <div class={stale(shown) ? "is-stale" : ""}>
        <Facts
          facts={[
            { name: t("Supply"), value: num(value.supply, 2, "V") },
            { name: t("Pulses rejected"), value: count(value.rejected) },
            { name: t("Now"), value: num(value.rejected_rate, 1, "1/s") },
            { name: t("Sweeps"), value: count(value.sweeps) },
          ]}
        />
      </div>
    </Card>
  );
}

export function OdometryCard() {
  const shown = drive.value?.odometry;
  const value = shown?.value;
  return (
    <Card title={t("Odometry")} aside={<Age shown={shown} />}>
      {value ? (
        <div class={stale(shown) ? "is-stale" : ""}>
          <Facts
            facts={[
              { name: t("Speed"), value: num(value.translation, 3, "m/s") },
              { name: t("Turning"), value: `${deg(value.rotation, 1)}/s` },
              { name: t("Way"), value: num(value.path, 2, "m") },
              { name: t("Turned in all"), value: deg(value.heading, 1) },
              { name: t("Ticks left"), value: count(value.ticks_left) },
              { name: t("Ticks right"), value: count(value.ticks_right) },
            ]}
          />
        </div>
      ) : (
        <Empty>{t("No data yet.")}</Empty>
      )}
    </Card>
  );
}

/** `status` of `DataScan`. */
const LIDAR_STATES: readonly [Plain, "good" | "warn" | "bad"][] = [
  ["works", "good"],
  ["covered, or too dirty", "bad"],
  ["turns too slowly or too fast", "bad"],
  ["reports a fault", "bad"],
];

/** The nearest that a lidar measures, from the robot's reference point: m, rad. */
function nearest({ x, y }: Scan): { distance: number; theta: number } | null {
  let found: { distance: number; theta: number } | null = null;
  x.forEach((ahead, k) => {
    const left = y[k] ?? 0;
    const distance = Math.hypot(ahead, left);
    if (!found || distance < found.distance) found = { distance, theta: Math.atan2(left, ahead) };
  });
  return found;
}

/** One for each lidar that was heard. */
export function LidarCards() {
  return (
    <>
      {sensors.value?.scans.map((shown) => {
        const value = shown.value;
        if (!value) return null;
        const [word, tone] = LIDAR_STATES[value.status] ?? (["reports a fault", "bad"] as const);
        const near = nearest(value);
        return (
          <Card key={value.name} title={t("Lidar {name}", { name: value.name })} aside={<Age shown={shown} />}>
            <div class={stale(shown) ? "is-stale" : ""}>
              <Facts
                facts={[
                  { name: t("State"), value: <Badge tone={tone}>{t(word)}</Badge> },
                  { name: t("Nearest, from the reference point"), value: near ? `${num(near.distance, 2, "m")}, ${t(side(near.theta))}` : "–" },
                ]}
              />
            </div>
            <p class="muted">{t("A lidar is no safety device.")}</p>
          </Card>
        );
      })}
    </>
  );
}

/** `status` of `DataImu`. */
const IMU_STATES: readonly [Plain, "good" | "warn" | "bad"][] = [
  ["works", "good"],
  ["not calibrated", "warn"],
  ["not plausible", "bad"],
  ["faulty", "bad"],
];

/** One for each inertial measurement unit that was heard. */
export function ImuCards() {
  const three = (values: readonly (number | null)[], write: (value: number | null) => string) => values.map(write).join(", ");
  return (
    <>
      {sensors.value?.imus.map((shown) => {
        const value = shown.value;
        if (!value) return null;
        const [word, tone] = IMU_STATES[value.status] ?? (["faulty", "bad"] as const);
        const tilted = value.oriented ? tilt(value.orientation) : null;
        return (
          <Card key={value.name} title={t("Inertial unit {name}", { name: value.name })} aside={<Age shown={shown} />}>
            <div class={stale(shown) ? "is-stale" : ""}>
              <Facts
                facts={[
                  { name: t("State"), value: <Badge tone={tone}>{t(word)}</Badge> },
                  { name: t("Turning"), value: `${deg(value.rotation[2], 1)}/s` },
                  { name: t("Roll, pitch"), value: tilted ? three(tilted, (angle) => deg(angle, 1)) : "–" },
                  { name: t("Acceleration"), value: `${three(value.acceleration, (axis) => num(axis, 2))}\u00A0m/s²` },
                  { name: t("Temperature"), value: num(value.temperature, 0, "°C") },
                ]}
              />
            </div>
            <p class="muted">{t("An inertial unit is no safety device.")}</p>
          </Card>
        );
      })}
    </>
  );
}

export function GamepadCard() {
  const shown = drive.value?.gamepad;
  const value = shown?.value;
  return (
    <Card title={t("Gamepad of the robot")} aside={<Age shown={shown} />}>
      {value?.connected ? (
        <div class={stale(shown) ? "is-stale" : ""}>
          <Facts
            facts={[
              { name: t("Name"), value: value.name },
              { name: t("Dead man"), value: value.dead_man ? <Badge tone="warn">{t("held: it drives")}</Badge> : <Badge tone="off">{t("released")}</Badge> },
              { name: t("Speed"), value: num(value.speed, 2, "m/s") },
              { name: t("Steering"), value: deg(value.steering, 1) },
            ]}
          />
        </div>
      ) : (
        <Empty>{value ? t("None is plugged in.") : t("No data yet.")}</Empty>
      )}
    </Card>
  );
}
