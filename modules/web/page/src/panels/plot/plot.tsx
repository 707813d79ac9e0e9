// Numbers over time, drawn live. Seconds count back from now; each series has a colour and a dash of its own.
import { useEffect, useRef } from "preact/hooks";
import uPlot from "uplot";
import "uplot/dist/uPlot.min.css";
import { shownTheme } from "../../design/theme";
import { figure } from "../format";
import { align, type Ring, thin } from "./ring";

export interface Series {
  label: string;
  ring: Ring;
  /** Which of the colours and dashes, 0 to 7. */
  style: number;
}

/** As many series can be told apart. */
export const STYLES = 8;
const DASHES: readonly number[][] = [[], [8, 4], [2, 3], [8, 3, 2, 3], [], [8, 4], [2, 3], [8, 3, 2, 3]];

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
  unit?: string;
}) {
  const host = useRef<HTMLDivElement>(null);
  const newest = useRef(props);
  newest.current = props;
  const kinds = props.series.map(({ label, style }) => `${label}\u0000${style}`).join("\u0001");
  useEffect(() => {
    const element = host.current;
    if (!element) return;
    const plot = build(element, newest.current);
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
    };
  }, [kinds, props.height, shownTheme.value]);
  return <div ref={host} class="p-plot" role="img" aria-label={props.label} />;
}

function build(element: HTMLElement, { series, height = 240, unit }: Parameters<typeof Plot>[0]): uPlot {
  const [text, grid] = [colour("--muted"), colour("--line")];
  const axis: uPlot.Axis = { stroke: text, grid: { stroke: grid, width: 1 }, ticks: { stroke: grid, width: 1 }, font: "12px system-ui, sans-serif" };
  return new uPlot(
    {
      width: Math.max(element.clientWidth, 100),
      height,
      legend: { show: false },
      cursor: { drag: { x: false, y: false }, points: { size: 7 } },
      scales: { x: { time: false, auto: false }, y: { range: room } },
      axes: [
        { ...axis, values: (_, splits) => splits.map((at) => (at === 0 ? "now" : `${at} s`.replace("-", "−"))) },
        { ...axis, size: 64, values: (_, splits) => splits.map((at) => figure(at) + (unit ? ` ${unit}` : "")) },
      ],
      series: [
        {},
        ...series.map(({ label, style }) => ({
          label,
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
