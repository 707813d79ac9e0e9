// The picture of a run: its path, its motion, what stopped it. The robot draws it when it is asked to, which takes seconds.
import { Download } from "lucide-preact";
import { useEffect, useState } from "preact/hooks";
import type { Refused } from "../../protocol";
import { Dialog } from "../../ui";
import { t } from "../../words";
import { said } from "../../words/said";
import { reportLink, started } from "./names";

/** ms until it is asked again while another run is being read. */
const AGAIN = 1500;

export function Report({ run, onClose }: { run: string; onClose: () => void }) {
  const [picture, show] = useState<string | null>(null);
  const [why, refuse] = useState("");
  useEffect(() => {
    const gone = new AbortController();
    void draw(run, gone.signal, refuse).then((drawn) => drawn && show(drawn));
    return () => gone.abort();
  }, [run]);
  return (
    <Dialog title={t("Report of {run}", { run: started(run) })} open wide onClose={onClose}>
      {picture ? (
        <div class="p-report" tabIndex={0} role="group" aria-label={t("Picture, can be scrolled")}>
          <img src={picture} alt={t("Path on the map, motion, stops, reports and states of the run {run}", { run: started(run) })} />
        </div>
      ) : (
        <p role="status">{why ? t("It cannot be drawn: {why}.", { why: said(why) }) : t("The robot reads the run and draws it.")}</p>
      )}
      {picture ? (
        <a class="button" href={picture} download={`${run}.png`}>
          <Download size={20} aria-hidden /> <span>{t("Download the picture")}</span>
        </a>
      ) : null}
    </Dialog>
  );
}

/** The picture as a data URL, which the page's policy permits; null: there is none. */
async function draw(run: string, signal: AbortSignal, refuse: (why: string) => void): Promise<string | null> {
  for (;;) {
    try {
      const response = await fetch(reportLink(run), { signal });
      if (response.ok) return await dataUrl(await response.blob());
      if (response.status !== 503) {
        refuse(((await response.json()) as Refused).why);
        return null;
      }
    } catch {
      if (!signal.aborted) refuse("the robot does not answer");
      return null;
    }
    await new Promise((after) => setTimeout(after, AGAIN));
    if (signal.aborted) return null;
  }
}

const dataUrl = (blob: Blob): Promise<string> =>
  new Promise((read, failed) => {
    const reader = new FileReader();
    reader.onload = () => read(String(reader.result));
    reader.onerror = () => failed(reader.error ?? new Error("it cannot be read"));
    reader.readAsDataURL(blob);
  });
