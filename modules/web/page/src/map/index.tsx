// The map: what the robot believes of the place and of itself, and where to send it.
import { Crosshair, Expand, Flag, Hand, LayersIcon, LocateFixed, Milestone, Minus, PencilRuler, Plus, Repeat, Route, Ruler, Undo2 } from "lucide-preact";
import { useEffect, useRef, useState } from "preact/hooks";
import { isHeld } from "../holds";
import { advice } from "../drive/advice";
import { resume, stopped, take } from "../operate";
import { num } from "../format";
import { authority, connection, demo, drive, fresh, holder, may, scene, sensors, stale, whyNot } from "../state";
import { Badge, Button, Slide, type Tone } from "../ui";
import { type Plain, t } from "../words";
import { BeaconTable } from "./beacon-table";
import { type Looker, MapCanvas, under } from "./canvas";
import { begin, change, confirm, loop, type Mode, mode, places, undo } from "./draft";
import { CancelGoal, DriveTo, Progress } from "./drive-to";
import { edit } from "./editor";
import { EditorTools } from "./editor-tools";
import { isOn, type Layer, toggle } from "./layers";
import { PlannerControls } from "./planner-controls";
import { modeWords } from "./planner";
import { goalWords, guardWords, measureWords, positionWords, standsWhy } from "./words";
import "./map.css";

export function MapView() {
  return <MapPanel alone />;
}

/** `alone`: without the drive view beside it, where control is taken. */
export function MapPanel({ alone = false }: { alone?: boolean }) {
  const looker = useRef<Looker | null>(null);
  const [follow, setFollow] = useState(false);
  const part = drive.value;
  const goal = goalWords(part?.goal.value, isHeld(part?.holds ?? []) === true, standsWhy(part));
  useEffect(() => () => begin("look"), []);
  return (
    <section class="map" aria-label={t("Map")}>
      <div class="map-picture">
        <div class="map-view">
          <MapCanvas follow={follow} onFollow={setFollow} looker={looker} label={`${t("Map")}. ${positionWords(part)} ${goal} ${guardWords(part)}`} />
          <Under />
        </div>
        <div class="map-look">
          <div class="map-zoom">
            <Button icon={Plus} label={t("Nearer")} onClick={() => looker.current?.zoom(1.4)} />
            <Button icon={Minus} label={t("Farther")} onClick={() => looker.current?.zoom(1 / 1.4)} />
            <Button icon={Expand} label={t("Show all")} onClick={() => looker.current?.fit()} />
            <Button icon={Ruler} label={t("Measure")} pressed={mode.value === "measure"} onClick={() => begin(mode.value === "measure" ? "look" : "measure")} />
            <Button icon={LocateFixed} label={t("Follow the robot")} pressed={follow} onClick={() => setFollow(!follow)} />
          </div>
          <Layers />
        </div>
      </div>
      <div class="map-below">
        {mode.value === "look" ? <Tools alone={alone} /> : mode.value === "measure" ? <Measure /> : mode.value === "edit" ? <EditorTools /> : <Draft />}
        {mode.value === "look" ? <PlannerControls /> : null}
        <div class="map-words" role="status" aria-live="off">
          <Quality />
          <p class={stale(part?.estimate) ? "is-stale" : ""}>{positionWords(part)}</p>
          <Progress />
          <p class={stale(part?.mode) ? "is-stale" : ""}>{modeWords(part?.mode.value)}</p>
          <p class={stale(part?.guard) ? "is-stale" : ""}>{guardWords(part)}</p>
        </div>
        <BeaconTable />
      </div>
    </section>
  );
}

function Quality() {
  const estimate = drive.value?.estimate;
  const quality = fresh(estimate)?.quality;
  const tones: Tone[] = ["bad", "warn", "info", "good"];
  if (quality === undefined) return <Badge tone="off">{t("position not known")}</Badge>;
  return <Badge tone={tones[quality] ?? "off"}>{[t("position lost"), t("position searching"), t("position coarse"), t("position fine")][quality] ?? t("position not known")}</Badge>;
}

function Tools({ alone }: { alone: boolean }) {
  if (!may("operator")) return null;
  const start = (next: Mode) => () => begin(next);
  return (
    <div class="map-tools">
      {alone ? <Resume /> : null}
      {alone && !demo.value && !authority.value.yours && !holder.value ? (
        <Button icon={Hand} kind="primary" whyNot={connection.value.state === "live" ? null : t("There is no connection")} onClick={() => void take()}>
          {t("Take control")}
        </Button>
      ) : null}
      <DriveTo />
      <Button icon={Flag} whyNot={whyNot.value} onClick={start("go")}>
        {t("Go to")}
      </Button>
      <Button icon={Route} whyNot={whyNot.value} onClick={start("route")}>
        {t("Route")}
      </Button>
      <Button icon={Crosshair} whyNot={whyNot.value} onClick={start("pose")}>
        {t("Set position")}
      </Button>
      {scene.value?.simulated && !demo.value && may("engineer") ? (
        <Button icon={PencilRuler} onClick={edit}>
          {t("Edit the scenario")}
        </Button>
      ) : null}
      <CancelGoal />
    </div>
  );
}

/** Where the planner goes on only when an operator says so, as the drive view has it. */
function Resume() {
  const part = drive.value;
  if (!part || demo.value || connection.value.state !== "live" || advice(part, stopped.value)?.offer !== "resume") return null;
  return <Slide label={t("Resume")} tone="good" whyNot={whyNot.value} onConfirm={() => void resume()} />;
}

/** A line through places that are tapped: its length. */
function Measure() {
  const all = places.value;
  return (
    <div class="map-tools" role="group" aria-label={t("Measure")}>
      <p class="map-measured figure" role="status">
        {measureWords(all)}
      </p>
      <Button icon={Undo2} label={t("Take the last one back")} whyNot={all.length > 0 ? null : t("There is none")} onClick={undo} />
      <Button onClick={() => begin("look")}>{t("Done")}</Button>
    </div>
  );
}

/** What is being placed, and what to do with it. */
function Draft() {
  const all = places.value;
  const last = all.at(-1);
  const kind = mode.value;
  const hint = { look: "", measure: "", edit: "", go: t("Tap the map where it shall go; drag to set the heading."), route: t("Tap the waypoints one after another."), pose: t("Tap where the robot is; drag to where it looks.") }[kind];
  const said = { look: "", measure: "", edit: "", go: t("Go there"), route: t("Drive {n} waypoints", { n: all.length }), pose: t("The robot is here") }[kind];
  return (
    <form class="map-draft" onSubmit={(event) => (event.preventDefault(), whyNot.value === null && void confirm())} aria-label={t("Place on the map")}>
      <p>{hint}</p>
      <div class="map-fields">
        <Field label={t("x, m")} value={last?.x ?? null} onChange={(x) => (last ? change({ x }) : (places.value = [{ x, y: 0, theta: null }]))} />
        <Field label={t("y, m")} value={last?.y ?? null} onChange={(y) => (last ? change({ y }) : (places.value = [{ x: 0, y, theta: null }]))} />
        <Field
          label={t("heading, °")}
          value={last?.theta === null || last === undefined ? null : (last.theta * 180) / Math.PI}
          onChange={(degrees) => last && change({ theta: (degrees * Math.PI) / 180 })}
        />
        {kind === "route" ? <Button icon={Milestone} label={t("Add a waypoint")} whyNot={last ? null : t("Place the first one")} onClick={() => last && (places.value = [...all, { ...last, theta: null }])} /> : null}
        {kind === "route" ? <Button icon={Undo2} label={t("Take the last one back")} whyNot={last ? null : t("There is none")} onClick={undo} /> : null}
        {kind === "route" ? (
          <Button icon={Repeat} pressed={loop.value} onClick={() => (loop.value = !loop.value)}>
            {t("Loop")}
          </Button>
        ) : null}
      </div>
      <div class="map-confirm">
        <Button onClick={() => begin("look")}>{t("Cancel")}</Button>
        <Button kind="primary" type="submit" icon={kind === "pose" ? Crosshair : Flag} whyNot={whyNot.value ?? (last ? null : hint)} onClick={() => {}}>
          {said}
        </Button>
      </div>
    </form>
  );
}

function Field({ label, value, onChange }: { label: string; value: number | null; onChange: (value: number) => void }) {
  return (
    <label class="field">
      {label}
      <input
        type="number"
        step="any"
        inputMode="decimal"
        value={value === null ? "" : Number(value.toFixed(2))}
        onChange={(event) => Number.isFinite(event.currentTarget.valueAsNumber) && onChange(event.currentTarget.valueAsNumber)}
      />
    </label>
  );
}

/** Where the mouse is. */
function Under() {
  const at = under.value;
  return at ? (
    <p class="map-under figure" aria-hidden>
      {t("{x}, {y}", { x: num(at[0], 2), y: num(at[1], 2, "m") })}
    </p>
  ) : null;
}

/** What the map shows, each on or off, with what it means. */
function Layers() {
  const simulated = scene.value?.simulated ?? false;
  const rows: [Layer, string, Plain][] = [
    ...(sensors.value?.persons.value ? ([["persons", "person", "people whom the robot tracks, or other legs; line: its way in 1 s"]] as [Layer, string, Plain][]) : []),
    ...(simulated ? ([["people", "walker", "people (simulation)"], ["truth", "truth", "true position (simulation)"]] as [Layer, string, Plain][]) : []),
    ["plan", "plan", "plan"],
    ["obstacles", "obstacle", "sensed obstacles"],
    ...(drive.value?.bound ? ([["fields", "protective", "guard: protective field stops, dashed one slows; hatched: occupied"]] as [Layer, string, Plain][]) : []),
    ...(sensors.value?.scans.length ? ([["scan", "scan", "lidar, no safety device; pale: it reports a fault, or is silent"]] as [Layer, string, Plain][]) : []),
    ["sonar", "sonar", "sonar; dotted: nothing within range, dashed: not known"],
    ["floor", "ir", "▽ no floor seen by infrared; open: not known"],
    ["beacons", "beacon", "beacons; filled: used or seen, crossed: refused, dashed: left out"],
    ["trail", "trail", "trail"],
  ];
  return (
    <details class="map-layers">
      <summary>
        <LayersIcon size={18} aria-hidden /> <span>{t("Layers")}</span>
      </summary>
      <div class="map-layer">
        <i class="ink-robot" /> {t("robot and its uncertainty (2σ)")}
      </div>
      {rows.map(([layer, ink, words]) => (
        <label key={layer} class="map-layer">
          <input type="checkbox" checked={isOn(layer)} onChange={() => toggle(layer)} />
          <i class={`ink-${ink}`} />
          <span>{t(words)}</span>
        </label>
      ))}
    </details>
  );
}
