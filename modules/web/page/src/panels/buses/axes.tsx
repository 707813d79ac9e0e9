// The drives: CiA 402 in words, of motor controllers without CANopen what they do; and homing.
import { Home } from "lucide-preact";
import { deg, NONE, num } from "../../format";
import { scene, stale, system, whyNot, drive } from "../../state";
import type { Axis } from "../../protocol";
import { Age, Badge, Button, Card, Empty, type Fact, Facts, type Tone } from "../../ui";
import { order } from "../../operate";
import { hex } from "../format";
import { controllerState, driveError, nmtState, powerState, type Sort, statusBits } from "./cia402";

const OPERATIONAL = 5;
/** The axis that has a home. */
const HOMED = "steering";
const TONES: Readonly<Record<Sort, Tone>> = { moves: "good", rests: "off", stands: "warn", fault: "bad" };

export function Axes() {
  const shown = system.value?.axes;
  const axes = shown?.value?.axes;
  if (!axes?.length) {
    return (
      <Card title="Drives">
        <Empty>No drive is known.</Empty>
      </Card>
    );
  }
  return (
    <div class="cards">
      {axes.map((axis) => {
        const node = scene.value?.drives.find((each) => each.name === axis.name)?.node;
        const angle = axis.name === HOMED;
        const borne = system.value?.wheels.value?.wheels.find((each) => each.name === axis.name);
        return (
          <Card key={axis.name} title={`Drive: ${axis.name}`} aside={<Age shown={shown} />}>
            <div class={stale(shown) ? "is-stale" : ""}>
              <Facts
                facts={[
                  ...(node === undefined ? controller(axis) : canopen(axis, node)),
                  { name: "Position", value: angle ? deg(axis.position, 2) : num(axis.position, 3, "m") },
                  { name: "Velocity", value: axis.velocity === null ? NONE : angle ? `${deg(axis.velocity, 2)}/s` : num(axis.velocity, 3, "m/s") },
                  { name: "Current", value: num(axis.current, 2, "A") },
                  { name: "Load", value: num(borne?.load == null ? null : 100 * borne.load, 0, "%") },
                  { name: "Temperature", value: num(borne?.temperature, 0, "°C") },
                ]}
              />
            </div>
            {angle ? <Homing axis={axis.name} /> : null}
          </Card>
        );
      })}
    </div>
  );
}

/** A drive of CANopen. */
function canopen(axis: Axis, node: number): Fact[] {
  const state = powerState(axis.statusword);
  return [
    { name: "CiA 402", value: <Badge tone={TONES[state.sort]}>{state.name}</Badge> },
    { name: `NMT, node ${node}`, value: <Badge tone={axis.nmt_state === OPERATIONAL ? "good" : "bad"}>{nmtState(axis.nmt_state)}</Badge> },
    { name: "Error", value: axis.error_code ? <Badge tone="bad">{`${hex(axis.error_code)} ${driveError(axis.error_code)}`}</Badge> : "none" },
    {
      name: "Statusword",
      value: (
        <>
          {hex(axis.statusword)}
          <small class="p-bits">{statusBits(axis.statusword).join(", ") || "no further bit"}</small>
        </>
      ),
    },
  ];
}

/** A motor controller without CANopen. Its error is a number of its own, which Errors shows in words. */
function controller(axis: Axis): Fact[] {
  const state = controllerState(axis.nmt_state, axis.statusword);
  return [
    { name: "State", value: <Badge tone={TONES[state.sort]}>{state.name}</Badge> },
    { name: "Error", value: axis.error_code ? <Badge tone="bad">{hex(axis.error_code >>> 0)}</Badge> : "none" },
  ];
}

function Homing({ axis }: { axis: string }) {
  const homed = drive.value?.motion.value?.homed;
  return (
    <p class="row">
      <Button icon={Home} whyNot={whyNot.value} onClick={() => order({ type: "home", axis }, `${axis} is commanded to home.`)}>
        Home the {axis}
      </Button>
      {homed === undefined ? null : homed ? <Badge tone="good">homed</Badge> : <Badge tone="warn">not homed</Badge>}
      {whyNot.value ? <span class="muted">{whyNot.value}</span> : null}
    </p>
  );
}
