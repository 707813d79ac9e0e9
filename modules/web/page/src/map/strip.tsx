// The map from behind the robot, for the drive view of a phone: it follows, its heading is up, and no finger does anything on
// it, so that the view scrolls over it.
import { effect } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";
import { shownTheme } from "../design/theme";
import { drive, map, now, scene, sensors } from "../state";
import { t } from "../words";
import { behind, fitted, type Point, type Size } from "./camera";
import { mode, places, sent } from "./draft";
import { off } from "./layers";
import { inks, paint, pose } from "./paint";
import { trail } from "./trail";
import { positionWords } from "./words";

/** m that are shown from left to right. */
const ACROSS = 8;

export function MapStrip() {
  const canvas = useRef<HTMLCanvasElement>(null);
  useEffect(() => {
    const element = canvas.current as HTMLCanvasElement;
    const on = element.getContext("2d");
    let size: Size = { width: 0, height: 0 };
    let colours = inks();
    let frame = 0;
    const draw = () => {
      frame = 0;
      // Without any where another layout hides it.
      if (!on || size.width === 0) return;
      const robot = pose(drive.peek());
      const walls = (scene.peek()?.walls ?? []).flatMap(([a, b, c, d]): Point[] => [[a, b], [c, d]]);
      const dense = devicePixelRatio || 1;
      on.setTransform(dense, 0, 0, dense, 0, 0);
      paint(on, robot ? behind(robot, size, ACROSS) : fitted(walls, size, 16), size, colours);
    };
    const dirty = () => {
      if (frame === 0) frame = requestAnimationFrame(draw);
    };
    const resized = new ResizeObserver(() => {
      size = { width: element.clientWidth, height: element.clientHeight };
      const dense = devicePixelRatio || 1;
      element.width = Math.round(size.width * dense);
      element.height = Math.round(size.height * dense);
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
      [drive, sensors, map, scene, trail, places, mode, sent, off, now].forEach((each) => each.value);
      dirty();
    });
    return () => {
      cancelAnimationFrame(frame);
      resized.disconnect();
      stopTheme();
      stopData();
    };
  }, []);
  return (
    <section class="map-strip" aria-label={t("Around the robot")}>
      <canvas ref={canvas} role="img" aria-label={`${t("Map from behind the robot.")} ${positionWords(drive.value)}`} />
    </section>
  );
}
