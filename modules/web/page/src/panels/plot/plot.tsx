// Numbers over time, drawn live. Seconds count back from now; each series has a colour and a dash of its own.
import { useEffect, useRef } from "preact/hooks";
import uPlot from "uplot";
import "uplot/dist/uPlot.min.css";
import { shownTheme } from "../../design/theme";
import { figure } from "../format";
import { axes } from "./axes";
import { align, type Ring, thin } from "./ring";

export interface Series {
  label: string;
  ring: Ring;
  /** Which of the colours and dashes, 0 to 7. */
  style: number;
  /** Its unit: series of a second one have an axis of their own; empty: none. */
  unit?: string;
}

/** As many series can be told apart. */
export const STYLES = 8;
const DASHES: readonly number[][] = [[], [8, 4], [2, 3], [8, 3, 2, 3], [], [8, 4], [2, 3], [8, 3, 2, 3]];

const FONT = "12px system-ui, sans-serif";

/** ms between two drawings. */
const DRAWN = 100;

function colour(name: string): string {
  return getComputedStyle(document.documentElement).getPropertyValue(name).trim() || "gray";
}

export function Plot(props: {
  series: Series[];
  /** s that are shown. */
  window: number;
  /** The instant at the right edge; asked at each drawing. */
  end: () => number;
  height?: number;
  /** What it shows, for who does not see it. */
  label: string;
  /** s from the right edge to where the mouse or a finger is, not positive; null: nowhere. */
  onPoint?: (at: number | null) => void;
}) {
  const host = useRef<HTMLDivElement>(null);
  const newest = useRef(props);
  newest.current = props;
  const kinds = props.series.map(({ label, style, unit }) => `${label}\u0000${style}\u0000${unit ?? ""}`).join("\u0001");
  useEffect(() => {
    const element = host.current;
    if (!element) return;
    const plot = build(element, newest.current, (at) => newest.current.onPoint?.(at));
    const draw = () => {
      if (!document.hidden) show(plot, newest.current);
    };
    const timer = setInterval(draw, DRAWN);
    const sized = new ResizeObserver(() => plot.setSize({ width: element.clientWidth, height: newest.current.height ?? 240 }));
    sized.observe(element);
    draw();
    return () => {
      clearInterval(timer);
      sized.disconnect();
      plot.destroy();
      newest.current.onPoint?.(null);
    };
  }, [kinds, props.height, shownTheme.value]);
  return <div ref={host} class="p-plot" role="img" aria-label={props.label} />;
}

function build(element: HTMLElement, { series, height = 240 }: Parameters<typeof Plot>[0], onPoint: (at: number | null) => void): uPlot {
  const [text, grid] = [colour("--muted"), colour("--line")];
  const axis: uPlot.Axis = { stroke: text, grid: { stroke: grid, width: 1 }, ticks: { stroke: grid, width: 1 }, font: FONT };
  const { sides, left, right } = axes(series.map(({ unit = "" }) => unit));
  const upright = (scale: string, unit: string): uPlot.Axis => ({
    ...axis, scale, size: 56, values: (_, splits) => splits.map(figure), ...(unit ? { label: unit, labelSize: 18, labelGap: 2, labelFont: FONT } : {}),
  });
  // uPlot says -10 where the pointer is elsewhere.
  const pointed = (plot: uPlot) => onPoint((plot.cursor.left ?? -1) < 0 ? null : plot.posToVal(plot.cursor.left as number, "x"));
  return new uPlot(
    {
      width: Math.max(element.clientWidth, 100),
      height,
      legend: { show: false },
      cursor: { drag: { x: false, y: false }, points: { size: 7 } },
      hooks: { setCursor: [pointed] },
      scales: { x: { time: false, auto: false }, left: { range: room }, right: { range: room } },
      axes: [
        { ...axis, values: (_, splits) => splits.map((at) => (at === 0 ? "now" : `${at} s`.replace("-", "−"))) },
        upright("left", left),
        // One grid is enough.
        ...(right === null ? [] : [{ ...upright("right", right), side: 1, grid: { show: false } } as uPlot.Axis]),
      ],
      series: [
        {},
        ...series.map(({ label, style }, n) => ({
          label,
          scale: sides[n] as string,
          stroke: colour(`--p-series-${style % STYLES}`),
          width: 2,
          dash: DASHES[style % STYLES] as number[],
          points: { show: false },
        })),
      ],
    },
    [[], ...series.map(() => [])] as unknown as uPlot.AlignedData,
    element,
  );
}

/** Some room above and below; a line that does not move is in the middle. */
function room(_: uPlot, low: number | null, high: number | null): uPlot.Range.MinMax {
  if (low === null || high === null || !Number.isFinite(low) || !Number.isFinite(high)) return [-1, 1];
  const margin = high > low ? 0.08 * (high - low) : Math.max(Math.abs(high) * 0.05, 0.01);
  return [low - margin, high + margin];
}

function show(plot: uPlot, { series, window, end }: Parameters<typeof Plot>[0]): void {
  const right = end();
  const most = Math.max(200, 2 * plot.width);
  const past = series.map(({ ring }) => {
    const { at, values } = thin(ring.from(right - window), most);
    return { at: at.map((when) => when - right), values };
  });
  plot.setData(align(past) as uPlot.AlignedData, false);
  plot.setScale("x", { min: -window, max: 0 });
}
