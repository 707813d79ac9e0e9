// What must not be overlooked: a lost connection, control that went to somebody else, a robot that senses nothing, a
// recorded run, a new version.
import { CircleAlert, EyeOff, Film, RefreshCw, WifiOff } from "lucide-preact";
import type { ComponentChildren } from "preact";
import { num, span } from "../format";
import { lostControl, sentence } from "../operate";
import { connection, demo, scene } from "../state";
import { Button } from "../ui";
import { rich, t } from "../words";
import { language } from "../words/language";
import { said } from "../words/said";
import { applyUpdate, updateReady } from "./update";

export function Banners() {
  const now = connection.value;
  return (
    <div class="banners" lang={language.value}>
      {now.state === "lost" ? (
        <Banner tone="bad" icon={<WifiOff size={20} aria-hidden />} urgent>
          <strong>{t("Connection lost.")}</strong> {t("Nothing shown here is newer than {age}.", { age: span(now.for) })} {now.why ? `(${said(now.why)}) ` : ""}
          {t("It is tried again by itself; a drive is not resumed.")}
        </Banner>
      ) : null}
      {lostControl.value ? (
        <Banner
          tone="warn"
          icon={<CircleAlert size={20} aria-hidden />}
          urgent
          action={<Button onClick={() => (lostControl.value = null)}>{t("OK")}</Button>}
        >
          <strong>{t("You have no control any more.")}</strong> {sentence(lostControl.value)}
        </Banner>
      ) : null}
      {typeof scene.value?.blind === "number" ? (
        <Banner tone="warn" icon={<EyeOff size={20} aria-hidden />}>
          <strong>{t("NOTHING SENSES WHAT IS IN THE WAY: AT MOST {speed}.", { speed: num(scene.value.blind, 2, "m/s") })}</strong> {t("Driven by hand it does not stop before anybody.")}
        </Banner>
      ) : null}
      {demo.value ? (
        <Banner
          tone="info"
          icon={<Film size={20} aria-hidden />}
          action={
            <a class="button" href={`${location.pathname}#/drive`} onClick={() => location.assign(location.pathname)}>
              {t("Leave")}
            </a>
          }
        >
          {rich("{title} {run}, {length}. Nothing can be commanded.", { title: <strong>{t("Recorded run")}</strong>, run: demo.value.run, length: span(demo.value.seconds) })}
        </Banner>
      ) : null}
      {updateReady.value ? (
        <Banner tone="info" icon={<RefreshCw size={20} aria-hidden />} action={<Button onClick={applyUpdate}>{t("Reload")}</Button>}>
          {t("The robot has a new version of this page.")}
        </Banner>
      ) : null}
    </div>
  );
}

function Banner(props: { tone: string; icon: ComponentChildren; action?: ComponentChildren; urgent?: boolean; children: ComponentChildren }) {
  return (
    <div class={`banner tone-${props.tone}`} role={props.urgent ? "alert" : "note"}>
      {props.icon}
      <p>{props.children}</p>
      {props.action}
    </div>
  );
}
