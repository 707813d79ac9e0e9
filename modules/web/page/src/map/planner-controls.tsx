// The operation mode of the planner, its speed limit and its other parameters, for those who may command the robot.
import { useEffect, useState } from "preact/hooks";
import { SlidersHorizontal } from "lucide-preact";
import { order } from "../operate";
import { drive, fresh, may, stale, system, whyNot } from "../state";
import { Button } from "../ui";
import { t } from "../words";
import { meant, MODES, modeWhyNot, parameterName, stepOf, type Usable, usable, valueWords } from "./planner";

export function PlannerControls() {
  const current = drive.value?.mode;
  if (!may("operator") || !current?.value) return null;
  return (
    <div class="map-planner">
      <Modes />
      <Parameters />
    </div>
  );
}

function Modes() {
  const shown = drive.value?.mode;
  const current = fresh(shown);
  const why = (number: number) => whyNot.value ?? (current ? modeWhyNot(number, current) : t("The mode is not known."));
  return (
    <div class="choice map-modes" role="group" aria-label={t("Mode")}>
      {MODES.map(([mode, name], number) => (
        <Button key={mode} label={t("Mode: {name}", { name: t(name) })} pressed={current?.mode === number} whyNot={why(number)} onClick={() => void order({ type: "mode", mode })}>
          {t(name)}
        </Button>
      ))}
    </div>
  );
}

/** The first one is the speed limit. */
function Parameters() {
  const shown = system.value?.parameters;
  const all = usable(shown?.value?.parameters ?? []);
  const [first] = all;
  if (!first) return null;
  return (
    <details class={`map-parameters ${stale(shown) ? "is-stale" : ""}`}>
      <summary>
        <SlidersHorizontal size={18} aria-hidden />
        <span>
          {parameterName(first.name)} <span class="figure">{valueWords(first.name, first.value)}</span>
        </span>
      </summary>
      <div class="map-sliders">
        {all.map((parameter) => (
          <Parameter key={parameter.name} parameter={parameter} />
        ))}
      </div>
      <p class="why-not">{t("For the planner only, until it restarts. Driving by hand is not limited by it.")}</p>
    </details>
  );
}

/** ms for which a value that was set is shown before the robot shows it. */
const SHOWN = 2500;

function Parameter({ parameter }: { parameter: Usable }) {
  const { name, value, minimum, maximum, configured } = parameter;
  const [slid, setSlid] = useState<number | null>(null);
  useEffect(() => setSlid(null), [value]);
  useEffect(() => {
    if (slid === null) return;
    const timer = setTimeout(() => setSlid(null), SHOWN);
    return () => clearTimeout(timer);
  }, [slid]);
  const off = whyNot.value;
  const set = async (next: number) => {
    if (next !== value && !(await order({ type: "parameter", name, value: next }))) setSlid(null);
  };
  return (
    <label class="map-slider" title={off ?? undefined}>
      <span>{parameterName(name)}</span>
      <input
        type="range"
        min={minimum}
        max={maximum}
        step={stepOf(name)}
        value={slid ?? value}
        disabled={off !== null}
        aria-valuetext={valueWords(name, slid ?? value)}
        onInput={(event) => setSlid(meant(parameter, event.currentTarget.valueAsNumber))}
        onChange={(event) => void set(meant(parameter, event.currentTarget.valueAsNumber))}
      />
      <span class="figure">{valueWords(name, slid ?? value)}</span>
      <span class="muted">{value === configured ? "" : t("configured {value}", { value: valueWords(name, configured) })}</span>
    </label>
  );
}
