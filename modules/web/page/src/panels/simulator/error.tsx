// Where the robot really is, where it believes to be, and the course of the difference.
import { effect } from "@preact/signals";
import { useEffect, useState } from "preact/hooks";
import { deg, num } from "../../format";
import { clock, drive, stale, system } from "../../state";
import { Age, Badge, Card, Empty, Facts } from "../../ui";
import { Plot } from "../plot/plot";
import { Ring } from "../plot/ring";
import { drift } from "./drift";

const QUALITIES = ["lost", "searching", "coarse", "fine"];

export function DriftCard() {
  // A minute of 10 Hz.
  const [ring] = useState(() => new Ring(610));
  useEffect(
    () =>
      effect(() => {
        const part = drive.value;
        const [truth, estimate] = [part?.truth.value, part?.estimate.value];
        const now = part && truth && estimate && !stale(part.truth) && !stale(part.estimate) ? drift(truth, estimate) : null;
        ring.push(clock() / 1000, now?.distance ?? null);
      }),
    [],
  );
  const part = drive.value;
  const [truth, estimate] = [part?.truth.value, part?.estimate.value];
  const rate = system.value?.clock;
  if (!part || !truth) {
    return (
      <Card title="Truth and estimate">
        <Empty>No data of the simulation: the simulator does not run.</Empty>
      </Card>
    );
  }
  const off = estimate ? drift(truth, estimate) : null;
  const sure = part.ellipse;
  return (
    <Card title="Truth and estimate" aside={<Age shown={part.truth} />}>
      <div class={stale(part.truth) || stale(part.estimate) ? "is-stale" : ""}>
        <Facts
          facts={[
            { name: "Position error", value: off ? <b>{num(off.distance, 3, "m")}</b> : "no estimate" },
            { name: "Heading error", value: deg(off?.heading, 2) },
            { name: "Ahead, to the left", value: off ? `${num(off.ahead, 3)}, ${num(off.left, 3, "m")}` : "–" },
            {
              name: "Reported uncertainty (2σ)",
              value: sure ? `±${num(sure.long, 3, "m")}, ±${deg(sure.heading, 2)}` : "–",
            },
            { name: "Quality", value: estimate ? (QUALITIES[estimate.quality] ?? "unknown") : "–" },
            { name: "True position", value: `${num(truth.x, 2)}, ${num(truth.y, 2, "m")}, ${deg(truth.theta)}` },
            { name: "Clearance", value: num(truth.clearance, 2, "m") },
            { name: "Contacts", value: truth.collisions > 0 ? <Badge tone="bad">{String(truth.collisions)}</Badge> : "none" },
          ]}
        />
      </div>
      <Plot
        label="Distance of the estimate from the truth in the last 60 s"
        series={[{ label: "position error", ring, style: 0, unit: "m" }]}
        window={60}
        end={() => clock() / 1000}
        height={150}
      />
      <p class="p-legend">
        <span>
          Time runs at {rate?.value ? `${num(rate.value.rate, 2)} of the real one` : "a rate that is not known"} <Age shown={rate} />
        </span>
      </p>
    </Card>
  );
}
