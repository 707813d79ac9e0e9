// Where to: the named destinations of the world as a list, how far the robot is on its way, and the end of that.
import { CircleX, MapPinned, Repeat } from "lucide-preact";
import { useState } from "preact/hooks";
import { isHeld } from "../holds";
import { order } from "../operate";
import { drive, may, scene, whyNot } from "../state";
import { Button, Dialog, Empty } from "../ui";
import { t } from "../words";
import { progress, waypoints, what } from "./destinations";
import { goRoute, sent, sentAs, taken } from "./draft";
import { goalWords, isActive, standsWhy } from "./words";

/** Opens the list. */
export function DriveTo() {
  const [open, setOpen] = useState(false);
  const routes = scene.value?.routes ?? [];
  if (routes.length === 0) return null;
  const close = () => setOpen(false);
  return (
    <>
      <Button icon={MapPinned} whyNot={whyNot.value} onClick={() => setOpen(true)}>
        {t("Drive to…")}
      </Button>
      <Dialog title={t("Drive to")} open={open} onClose={close}>
        <ul class="destinations">
          {routes.map((route) => (
            <li key={route.name}>
              <Button icon={waypoints(route).points.length > 1 ? Repeat : MapPinned} whyNot={whyNot.value} onClick={() => (close(), void goRoute(route))}>
                {route.name}
              </Button>
              <span class="muted">{what(route)}</span>
            </li>
          ))}
        </ul>
      </Dialog>
    </>
  );
}

/** While there is a goal under way. */
export function CancelGoal() {
  const goal = drive.value?.goal.value;
  if (!goal || !isActive(goal)) return null;
  const cancel = async () => {
    if (await order({ type: "cancel" }, t("The goal is cancelled."))) sent.value = [];
  };
  return (
    <Button icon={CircleX} kind="danger" onClick={() => void cancel()}>
      {t("Cancel goal")}
    </Button>
  );
}

/** The goal in words; with its progress where it was sent from here. */
export function Progress() {
  const part = drive.value;
  const goal = part?.goal.value;
  const way = progress(goal, taken.value ? sent.value.length : 0);
  return (
    <div class="progress">
      <p>{goalWords(goal, isHeld(part?.holds ?? []) === true, standsWhy(part))}</p>
      {way ? (
        <p class="progress-way">
          <progress max={way.of} value={way.at} aria-label={t("Waypoints")} />
          <span class="figure">
            {sentAs.value ? `${sentAs.value}: ` : ""}
            {t("waypoint {at} of {of}", way)}
          </span>
        </p>
      ) : null}
    </div>
  );
}

/** All of it, for the drive view. */
export function Destination() {
  if (!scene.value?.routes.length) return <Empty>{t("The robot has no named destinations. The map sends it anywhere.")}</Empty>;
  return (
    <>
      <Progress />
      {may("operator") ? (
        <div class="row">
          <DriveTo />
          <CancelGoal />
        </div>
      ) : null}
    </>
  );
}
