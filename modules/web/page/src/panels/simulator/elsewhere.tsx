// Carries the robot somewhere else: to a pose that is set on the plan or written, or to wherever chance has it.
import { signal } from "@preact/signals";
import { Move3d, Shuffle } from "lucide-preact";
import { useRef } from "preact/hooks";
import { drive, scene } from "../../state";
import { Button, Card, Empty } from "../../ui";
import { ownGesture } from "../../ui/gesture";
import { order } from "../../operate";
import { lacks } from "../lacks";
import { put, ROBOT } from "./faults";
import { frame, type Frame } from "./plan";

const place = signal<{ x: string; y: string; degrees: string }>({ x: "", y: "", degrees: "0" });

function pose(): { x: number; y: number; theta: number } | null {
  const { x, y, degrees } = place.value;
  const numbers = [x, y, degrees].map((text) => (text.trim() === "" ? NaN : Number(text.replace(",", "."))));
  const [a, b, c] = numbers as [number, number, number];
  return numbers.every((value) => Number.isFinite(value) && Math.abs(value) <= 1e4) ? { x: a, y: b, theta: (c * Math.PI) / 180 } : null;
}

export function Elsewhere() {
  const robot = scene.value;
  if (!robot) return null;
  const whyNot = lacks("engineer");
  const where = pose();
  const go = async () => {
    if (!where) return;
    const fault = put(where.x, where.y, where.theta);
    const done = await order({ type: "fault", target: ROBOT, fault, value: 0, duration: 0 }, "It was carried there, if there is room.");
    if (done) place.value = { ...place.value, x: "", y: "" };
  };
  // Any number draws another place.
  const kidnap = () =>
    void order({ type: "fault", target: ROBOT, fault: "kidnap", value: 1 + Math.floor(Math.random() * 1e6), duration: 0 }, "It was carried somewhere.");
  const field = (name: "x" | "y" | "degrees", label: string) => (
    <label class="field">
      {label}
      <input inputMode="decimal" size={7} value={place.value[name]} onInput={(event) => (place.value = { ...place.value, [name]: event.currentTarget.value })} />
    </label>
  );
  const plan = frame(robot);
  return (
    <Card title="Put the robot elsewhere" icon={Move3d}>
      {plan ? <Plan plan={plan} /> : <Empty>There is no plan of where it is.</Empty>}
      <form
        class="p-form"
        onSubmit={(event) => {
          event.preventDefault();
          if (whyNot === null) void go();
        }}
      >
        {field("x", "x, m")}
        {field("y", "y, m")}
        {field("degrees", "Heading, °")}
        <Button type="submit" kind="primary" icon={Move3d} whyNot={whyNot ?? (where ? null : "Choose a place first.")} onClick={() => {}}>
          Put it there
        </Button>
        <Button icon={Shuffle} whyNot={whyNot} onClick={kidnap}>
          Random place
        </Button>
        <p class="muted p-full">
          Press on the plan and drag to where it is to look. Its wheels do not turn and no module is informed: the estimator finds out by itself. {whyNot}
        </p>
      </form>
    </Card>
  );
}

/** The world from above, with where the robot is, believes to be, and is to be. */
function Plan({ plan }: { plan: Frame }) {
  const svg = useRef<SVGSVGElement>(null);
  const from = useRef<{ pointer: number; x: number; y: number } | null>(null);
  const robot = scene.value;
  const truth = drive.value?.truth.value;
  const estimate = drive.value?.estimate.value;
  const where = pose();
  const at = (event: PointerEvent): { x: number; y: number } | null => {
    const inverse = svg.current?.getScreenCTM()?.inverse();
    if (!inverse) return null;
    const point = new DOMPoint(event.clientX, event.clientY).matrixTransform(inverse);
    return { x: point.x, y: -point.y };
  };
  const down = (event: PointerEvent) => {
    const here = at(event);
    if (!here || event.button !== 0) return;
    svg.current?.setPointerCapture(event.pointerId);
    from.current = { pointer: event.pointerId, ...here };
    place.value = { ...place.value, x: here.x.toFixed(2), y: here.y.toFixed(2) };
  };
  const move = (event: PointerEvent) => {
    const here = at(event);
    const begun = from.current;
    if (!here || begun?.pointer !== event.pointerId) return;
    const [dx, dy] = [here.x - begun.x, here.y - begun.y];
    if (Math.hypot(dx, dy) > 0.02 * plan.width) place.value = { ...place.value, degrees: ((Math.atan2(dy, dx) * 180) / Math.PI).toFixed(0) };
  };
  const up = (event: PointerEvent) => {
    if (from.current?.pointer === event.pointerId) from.current = null;
  };
  if (!robot) return null;
  const size = Math.max(plan.width, plan.height) / 60;
  const arrow = (pose: { x: number | null; y: number | null; theta: number | null } | null | undefined, kind: string) =>
    pose && pose.x !== null && pose.y !== null && pose.theta !== null ? (
      <path
        class={kind}
        transform={`translate(${pose.x} ${-pose.y}) rotate(${(-pose.theta * 180) / Math.PI}) scale(${size})`}
        d="M2 0L-1.2 1.2L-0.6 0L-1.2 -1.2Z"
      />
    ) : null;
  return (
    <>
      <svg
        ref={svg}
        class="p-plan"
        viewBox={`${plan.x} ${-plan.y - plan.height} ${plan.width} ${plan.height}`}
        role="img"
        aria-label="Plan of the world. The fields below do the same."
        onTouchStart={ownGesture}
        onPointerDown={down}
        onPointerMove={move}
        onPointerUp={up}
        onPointerCancel={up}
      >
        {robot.walls.map(([x1, y1, x2, y2], n) => (
          <line key={n} x1={x1} y1={-y1} x2={x2} y2={-y2} />
        ))}
        {robot.columns.map(([x, y, radius], n) => (
          <circle key={n} cx={x} cy={-y} r={radius} />
        ))}
        {robot.beacons.map(({ id, x, y }) => (
          <text key={id} x={x} y={-y} font-size={size * 1.6}>
            ◆
          </text>
        ))}
        {arrow(estimate, "p-estimate")}
        {arrow(truth, "p-truth")}
        {arrow(where, "p-wished")}
      </svg>
      <p class="p-legend">
        <span class="p-truth">▲ it is here</span>
        <span class="p-estimate">△ it believes to be here</span>
        <span class="p-wished">▲ it is to be here</span>
      </p>
    </>
  );
}
