// Driving by hand: who has control, the pad, what the robot does, and why it does not.
import { Flag, Gamepad2, Hand, House, Keyboard, ListChecks, Move, ShieldAlert } from "lucide-preact";
import { useEffect, useRef } from "preact/hooks";
import { deg, num, span } from "../format";
import { standing } from "../holds";
import { MapPanel } from "../map";
import { Destination } from "../map/drive-to";
import { MapStrip } from "../map/strip";
import { boundWords } from "../map/words";
import { order, release, resume, sentence, stopped, take } from "../operate";
import { authority, connection, demo, drive, fresh, holder, may, scene, stale, whyNot } from "../state";
import type { DrivePart } from "../protocol";
import { t } from "../words";
import { holdWords, said as translated } from "../words/said";
import { Age, Badge, Button, Card, Slide } from "../ui";
import { type Advice, advice } from "./advice";
import { Gauge } from "./gauge";
import { Creep } from "./creep";
import { Pad } from "./pad";
import { Nearest } from "./ring";
import type { Demand } from "./hold";
import { begin, closedWays, commanded, endedWhy, fingerOn, gamepadName, goesSideways, PACES, pace, padSideways } from "./session";
import "./drive.css";

export function Drive() {
  useEffect(begin, []);
  return (
    <div class={authority.value.yours ? "drive" : "drive is-watching"}>
      <div class="drive-map">
        <MapPanel />
      </div>
      {/* On a wide screen it scrolls by itself, also where nothing in it can be pressed: the keys reach it. */}
      <div class="drive-side" tabIndex={0} role="group" aria-label={t("Control and state, can be scrolled")}>
        <Control />
        <Why />
        <MapStrip />
        {may("operator") ? <Hands /> : null}
        <Motion />
        {/* On a wide screen the map beside has the same. */}
        <Card title={t("Destination")} icon={Flag} class="drive-destination">
          <Destination />
        </Card>
        <Homing />
      </div>
    </div>
  );
}

/** Takes control, or over from who has it, by a gesture that names them. */
function Control() {
  if (demo.value) return null;
  const who = holder.value;
  const yours = authority.value.yours;
  const pairing = may("operator") ? null : t("Pair this device to take control");
  if (!may("operator")) {
    return (
      <Card title={t("You are watching")} icon={Hand} class="control">
        <p>{t("To drive, enter the code from the robot's console.")}</p>
        <a class="button primary" href="#/access">
          {t("Pair this device")}
        </a>
      </Card>
    );
  }
  if (yours) {
    return (
      <section class="card control is-yours" aria-label={t("Control")}>
        <h2>
          <Hand size={18} aria-hidden /> {t("You have control")}
        </h2>
        <Button onClick={() => void release()}>{t("Release control")}</Button>
      </section>
    );
  }
  return (
    <Card
      title={who ? t("{name} has control", { name: who.name }) : t("Nobody has control")}
      icon={Hand}
      aside={who ? <Badge tone={who.driving ? "good" : "off"}>{who.driving ? t("drives") : t("since {time}", { time: span(who.since) })}</Badge> : null}
    >
      {who ? (
        <Slide label={t("Take over from {name}", { name: who.name })} tone="danger" whyNot={pairing} onConfirm={() => void take()} />
      ) : (
        <Button icon={Hand} kind="primary" whyNot={connection.value.state === "live" ? pairing : t("There is no connection")} onClick={() => void take()}>
          {t("Take control")}
        </Button>
      )}
    </Card>
  );
}

/** Why it does not move, and what to do. */
function Why() {
  const part = drive.value;
  const last = useRef<{ said: Advice | null; part: DrivePart | null }>({ said: null, part: null });
  // While a hand is on the pad nothing above it comes or goes: the pad would move under the hand. It says itself why it is off.
  if (commanded.value === null && !fingerOn.value) {
    last.current = { said: part && connection.value.state === "live" ? advice(part, stopped.value, authority.value.yours) : null, part };
  }
  const { said } = last.current;
  if (!said) return null;
  return (
    <Card title={said.title} icon={ListChecks} class="why tone-warn">
      <ol class="steps">
        {said.steps.map((step) => (
          <li key={step}>{step}</li>
        ))}
      </ol>
      <Standing part={last.current.part} />
      {said.offer === "resume" && may("operator") ? (
        <Slide label={t("Resume")} tone="good" whyNot={whyNot.value} onConfirm={() => void resume()} />
      ) : null}
      {said.offer === "modules" ? (
        <div class="row">
          <a class="button" href="#/modules">
            {t("Modules")}
          </a>
          <a class="button" href="#/errors">
            {t("Errors")}
          </a>
        </div>
      ) : null}
    </Card>
  );
}

/** All that stands against acting, where that is more than one thing. */
function Standing({ part }: { part: DrivePart | null }) {
  const rows = standing(part?.holds ?? []);
  const now = part?.motion.value?.timestamp ?? null;
  if (rows.length < 2) return null;
  return (
    <ul class="standing" aria-label={t("All that stands against moving")}>
      {rows.map((row) => (
        <li key={`${row.code} ${row.subject}`}>
          {sentence(holdWords(row))}
          {now !== null && row.since !== null ? <span class="age">{span(Math.max(0, (now - row.since) / 1e6))}</span> : null}
          {row.latched ? <Badge tone="warn">{t("latched until commanded")}</Badge> : null}
        </li>
      ))}
    </ul>
  );
}

/** What is, and what is commanded. */
function Motion() {
  const shown = drive.value?.motion;
  const motion = shown?.value ?? null;
  const grey = stale(shown);
  const { speed, steering, rotation, sideways } = scene.value?.limits ?? { speed: 1, steering: 1, rotation: 0, sideways: 0 };
  const body = drive.value?.velocity.value ?? null;
  const unsure = stale(drive.value?.velocity);
  const of = (value: number | null | undefined, most: number): number | null => (typeof value === "number" ? value / most : null);
  const guard = fresh(drive.value?.guard);
  /** What the guard permits to either side of zero. */
  const between = (below: number | null | undefined, above: number | null | undefined, most: number): [number | null, number | null] =>
    guard === null ? [null, null] : [of(-(below ?? 0), most), of(above, most)];
  return (
    <Card title={t("Motion")} icon={Move} aside={<Age shown={shown} />}>
      <Gauge
        name={t("Speed")}
        actual={num(motion?.speed, 2, "m/s")}
        commanded={num(motion?.speed_target, 2, "m/s")}
        is={of(motion?.speed, speed)}
        wanted={of(motion?.speed_target, speed)}
        stale={grey}
        bounds={between(guard?.backward, guard?.forward, speed)}
      />
      <Bounded />
      {sideways > 0 ? (
        <Gauge
          name={t("Sideways")}
          actual={aside(body?.vy)}
          commanded={aside(body?.vy_target)}
          is={of(body?.vy, sideways)}
          wanted={of(body?.vy_target, sideways)}
          stale={unsure}
          bounds={between(guard?.right, guard?.left, sideways)}
          mirrored
        />
      ) : null}
      {rotation > 0 ? (
        <Gauge
          name={t("Rotation")}
          actual={turn(body?.omega)}
          commanded={turn(body?.omega_target)}
          is={of(body?.omega, rotation)}
          wanted={of(body?.omega_target, rotation)}
          stale={unsure}
          bounds={between(guard?.turn_right, guard?.turn_left, rotation)}
          mirrored
        />
      ) : (
        <Gauge
          name={t("Steering")}
          actual={side(motion?.steering)}
          commanded={side(motion?.steering_target)}
          is={of(motion?.steering, steering)}
          wanted={of(motion?.steering_target, steering)}
          stale={grey}
          mirrored
        />
      )}
      <p class="why-not">{t("Driven by: {who}", { who: drive.value?.driver ? translated(drive.value.driver) : t("nobody") })}</p>
    </Card>
  );
}

/** The bound that holds, and by what. */
function Bounded() {
  const part = drive.value;
  if (!part?.bound) return null;
  return (
    <p class={stale(part.guard) ? "bound is-stale" : "bound"}>
      <ShieldAlert size={16} aria-hidden /> <span>{[...boundWords(part).map(sentence), ...closedWays.value].join(" ")}</span>
    </p>
  );
}

/** An angle of the steering, in words which side. */
const side = (value: number | null | undefined): string => sided(value, deg(size(value)));
/** A rotation. */
const turn = (value: number | null | undefined): string => sided(value, typeof value === "number" ? `${deg(size(value))}/s` : deg(value));
/** A speed to a side. */
const aside = (value: number | null | undefined): string => sided(value, num(size(value), 2, "m/s"));

const size = (value: number | null | undefined): number | null | undefined => (typeof value === "number" ? Math.abs(value) : value);
/** With the side, unless it is shown as zero. */
function sided(value: number | null | undefined, text: string): string {
  return typeof value !== "number" || !/[1-9]/.test(text) ? text : `${text} ${value > 0 ? t("left") : t("right")}`;
}

/** What a hand commands, in words. */
function demanded({ speed, steering, rotation, sideways }: Demand): string {
  const ahead = num(speed, 2, "m/s");
  if (rotation === undefined) return `${ahead}, ${side(steering)}`;
  return [ahead, ...(sideways === undefined ? [] : [aside(sideways)]), turn(rotation)].join(", ");
}

function Hands() {
  const limits = scene.value?.limits;
  const now = commanded.value;
  return (
    <Card title={t("Hold to drive")} icon={Gamepad2} class="hands">
      <div class="choice" role="group" aria-label={t("How fast at most")}>
        {(Object.keys(PACES) as (keyof typeof PACES)[]).map((each) => (
          <Button key={each} pressed={pace.value === each} onClick={() => (pace.value = each)}>
            {each === "slow" ? t("Slow") : t("Normal")} {limits ? num(limits.speed * PACES[each], 2, "m/s") : ""}
          </Button>
        ))}
      </div>
      {goesSideways.value ? (
        <div class="choice sides" role="group" aria-label={t("What the sides of the pad do")}>
          {[false, true].map((each) => (
            <Button key={String(each)} pressed={padSideways.value === each} whyNot={now ? t("Let go first.") : null} onClick={() => (padSideways.value = each)}>
              {each ? t("Go sideways") : t("Turn")}
            </Button>
          ))}
        </div>
      ) : null}
      <Pad />
      <Nearest />
      <Creep />
      <p class="hands-said figure" role="status">
        {now ? demanded(now) : endedWhy.value ? sentence(endedWhy.value) : t("Let go, and it stops.")}
      </p>
      <p class="why-not hands-keys">
        <span>
          <Keyboard size={16} aria-hidden /> {drive.value?.bound ? t("arrow keys or WASD, with C to creep") : t("arrow keys or WASD")}
          {goesSideways.value ? `; ${t("Q and E go sideways")}` : null}
        </span>
        <span>
          <Gamepad2 size={16} aria-hidden /> {pads(gamepadName.value, Boolean(drive.value?.bound))}
        </span>
      </p>
    </Card>
  );
}

/** What to do with a gamepad; `creeps`: the robot has a guard. */
function pads(name: string | null, creeps: boolean): string {
  if (!name) return t("gamepad: press one of its buttons");
  return creeps ? t("{name}: hold a shoulder button, both to creep", { name }) : t("{name}: hold a shoulder button", { name });
}

function Homing() {
  // A base that does not steer has nothing to home.
  if ((scene.value?.limits.rotation ?? 0) > 0) return null;
  const motion = fresh(drive.value?.motion);
  const needed = motion !== null && !motion.homed;
  const home = () => void order({ type: "home", axis: "steering" }, t("The steering looks for its switch."));
  return (
    <Card
      title={t("Steering")}
      icon={House}
      aside={motion === null ? <Badge tone="off">{t("not known")}</Badge> : <Badge tone={motion.homed ? "good" : "warn"}>{motion.homed ? t("homed") : t("not homed")}</Badge>}
    >
      {!may("operator") ? null : needed ? (
        <Button icon={House} kind="primary" whyNot={whyNot.value} onClick={home}>
          {t("Home the steering")}
        </Button>
      ) : (
        <Slide label={t("Home the steering anew")} whyNot={whyNot.value} onConfirm={home} />
      )}
    </Card>
  );
}
