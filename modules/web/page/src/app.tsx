// The frame of every view: status on top, navigation, Stop always in the same place.
import { useEffect, useRef } from "preact/hooks";
import { Banners } from "./shell/banners";
import { Guard } from "./shell/guard";
import { watchKeys } from "./shell/keys";
import { Nav } from "./shell/nav";
import { Recent, recentShown } from "./shell/recent";
import { StatusBar } from "./shell/status";
import { Stop, StopExplained } from "./shell/stop";
import { may, me, recorded } from "./state";
import { Timeline } from "./timeline";
import { Toasts } from "./ui";
import { view } from "./views";
import { t } from "./words";
import { language } from "./words/language";

export function App() {
  const main = useRef<HTMLElement>(null);
  const { id, label: english, view: View, english: isEnglish } = view.value;
  const label = t(english);
  const shown = recentShown.value && may("viewer");
  useEffect(watchKeys, []);
  useEffect(() => {
    document.title = `${label} · ${me.value?.robot ?? "advee"}`;
  }, [label, me.value?.robot]);
  useEffect(() => main.current?.scrollTo(0, 0), [id, me.value?.robot]);
  return (
    <>
      <div class={`app${recorded ? " is-recorded" : ""}${shown ? " has-recent" : ""}`}>
        <StatusBar>
          <a class="skip" href={`#/${id}`} onClick={(event) => (event.preventDefault(), main.current?.focus())}>
            {t("Skip to the view")}
          </a>
        </StatusBar>
        <Nav />
        <main ref={main} tabIndex={-1} class={`view view-${id}`} aria-label={label}>
          <h1 class="visually-hidden">{label}</h1>
          <Banners />
          <Guard key={id}>
            {isEnglish && language.value !== "en" ? (
              <div class="in-english" lang="en">
                <View />
              </div>
            ) : (
              <View />
            )}
          </Guard>
        </main>
        {shown ? <Recent /> : null}
        {recorded ? <Timeline /> : <Stop />}
      </div>
      <StopExplained />
      <Toasts />
    </>
  );
}
