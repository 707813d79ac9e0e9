// What one must know first: whether the robot may be driven, in a word and with the reason; whether it is well, in a second
// one; its speed, position and battery; how good the connection is; who holds control.
import {
  BatteryMedium, CircleAlert, CirclePause, CirclePlay, CircleCheck, CircleHelp, Gauge, Hand, Hourglass, KeyRound, LocateFixed, type LucideIcon, OctagonPause, TriangleAlert, Wifi, WifiOff,
} from "lucide-preact";
import type { ComponentChildren } from "preact";
import { useEffect, useRef } from "preact/hooks";
import { num } from "../format";
import { barred } from "../holds";
import { standsWhy } from "../map/words";
import type { StatusWord } from "../protocol";
import { authority, commandLink, connection, demo, drive, fresh, holder, me, role, roundTrip, scene, system } from "../state";
import { stopped } from "../operate";
import type { Tone } from "../ui/badge";
import { type Plain, t } from "../words";
import { said as translated } from "../words/said";
import { battery, position, second, type Second, type Vital, worse } from "./health";

const WORDS: Record<StatusWord, { word: Plain; icon: LucideIcon; tone: Tone }> = {
  silent: { word: "No contact", icon: CircleHelp, tone: "bad" },
  paused: { word: "Paused", icon: CirclePause, tone: "warn" },
  fault: { word: "Fault", icon: TriangleAlert, tone: "bad" },
  stopped: { word: "Stopped", icon: OctagonPause, tone: "warn" },
  waiting: { word: "Waiting", icon: Hourglass, tone: "info" },
  driving: { word: "Driving", icon: CirclePlay, tone: "good" },
  ready: { word: "Ready", icon: CircleCheck, tone: "good" },
};

/** The status as it may be believed now: without a connection nothing is known. */
export function status(): { word: string; icon: LucideIcon; tone: Tone; reason: string; second?: Second | null } {
  const now = connection.value;
  if (me.value === null) return { word: t("Connecting"), icon: Hourglass, tone: "off", reason: t("the robot does not answer yet; it is asked each second") };
  if (me.value.role === "nobody") return { word: t("Not paired"), icon: KeyRound, tone: "off", reason: t("this device sees nothing of the robot until it is paired") };
  if (now.state === "connecting") {
    return { word: t("Connecting"), icon: Hourglass, tone: "off", reason: translated(now.why) || t("waiting for the robot's first word") };
  }
  const said = drive.value?.status ?? { word: "silent" as const, reason: "" };
  const { word: english, icon, tone } = WORDS[said.word] ?? WORDS.silent;
  const word = t(english);
  if (now.state === "lost") {
    return { word: t("Not known"), icon: WifiOff, tone: "bad", reason: t("no connection; {word} at the last message", { word: word.toLowerCase() }) };
  }
  const not = second(drive.value?.concerns ?? [], said.reason, barred(drive.value?.holds ?? []));
  if (stopped.value) {
    const reason = t("an operator stopped it; it stays until an operator resumes");
    return { word: t(WORDS.stopped.word), icon: OctagonPause, tone: worse("warn", not?.tone ?? "warn"), reason, second: not };
  }
  // A check mark says that all is well.
  return { word, icon: not && said.word === "ready" ? CircleAlert : icon, tone: worse(tone, not?.tone ?? tone), reason: standsWhy(drive.value) || translated(said.reason), second: not };
}

export function StatusBar({ children }: { children: ComponentChildren }) {
  const { word, icon: Icon, tone, reason, second } = status();
  const bar = useRef<HTMLElement>(null);
  useEffect(() => {
    const shown = bar.current as HTMLElement;
    const room = () => document.documentElement.style.setProperty("--status", `${shown.offsetHeight}px`);
    const sized = new ResizeObserver(room);
    sized.observe(shown);
    return () => sized.disconnect();
  }, []);
  return (
    <header ref={bar} class={`status tone-${tone}`}>
      {children}
      <p class="visually-hidden" role="status" aria-atomic>
        {/* What is spoken: no figure that changes ten times a second. */}
        {me.value?.robot ?? t("The robot")}: {word}
        {second ? `, ${second.words}` : ""}
        {tone === "good" ? "" : `, ${reason.replace(/[0-9.,]+[ \u00A0](s|m\/s)\b/g, "")}`}
      </p>
      <div class="status-word">
        <Icon size={28} aria-hidden />
        <div>
          <div class="status-words">
            <strong>
              {word}
            </strong>
            {second ? (
              <a class={`status-second tone-${second.tone}`} href="#/errors" title={second.words}>
                <span>{second.words}</span>
                {second.more > 0 ? <b>+{second.more}</b> : null}
              </a>
            ) : null}
          </div>
          <p title={reason}>{reason}</p>
        </div>
      </div>
      <Vitals />
      <div class="status-side">
        <Trip />
        <Control />
        {/* On a wide screen it is above the navigation. */}
        {me.value ? <b class="status-name">{me.value.robot}</b> : null}
      </div>
    </header>
  );
}

/** Speed, position and battery; grey while they are not known. */
function Vitals() {
  const now = connection.value;
  if (drive.value === null || now.state === "connecting") return null;
  const motion = fresh(drive.value.motion);
  const aside = fresh(drive.value?.velocity)?.vy ?? 0;
  const along = motion?.speed ?? null;
  const pace = along !== null && Math.abs(aside) > 0.01 ? Math.hypot(along, aside) : along;
  const speed: Vital = motion === null ? { tone: "off", text: "–", title: t("Speed not known") } : { tone: "off", text: num(pace, 2, "m/s"), title: t("Speed {speed}", { speed: num(pace, 2, "m/s") }) };
  const rows: [string, LucideIcon, Vital][] = [
    ["speed", Gauge, speed],
    ...(drive.value.estimate.value ? ([["position", LocateFixed, position(fresh(drive.value.estimate), drive.value.ellipse)]] as [string, LucideIcon, Vital][]) : []),
    ...(scene.value?.power_channels.length ? ([["battery", BatteryMedium, battery(fresh(system.value?.power))]] as [string, LucideIcon, Vital][]) : []),
  ];
  return (
    <ul class="vitals" aria-label={t("Speed, position, battery")}>
      {rows.map(([name, Icon, { tone, text, title, more }]) => (
        <li key={name} class={`tone-${tone}`} title={title}>
          <Icon size={16} aria-hidden />
          <span aria-hidden>{text}</span>
          {more ? (
            <span class="vitals-more" aria-hidden>
              <span>{more}</span>
            </span>
          ) : null}
          <span class="visually-hidden">{title}</span>
        </li>
      ))}
    </ul>
  );
}

/** The round trip: an icon while it is good, amber with its figure over 200 ms, red over 500 ms. */
function Trip() {
  const now = connection.value;
  if (role.value === "nobody") return null;
  const trip = roundTrip.value;
  const tone = now.state === "lost" ? "bad" : now.state === "connecting" ? "off" : { good: "good", slow: "warn", bad: "bad" }[now.quality];
  const word = now.state === "lost" ? t("Lost") : demo.value ? t("Recorded") : trip === null ? t("No answer yet") : { good: "", slow: t("Slow¦connection"), bad: t("Too slow") }[now.state === "live" ? now.quality : "good"];
  const Icon = now.state === "lost" ? WifiOff : Wifi;
  return (
    <div class={`chip tone-${tone}`} title={`${t("Round trip of a command to the robot and back")}${trip === null ? "" : `: ${num(trip, 0, "ms")}`}`}>
      <Icon size={16} aria-hidden />
      <span class="visually-hidden">{t("Round trip")} </span>
      {word ? <b>{word}</b> : null}
      {trip !== null && commandLink.value.open && now.state === "live" ? <span class={now.quality === "good" ? "visually-hidden" : "figure"}>{num(trip, 0, "ms")}</span> : null}
    </div>
  );
}

/** Who holds control. */
function Control() {
  if (demo.value || connection.value.state !== "live") return null;
  const who = holder.value;
  const text = authority.value.yours ? t("You have control") : who ? (who.driving ? t("{name} drives", { name: who.name }) : t("{name} has control", { name: who.name })) : t("Nobody has control");
  return (
    <a class={`chip control ${authority.value.yours ? "tone-info" : who ? "tone-warn" : "tone-off"}`} href="#/drive" title={text}>
      <Hand size={16} aria-hidden />
      <span>{text}</span>
    </a>
  );
}
