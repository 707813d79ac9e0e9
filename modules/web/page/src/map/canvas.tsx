// The canvas under the hand: drag, wheel and pinch look around; a tap places, a drag from there turns; a long press
// begins to place a goal without the buttons.
import { effect, signal } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";
import { shownTheme } from "../design/theme";
import { drive, map, may, now, scene, sensors } from "../state";
import { ownGesture } from "../ui/gesture";
import { type Camera, fitted, panned, type Point, type Size, toMap, zoomed } from "./camera";
import { begin, mode, places, put, sent, turn } from "./draft";
import { abandon, chosen, drop, press, pull, scenario } from "./editor";
import { off } from "./layers";
import { inks, paint, pose } from "./paint";
import { trail } from "./trail";

/** px that a finger may tremble; px from a place before a drag turns it; ms of a long press. */
const TREMBLE = 8;
const TURNS = 18;
/** px by which the mouse may miss what was drawn; a finger twice as many. */
const MISS = 6;
const LONG = 500;

/** What the buttons beside the canvas do to it. */
export interface Looker {
  zoom(factor: number): void;
  fit(): void;
}

/** Where the mouse is on the map, m; null: nowhere. */
export const under = signal<Point | null>(null);

export function MapCanvas(props: { follow: boolean; onFollow: (follow: boolean) => void; looker: { current: Looker | null }; label: string }) {
  const canvas = useRef<HTMLCanvasElement>(null);
  const live = useRef(props);
  live.current = props;

  useEffect(() => {
    const element = canvas.current as HTMLCanvasElement;
    const on = element.getContext("2d");
    let size: Size = { width: 1, height: 1 };
    let camera: Camera = { x: 0, y: 0, scale: 40, turn: 0 };
    let placed = false;
    /** Somebody has looked elsewhere: what is shown stays. */
    let looked = false;
    let colours = inks();
    let frame = 0;

    const fit = () => {
      const all = scene.peek();
      const points: Point[] = all ? [...all.walls.flatMap(([a, b, c, d]): Point[] => [[a, b], [c, d]]), ...all.beacons.map(({ x, y }): Point => [x, y])] : [];
      const robot = pose(drive.peek());
      if (points.length === 0 && robot) points.push([robot.x - 4, robot.y - 4], [robot.x + 4, robot.y + 4]);
      // At the right are the buttons, at the bottom the layers and the scale bar.
      const beside = getComputedStyle(element.closest(".map-picture")?.querySelector(".map-zoom") ?? element).position === "absolute";
      camera = fitted(points, size, 26, beside ? 58 : 0, beside ? 36 : 12);
      placed = points.length > 0;
      dirty();
    };
    const draw = () => {
      frame = 0;
      // A browser without any: the words below the map are there.
      if (!on) return;
      if (!placed) fit();
      const robot = pose(drive.peek());
      if (live.current.follow && robot) camera = { ...camera, x: robot.x, y: robot.y };
      const dense = devicePixelRatio || 1;
      on.setTransform(dense, 0, 0, dense, 0, 0);
      paint(on, camera, size, colours);
    };
    const dirty = () => {
      if (frame === 0) frame = requestAnimationFrame(draw);
    };
    live.current.looker.current = {
      zoom: (factor) => {
        looked = true;
        camera = zoomed(camera, size, factor, [size.width / 2, size.height / 2]);
        dirty();
      },
      fit: () => {
        looked = false;
        live.current.onFollow(false);
        fit();
      },
    };

    const resized = new ResizeObserver(() => {
      const before = size;
      size = { width: element.clientWidth || 1, height: element.clientHeight || 1 };
      const dense = devicePixelRatio || 1;
      element.width = Math.round(size.width * dense);
      element.height = Math.round(size.height * dense);
      if (before.width === 1 || !looked) placed = false;
      // At once: a canvas that was resized is empty until it is drawn.
      cancelAnimationFrame(frame);
      draw();
    });
    resized.observe(element);
    const stopTheme = effect(() => {
      shownTheme.value;
      colours = inks();
      dirty();
    });
    const stopData = effect(() => {
      // Whatever is drawn.
      [drive, sensors, map, scene, trail, places, mode, sent, scenario, chosen, off, now].forEach((each) => each.value);
      dirty();
    });

    // ---- hands
    const fingers = new Map<number, Point>();
    let from: Point | null = null;
    let long: ReturnType<typeof setTimeout> | undefined;
    /** What the first finger does. */
    let doing: "nothing" | "press" | "pan" | "turn" | "draw" = "nothing";
    const where = (event: PointerEvent | WheelEvent): Point => {
      const box = element.getBoundingClientRect();
      return [event.clientX - box.left, event.clientY - box.top];
    };
    const place = (at: Point) => put(...toMap(camera, size, at), pose(drive.peek())?.theta ?? 0);
    const down = (event: PointerEvent) => {
      if (event.button !== 0) return;
      element.setPointerCapture(event.pointerId);
      const at = where(event);
      fingers.set(event.pointerId, at);
      clearTimeout(long);
      if (fingers.size > 1) {
        // A second finger makes it a pinch; what the first one placed goes again.
        if (doing === "draw") abandon();
        if (doing === "turn") places.value = places.value.slice(0, -1);
        doing = "pan";
        looked = true;
        return;
      }
      from = at;
      if (mode.value === "edit") {
        doing = press(toMap(camera, size, at), (event.pointerType === "mouse" ? MISS : 2 * MISS) / camera.scale) ? "draw" : "press";
        return;
      }
      if (mode.value !== "look") {
        place(at);
        doing = "turn";
        return;
      }
      doing = "press";
      if (!may("operator")) return;
      long = setTimeout(() => {
        if (doing !== "press") return;
        begin("go");
        place(at);
        doing = "turn";
        navigator.vibrate?.(20);
      }, LONG);
    };
    const leave = () => (under.value = null);
    const move = (event: PointerEvent) => {
      if (event.pointerType === "mouse") under.value = toMap(camera, size, where(event));
      const before = fingers.get(event.pointerId);
      if (!before) return;
      const at = where(event);
      fingers.set(event.pointerId, at);
      if (fingers.size === 2) {
        const other = [...fingers].find(([id]) => id !== event.pointerId)?.[1] as Point;
        const old = distance(before, other);
        camera = panned(camera, middle(before, other), middle(at, other));
        if (old > 1) camera = zoomed(camera, size, distance(at, other) / old, middle(at, other));
        live.current.onFollow(false);
        dirty();
        return;
      }
      const moved = from ? distance(from, at) : 0;
      if (doing === "draw") {
        // A finger that trembles moves nothing.
        if (moved > TREMBLE) pull(toMap(camera, size, at));
        return;
      }
      if (doing === "turn") {
        if (moved > TURNS) turn(...toMap(camera, size, at));
        return;
      }
      if (doing === "press" && moved > TREMBLE) {
        clearTimeout(long);
        doing = "pan";
        looked = true;
        live.current.onFollow(false);
      }
      if (doing !== "pan") return;
      camera = panned(camera, before, at);
      dirty();
    };
    const up = (event: PointerEvent) => {
      fingers.delete(event.pointerId);
      clearTimeout(long);
      if (doing === "draw") event.type === "pointercancel" ? abandon() : drop();
      if (fingers.size === 0) doing = "nothing";
      else if (doing === "draw") doing = "pan";
    };
    const wheel = (event: WheelEvent) => {
      event.preventDefault();
      looked = true;
      const at: Point = live.current.follow ? [size.width / 2, size.height / 2] : where(event);
      camera = zoomed(camera, size, Math.exp(-event.deltaY * (event.deltaMode === 1 ? 0.05 : 0.0015)), at);
      dirty();
    };
    const key = (event: KeyboardEvent) => {
      if (event.ctrlKey || event.altKey || event.metaKey) return;
      if (event.key === "+" || event.key === "=") live.current.looker.current?.zoom(1.25);
      else if (event.key === "-") live.current.looker.current?.zoom(0.8);
      else if (event.key === "0") live.current.looker.current?.fit();
      else return;
      event.preventDefault();
    };
    element.addEventListener("touchstart", ownGesture, { passive: false });
    element.addEventListener("pointerdown", down);
    element.addEventListener("pointermove", move);
    element.addEventListener("pointerup", up);
    element.addEventListener("pointercancel", up);
    element.addEventListener("pointerleave", leave);
    element.addEventListener("wheel", wheel, { passive: false });
    element.addEventListener("keydown", key);
    return () => {
      clearTimeout(long);
      cancelAnimationFrame(frame);
      resized.disconnect();
      stopTheme();
      stopData();
    };
  }, []);

  return <canvas ref={canvas} class={`map-canvas is-${mode.value}`} tabIndex={0} role="img" aria-label={props.label} onContextMenu={(event) => event.preventDefault()} />;
}

const distance = (a: Point, b: Point): number => Math.hypot(a[0] - b[0], a[1] - b[1]);
const middle = (a: Point, b: Point): Point => [(a[0] + b[0]) / 2, (a[1] + b[1]) / 2];
