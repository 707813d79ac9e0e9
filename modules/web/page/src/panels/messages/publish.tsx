// A message that an engineer writes and publishes, to begin with the last one of its channel.
import { Hand, RotateCcw, Send } from "lucide-preact";
import { useId, useState } from "preact/hooks";
import { order, take } from "../../operate";
import { authority, holder, may, scene, system, whyNot } from "../../state";
import { UNITS } from "../../units";
import { Button, Dialog, Slide } from "../../ui";
import { lacks } from "../lacks";
import { beginning, command, type Draft, wrong } from "./draft";
import { latest } from "./store";

const last = (channel: string): Record<string, unknown> | null => latest(channel)?.part.value ?? null;

/** Opens the form; `channel`: on this one. Only engineers see it. */
export function Publish({ channel = "" }: { channel?: string }) {
  const [open, setOpen] = useState(false);
  if (!may("engineer")) return null;
  return (
    <>
      <Button kind="quiet" icon={Send} onClick={() => setOpen(true)}>
        Publish…
      </Button>
      <Dialog title="Publish a message" open={open} onClose={() => setOpen(false)}>
        <Form channel={channel} />
      </Dialog>
    </>
  );
}

function Form({ channel }: { channel: string }) {
  const offers = scene.value?.publish ?? [];
  const [draft, setDraft] = useState<Draft>(() => ({ channel, type: "", text: beginning(channel, last(channel), offers) }));
  const heard = system.value?.channels ?? [];
  const [channels, types] = [useId(), useId()];
  const set = (change: Partial<Draft>) => setDraft({ ...draft, ...change });
  const isOwn = offers.some((offer) => offer.channel === draft.channel);
  const fault = wrong(draft, offers, heard);
  const why = lacks("engineer") ?? whyNot.value ?? fault;
  // A channel that is chosen by its name has a message of its own.
  const turn = (name: string) => set({ channel: name, ...(offers.some((offer) => offer.channel === name) ? { type: "", text: beginning(name, last(name), offers) } : {}) });
  return (
    <div class="p-form">
      <label class="field p-grow">
        Channel
        <input list={channels} value={draft.channel} spellcheck={false} autocomplete="off" onInput={(event) => turn(event.currentTarget.value.trim())} />
      </label>
      <datalist id={channels}>
        {[...offers.map((offer) => offer.channel), ...heard.filter((row) => row.type === "").map((row) => row.channel)].map((name) => (
          <option key={name} value={name} />
        ))}
      </datalist>
      {isOwn ? null : (
        <label class="field p-grow">
          Type of its messages
          <input list={types} value={draft.type} spellcheck={false} autocomplete="off" onInput={(event) => set({ type: event.currentTarget.value.trim() })} />
          <datalist id={types}>
            {[...new Set([...offers.map((offer) => offer.type), ...UNITS.keys()])].map((name) => (
              <option key={name} value={name} />
            ))}
          </datalist>
        </label>
      )}
      <label class="field p-full">
        Message
        <textarea rows={10} value={draft.text} spellcheck={false} autocomplete="off" onInput={(event) => set({ text: event.currentTarget.value })} />
      </label>
      <p class="muted p-full">
        All fields, as JSON; null is a number that is not known. The time, and in commands who sends them, are set by the robot. What moves the robot is not published here.
      </p>
      <div class="row p-full">
        <Button icon={RotateCcw} onClick={() => set({ text: beginning(draft.channel, last(draft.channel), offers) })}>
          {last(draft.channel) ? "The last message" : "An empty message"}
        </Button>
        {lacks("engineer") === null && !authority.value.yours && !holder.value ? (
          <Button icon={Hand} onClick={() => void take()}>
            Take control
          </Button>
        ) : null}
      </div>
      <div class="p-full">
        <Slide
          label={`Publish on ${draft.channel}`}
          tone="danger"
          whyNot={why}
          onConfirm={() => void order(command(draft), `It was published on ${draft.channel}.`)}
        />
      </div>
      {why ? <p class="p-note p-full">{why}</p> : null}
    </div>
  );
}
