// A value between two ends with zero in the middle: what is (the bar) and what is commanded (the mark).
import { t } from "../words";

export function Gauge(props: {
  name: string;
  /** Both as shown in words, and as shares of the greatest, -1 to 1; null: not known. */
  actual: string;
  commanded: string;
  is: number | null;
  wanted: number | null;
  stale: boolean;
  /** What the guard permits either way, as shares of the greatest; null: not known, or no guard. */
  bounds?: [number | null, number | null];
  /** Greater values are to the left. */
  mirrored?: boolean;
}) {
  const { name, actual, commanded, stale, mirrored } = props;
  const place = (share: number | null): number => 50 + (mirrored ? -50 : 50) * Math.max(-1, Math.min(1, share ?? 0));
  const [from, to] = [Math.min(50, place(props.is)), Math.max(50, place(props.is))];
  return (
    <div class={stale ? "gauge is-stale" : "gauge"}>
      <div class="gauge-words">
        <span>{name}</span>
        <strong class="figure">{actual}</strong>
        <small class="figure">{t("(target {value})", { value: commanded })}</small>
      </div>
      <div class="gauge-bar" aria-hidden>
        <i class="gauge-middle" />
        {props.is === null ? null : <i class="gauge-is" style={{ left: `${from}%`, width: `${to - from}%` }} />}
        {(props.bounds ?? []).map((share, n) =>
          share === null || Math.abs(share) >= 1 ? null : <i key={n} class="gauge-bound" style={{ left: `${place(share)}%` }} />,
        )}
        {props.wanted === null ? null : <i class="gauge-wanted" style={{ left: `${place(props.wanted)}%` }} />}
      </div>
    </div>
  );
}
