// The buttons of the scenario editor below the map.
import { Bot, Download, Flag, MousePointer2, Package, Play, RotateCcw, RotateCw, Trash2, Undo2, User, X } from "lucide-preact";
import { useEffect } from "preact/hooks";
import { lacks } from "../panels/lacks";
import { fresh, scene, system } from "../state";
import { Button } from "../ui";
import { type Plain, t } from "../words";
import { begin } from "./draft";
import { chosen, download, FILE, history, key, refused, removable, remove, rename, run, scenario, tool, type Tool, turn, unanswered, undo, unreadable } from "./editor";
import { type Flaw, flaw } from "./scenario";

const TOOLS: [Tool, typeof Bot, Plain, Plain][] = [
  ["move", MousePointer2, "Choose and move", "Tap what was drawn to choose it, drag to move it. Drag elsewhere to move the map."],
  ["box", Package, "Box", "Drag from corner to corner; a tap makes a box of half a metre."],
  ["walker", User, "Person", "Tap where a person stands, or drag the way that the person walks to and fro."],
  ["start", Bot, "Start", "Tap where the robot begins; drag to where it looks."],
  ["waypoint", Flag, "Waypoint", "Tap the waypoints one after another."],
];
const TURN = Math.PI / 12;
const FLAWS: Record<Flaw, Plain> = {
  people: "There are more than 200 people.",
  near: "A person is nearer than 1.5 m to the start.",
  unnamed: "The route has no name.",
  taken: "The world has a route of this name.",
  map: "This world has a map file, which is not sent. Download the scenario and start it from the folder of the map.",
  long: "The scenario is longer than 32 KiB.",
};

export function EditorTools() {
  useEffect(() => {
    const pressed = (event: KeyboardEvent) => {
      const at = event.target;
      if (at instanceof HTMLInputElement || at instanceof HTMLSelectElement || at instanceof HTMLTextAreaElement) return;
      if (key(event)) event.preventDefault();
    };
    addEventListener("keydown", pressed);
    return () => removeEventListener("keydown", pressed);
  }, []);
  const drawn = scenario.value;
  const close = (
    <Button icon={X} onClick={() => begin("look")}>
      {t("Close the editor")}
    </Button>
  );
  if (!drawn) {
    return (
      <div class="map-editor" role="group" aria-label={t("Scenario editor")}>
        <p>
          {unreadable.value && unreadable.value !== "start"
            ? t("The file of this world was edited by hand. Line {n}, or what follows it, is not as the editor writes it, and stays as it is: {text}", { n: unreadable.value.line, text: unreadable.value.text })
            : t("The file of this world cannot be edited here: it is longer than 32 KiB, or its start was not found.")}
        </p>
        <div class="map-tools">{close}</div>
      </div>
    );
  }
  const which = chosen.value === null ? undefined : drawn.items[chosen.value];
  const none = which ? null : t("Choose something first");
  const paced = fresh(system.value?.run) !== null && fresh(system.value?.run) !== undefined;
  const why = flaw(drawn);
  const wrong = why === null ? null : t(FLAWS[why]);
  const hint = TOOLS.find(([name]) => name === tool.value)?.[3];
  return (
    <div class="map-editor" role="group" aria-label={t("Scenario editor")}>
      <div class="map-tools">
        {TOOLS.map(([name, icon, label]) => (
          <Button key={name} icon={icon} pressed={tool.value === name} onClick={() => (tool.value = name)}>
            {t(label)}
          </Button>
        ))}
      </div>
      <p role="status">{hint ? t(hint) : ""}</p>
      <div class="map-tools">
        <Button icon={RotateCcw} label={t("Turn left")} whyNot={none} onClick={() => turn(TURN)} />
        <Button icon={RotateCw} label={t("Turn right")} whyNot={none} onClick={() => turn(-TURN)} />
        <Button icon={Trash2} whyNot={none ?? (removable() ? null : t("The robot begins somewhere"))} onClick={remove}>
          {t("Remove")}
        </Button>
        <Button icon={Undo2} whyNot={history.value.length > 0 ? null : t("There is none")} onClick={undo}>
          {t("Undo")}
        </Button>
        <label class="field">
          {t("Name of the route")}
          <input maxLength={40} value={drawn.route} onInput={(event) => rename(event.currentTarget.value)} />
        </label>
      </div>
      <div class="map-tools">
        <Button icon={Play} kind="primary" whyNot={lacks("engineer") ?? (paced ? wrong : t("This simulation runs in real time and cannot change its world."))} onClick={() => void run()}>
          {t("Run the scenario")}
        </Button>
        <Button icon={Download} onClick={download}>
          {t("Download")}
        </Button>
        {close}
      </div>
      {paced ? <p>{t("When it is run, the robot begins anew, and whoever has control must take it again.")}</p> : null}
      {refused.value ? (
        <p role="alert">
          {t("The simulation refused it: {why}", { why: refused.value })}
        </p>
      ) : null}
      {unanswered.value ? <p role="alert">{t("The simulation has not answered for 10 s.")}</p> : null}
      {wrong ? <p>{wrong}</p> : null}
      {paced ? null : (
        <p>
          {t("This simulation runs in real time and cannot change its world.")} {t("Download the scenario and start it:")} <code>advee up --sim --speed 1 --world ./{FILE}</code>
        </p>
      )}
      <p class="muted">
        {t("All else that the file of the world {name} has stays in it as it is. Its own walls, columns, beacons, visitors and routes are not edited here.", { name: fresh(system.value?.run)?.world ?? scene.value?.robot ?? "" })}
      </p>
    </div>
  );
}
