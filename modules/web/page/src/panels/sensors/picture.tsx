// Proximity, drawn around the robot: its front is at the top.
import { signal } from "@preact/signals";
import { num, united, written } from "../../format";
import type { Scan, Shown } from "../../protocol";
import { scene, sensors, stale } from "../../state";
import { Age, Button, Card, Empty } from "../../ui";
import { t } from "../../words";
import { beam, front, onPicture, polygon, side } from "./geometry";
import { floor, GLYPHS, near, type Near } from "./near";
import { has, infrareds, type Sounding, sonars } from "./readings";

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
      title={t("Proximity")}
      aside={
        <span class="p-aside" role="group" aria-label={t("How far is shown")}>
          {REACHES.map((far) => (
            <Button key={far} kind="quiet" pressed={reach.value === far} onClick={() => (reach.value = far)}>
              {united(far, "m")}
            </Button>
          ))}
        </span>
      }
    >
      {shown && robot ? <Picture /> : <Empty>{t("No data yet.")}</Empty>}
      {shown ? (
        <p class="p-legend">
          {shown.scans.map((scan) => (
            <span key={scan.value?.name}>
              {t("lidar {name}", { name: scan.value?.name ?? "" })} <Age shown={scan} />
            </span>
          ))}
          {has(shown, sonars(shown, 0)) ? (
            <span>
              {t("sonars")} <Age shown={sonars(shown, 0).shown} />
            </span>
          ) : null}
          {has(shown, infrareds(shown)) ? (
            <span>
              {t("infrared")} <Age shown={infrareds(shown).shown} />
            </span>
          ) : null}
          <span>
            {t("beacons")} <Age shown={shown.beacons} />
          </span>
        </p>
      ) : null}
      <p class="p-legend muted">
        <span>{t("{glyph} under {distance}", { glyph: GLYPHS.close, distance: num(0.5, 1, "m") })}</span>
        <span>{t("{glyph} under {distance}", { glyph: GLYPHS.near, distance: num(1, 0, "m") })}</span>
        <span>{t("dotted: nothing within range")}</span>
        <span>{t("? not known: counts as occupied")}</span>
        <span>{t("● ▽ floor, no floor")}</span>
        <span>{t("◆ beacon: its direction alone")}</span>
      </p>
    </Card>
  );
}

/** What the beams of a lidar met within `far` of `middle`, as dots. */
function dots({ x, y }: Scan, middle: number, far: number): string {
  const dot = (ahead: number, left: number) => (Math.hypot(ahead - middle, left) < far ? `M${onPicture(ahead, left).join(" ")}h0` : "");
  return x.map((ahead, k) => dot(ahead, y[k] ?? 0)).join("");
}

/** Pale while it reports a fault, or is silent, as on the map. */
function pale(scan: Shown<Scan>): boolean {
  return stale(scan) || scan.value?.status !== 0;
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
  const sound = sonars(shown, robot.sonar.field_of_view);
  const light = infrareds(shown);
  const heard = sound.rows ?? [];
  const beacons = shown.beacons.value?.beacons ?? [];
  return (
    <svg class="p-picture" style={{ "--far": far }} viewBox={`${-edge} ${top} ${2 * edge} ${2 * edge}`} role="img" aria-label={summary(heard, shown.scans.length)}>
      {shown.scans.map((scan) =>
        scan.value ? <path key={scan.value.name} class={pale(scan) ? "p-scan is-stale" : "p-scan"} d={dots(scan.value, middle, far)} /> : null,
      )}
      <g class={stale(sound.shown) ? "is-stale" : ""}>
        {heard.map((range) => (
          <Beam key={range.id} range={range} far={far} text={text} quiet={robot.sonar.min} />
        ))}
      </g>
      <g class="p-rings" aria-hidden>
        {rings(far).map((radius) => {
          const [across, down] = onPicture(middle + radius * Math.cos(LABELLED), radius * Math.sin(LABELLED));
          return (
            <g key={radius}>
              <circle cx={0} cy={-middle} r={radius} />
              <text x={across} y={down}>
                {united(written(String(radius)), "m")}
              </text>
            </g>
          );
        })}
      </g>
      <polygon class="p-robot" points={polygon(robot.outline)} />
      <Nose outline={robot.outline} />
      <g class={stale(light.shown) ? "is-stale" : ""}>
        {light.rows?.map((range) => (
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

/** A ranger's beam up to what it heard, with the distance in figures; dotted where nothing is in range, a mark where it is not known. */
function Beam(props: { range: Sounding; far: number; text: number; quiet: number }) {
  const { range, far, text } = props;
  const { distance, beam: width } = range;
  const quiet = Math.max(props.quiet, 0.15);
  if (range.known === "unknown") {
    const [x, y] = onPicture(range.x + (quiet + text) * Math.cos(range.theta), range.y + (quiet + text) * Math.sin(range.theta));
    return (
      <g class="p-unknown">
        <path d={front(range, quiet, width)} />
        <text x={x} y={y}>
          ?
        </text>
      </g>
    );
  }
  if (distance === null) return <path class="p-deaf" d={front(range, quiet, width)} />;
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

/** An infrared ranger: a dot where it sees the floor; where it does not, or that is not known, a mark that nobody overlooks. */
function Floor({ range }: { range: Sounding }) {
  const [x, y] = onPicture(range.x, range.y);
  const seen = floor(range);
  if (seen === "floor") return <circle class="p-floor" cx={x} cy={y} r={0.03} />;
  return (
    <text class="p-no-floor" x={x} y={y}>
      {seen === "hole" ? "▽" : "?"}
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
function summary(sonars: readonly Sounding[], lidars: number): string {
  if (!sonars.length && lidars) return t("Proximity around the robot, by lidars.");
  const heard = sonars.filter((range) => range.distance !== null);
  const unknown = sonars.filter((range) => range.known === "unknown").length;
  const all = sonars.length;
  const rest = unknown ? ` ${t("{n} of {all} sonars are not known.", { n: unknown, all })}` : "";
  const nearest = heard.sort((a, b) => (a.distance ?? 0) - (b.distance ?? 0))[0];
  if (!nearest) return `${t("Proximity around the robot: no sonar hears anything.")}${rest}`;
  const values = { distance: num(nearest.distance, 2, "m"), side: t(side(nearest.theta)), n: heard.length, all };
  return `${t("Proximity around the robot: nearest {distance} at the {side}; {n} of {all} sonars have an echo.", values)}${rest}`;
}
