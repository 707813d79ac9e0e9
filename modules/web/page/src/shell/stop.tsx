// Stop: always there, always in the same place. When the robot is stopped, the same place says so and lets it go on.
import { Hand, OctagonX } from "lucide-preact";
import { useEffect, useRef } from "preact/hooks";
import { resume, stop, stopExplained, stopFailed, stopped, stopping, take, unpaired } from "../operate";
import { authority, connection, demo, holder } from "../state";
import { Button, Dialog, Slide } from "../ui";
import { keysRest } from "../ui/rest";
import { rich, t } from "../words";
import { said } from "../words/said";

export function Stop() {
  if (demo.value) return null;
  const failed = stopFailed.value;
  return (
    <section class="stop" aria-label={t("Stop")}>
      {stopped.value && connection.value.state === "live" ? <Stopped /> : <StopButton />}
      {failed === null ? null : (
        <p class="stop-failed" role="alert">
          {t("Stop was not said: {why}. Use the button on the robot.", { why: said(failed) })}
        </p>
      )}
    </section>
  );
}

function StopButton() {
  const viewer = unpaired.value;
  const button = useRef<HTMLButtonElement>(null);
  // The slide that was here had the focus, and took it along.
  useEffect(() => {
    if (keysRest() && document.activeElement === document.body) button.current?.focus();
  }, []);
  return (
    <button
      ref={button}
      type="button"
      class={`stop-button ${viewer ? "is-viewer" : ""}`}
      // Any finger, another one on the pad or not.
      onPointerDown={(event) => event.button === 0 && void stop()}
      onClick={(event) => event.detail === 0 && void stop()}
    >
      <OctagonX size={30} strokeWidth={2.4} aria-hidden />
      <span>{stopping.value ? t("Stopping…") : t("Stop")}</span>
      <small>{viewer ? t("after pairing") : t("Space or Esc")}</small>
    </button>
  );
}

function Stopped() {
  const whyNot = unpaired.value ? t("An operator resumes") : null;
  return (
    <div class="stop-held">
      <p>
        <OctagonX size={22} aria-hidden /> <strong>{t("Stopped")}</strong>
      </p>
      {authority.value.yours || whyNot ? (
        <Slide label={t("Resume")} tone="good" whyNot={whyNot} onConfirm={() => void resume()} />
      ) : holder.value ? (
        <p class="stop-note">{t("{name} has control and may resume.", { name: holder.value.name })}</p>
      ) : (
        <Button icon={Hand} onClick={() => void take()}>
          {t("Take control")}
        </Button>
      )}
    </div>
  );
}

export function StopExplained() {
  const close = () => (stopExplained.value = false);
  return (
    <Dialog title={t("You are watching")} open={stopExplained.value} onClose={close}>
      <p>{t("Only a paired device may stop the robot from here.")}</p>
      <p>{t("In danger use the red button on the robot, or its bumper: it stops at once.")}</p>
      <p>{rich("To pair, enter the eight digits that {command} shows on the robot's computer.", { command: <code>advee web code</code> })}</p>
      <div class="row">
        <a class="button primary" href="#/access" onClick={close}>
          {t("Pair this device")}
        </a>
        <Button onClick={close}>{t("Not now")}</Button>
      </div>
    </Dialog>
  );
}
