// What the recorder does; start, stop, and a marker with a text.
import { Bookmark, Circle, Square } from "lucide-preact";
import { useState } from "preact/hooks";
import { bytes } from "../../format";
import { stale, system } from "../../state";
import { Age, Badge, Button, Card, Empty, Facts } from "../../ui";
import { order } from "../../operate";
import { lacks } from "../lacks";
import { t } from "../../words";
import { count } from "../format";
import { started } from "./names";

/** Characters of a marker, as the server takes them. */
const MARK_MAX = 200;

export function RecorderCard() {
  const [text, setText] = useState("");
  const shown = system.value?.log;
  const value = shown?.value;
  if (!shown || !value) {
    return (
      <Card title={t("Recorder")}>
        <Empty>{t("No recorder is known.")}</Empty>
      </Card>
    );
  }
  const whyNot = lacks("operator");
  const mark = async () => {
    if (await order({ type: "log", action: "mark", text: text.trim() }, t("The marker was set."))) setText("");
  };
  const noText = text.trim() === "" ? t("Write first what the marker is to say.") : null;
  return (
    <Card title={t("Recorder")} aside={<Age shown={shown} />}>
      <div class={stale(shown) ? "is-stale" : ""}>
        <Facts
          facts={[
            { name: t("State"), value: value.recording ? <Badge tone="good" icon={Circle}>{t("recording")}</Badge> : <Badge tone="warn">{t("not recording")}</Badge> },
            { name: t("Run"), value: value.run ? started(value.run) : "–" },
            { name: t("Written to the log"), value: bytes(value.bytes) },
            {
              name: t("Dropped"),
              value: value.dropped > 0 ? <Badge tone="bad">{t("{n} {n|message|messages}", { n: count(value.dropped) })}</Badge> : t("none"),
            },
            { name: t("Free on the disk"), value: bytes(value.free) },
          ]}
        />
      </div>
      <form
        class="p-form"
        onSubmit={(event) => {
          event.preventDefault();
          if ((whyNot ?? noText) === null) void mark();
        }}
      >
        {value.recording ? (
          <Button icon={Square} whyNot={whyNot} onClick={() => order({ type: "log", action: "stop", text: "" }, t("The recorder is commanded to stop."))}>
            {t("Stop recording")}
          </Button>
        ) : (
          <Button
            icon={Circle}
            kind="primary"
            whyNot={whyNot}
            onClick={() => order({ type: "log", action: "start", text: "" }, t("The recorder is commanded to start."))}
          >
            {t("Start recording")}
          </Button>
        )}
        <label class="field p-grow">
          {t("Marker: what happens now")}
          <input value={text} maxLength={MARK_MAX} autocomplete="off" onInput={(event) => setText(event.currentTarget.value)} />
        </label>
        <Button type="submit" icon={Bookmark} whyNot={whyNot ?? noText} onClick={() => {}}>
          {t("Set marker")}
        </Button>
        {whyNot ? <p class="muted p-full">{whyNot}</p> : null}
      </form>
    </Card>
  );
}
