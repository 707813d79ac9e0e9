// Proximity, drawn around the robot: its front is at the top.
import { signal } from "@preact/signals";
import { num } from "../../format";
import type { Range } from "../../protocol";
import { scene, sensors, stale } from "../../state";
import { Age, Button, Card, Empty } from "../../ui";
import { beam, front, onPicture, polygon, side } from "./geometry";
import { floor, GLYPHS, measured, near, type Near } from "./near";

/** How far is shown, m. */
const REACHES = [1, 2, 4] as const;
const reach = signal<number>(2);
/** Where the rings are labelled: at the rear, to the right; rad. */
const LABELLED = -2.4;

export function SonarPicture() {
  const shown = sensors.value;
  const robot = scene.value;
  return (
    <Card
      title="Proximity"
      aside={
        <span class="p-aside" role="group" aria-label="How far is shown">
          {REACHES.map((far) => (
            <Button key={far} kind="quiet" pressed={reach.value === far} onClick={() => (reach.value = far)}>
              {far} m
            </Button>
          ))}
        </span>
      }
    >
      {shown && robot ? <Picture /> : <Empty>Not heard yet.</Empty>}
      {shown ? (
        <p class="p-legend">
          <span>
            sonars <Age shown={shown.sonars} />
          </span>
          <span>
            infrared <Age shown={shown.infrareds} />
          </span>
          <span>
            beacons <Age shown={shown.beacons} />
          </span>
        </p>
      ) : null}
      <p class="p-legend muted">
        <span>{GLYPHS.close} under 0.5 m</span>
        <span>{GLYPHS.near} under 1 m</span>
        <span>dotted: nothing heard</span>
        <span>● ▽ floor, no floor</span>
        <span>◆ beacon: its direction alone</span>
      </p>
    </Card>
  );
}

function Picture() {
  const [robot, shown] = [scene.value, sensors.value];
  if (!robot || !shown) return null;
  const far = reach.value;
  // The middle of the outline, so that the same is seen before it as behind it.
  const xs = robot.outline.map(([x]) => x);
  const middle = xs.length ? (Math.min(...xs) + Math.max(...xs)) / 2 : 0;
  const edge = far + 0.62;
  const [, top] = onPicture(middle + edge, 0);
  const text = far / 18;
  const sonars = shown.sonars.value?.srfs ?? [];
  const infrareds = shown.infrareds.value?.irs ?? [];
  const beacons = shown.beacons.value?.beacons ?? [];
  return (
    <svg class="p-picture" style={{ "--far": far }} viewBox={`${-edge} ${top} ${2 * edge} ${2 * edge}`} role="img" aria-label={summary(sonars)}>
      <g class={stale(shown.sonars) ? "is-stale" : ""}>
        {sonars.map((range) => (
          <Beam key={range.id} range={range} width={robot.sonar.field_of_view} far={far} text={text} quiet={robot.sonar.min} />
        ))}
      </g>
      <g class="p-rings" aria-hidden>
        {rings(far).map((radius) => {
          const [across, down] = onPicture(middle + radius * Math.cos(LABELLED), radius * Math.sin(LABELLED));
          return (
            <g key={radius}>
              <circle cx={0} cy={-middle} r={radius} />
              <text x={across} y={down}>
                {radius} m
              </text>
            </g>
          );
        })}
      </g>
      <polygon class="p-robot" points={polygon(robot.outline)} />
      <Nose outline={robot.outline} />
      <g class={stale(shown.infrareds) ? "is-stale" : ""}>
        {infrareds.map((range) => (
          <Floor key={range.id} range={range} />
        ))}
      </g>
      <g class={stale(shown.beacons) ? "p-beacons is-stale" : "p-beacons"}>
        {beacons.map(({ id, bearing }) => {
          if (bearing === null) return null;
          const [x, y] = [(far + 0.25) * Math.cos(bearing), (far + 0.25) * Math.sin(bearing)];
          const [across, down] = onPicture(middle + x, y);
          return (
            <text key={id} x={across} y={down}>
              ◆{id}
            </text>
          );
        })}
      </g>
    </svg>
  );
}

function rings(far: number): number[] {
  return far <= 1 ? [0.5, 1] : Array.from({ length: far }, (_, n) => n + 1);
}

/** A ranger's beam up to what it heard, with the distance in figures; dotted where it heard nothing. */
function Beam(props: { range: Range; width: number; far: number; text: number; quiet: number }) {
  const { range, width, far, text } = props;
  const distance = measured(range);
  if (distance === null) return <path class="p-deaf" d={front(range, Math.max(props.quiet, 0.15), width)} />;
  const how: Near = near(distance);
  const drawn = Math.min(distance, far);
  const label = Math.min(distance + text * 0.9, far);
  const [x, y] = onPicture(range.x + label * Math.cos(range.theta), range.y + label * Math.sin(range.theta));
  return (
    <g class={`p-beam ${how}`}>
      <path class="p-wedge" d={beam(range, drawn, width)} />
      {distance <= far ? <path class="p-front" d={front(range, drawn, width)} /> : null}
      {distance <= far ? (
        <text x={x} y={y}>
          {GLYPHS[how]}
          {num(distance, 2)}
        </text>
      ) : null}
    </g>
  );
}

/** An infrared ranger: a dot where it sees the floor; where it does not, a mark that nobody overlooks. */
function Floor({ range }: { range: Range }) {
  const [x, y] = onPicture(range.x, range.y);
  if (floor(range)) return <circle class="p-floor" cx={x} cy={y} r={0.03} />;
  return (
    <text class="p-no-floor" x={x} y={y}>
      ▽
    </text>
  );
}

/** An arrowhead in the outline: where its front is. */
function Nose({ outline }: { outline: readonly (readonly [number, number])[] }) {
  if (outline.length === 0) return null;
  const tip = Math.max(...outline.map(([x]) => x));
  const corners: [number, number][] = [
    [tip - 0.06, 0],
    [tip - 0.2, 0.1],
    [tip - 0.2, -0.1],
  ];
  return <polygon class="p-nose" points={polygon(corners)} />;
}

/** What the picture shows, for who does not see it. */
function summary(sonars: readonly Range[]): string {
  const heard = sonars.flatMap((range) => {
    const distance = measured(range);
    return distance === null ? [] : [{ range, distance }];
  });
  const nearest = heard.sort((a, b) => a.distance - b.distance)[0];
  if (!nearest) return "Proximity around the robot: no sonar hears anything.";
  const where = `${num(nearest.distance, 2, "m")} at the ${side(nearest.range.theta)}`;
  return `Proximity around the robot: nearest ${where}; ${heard.length} of ${sonars.length} sonars hear something.`;
}
