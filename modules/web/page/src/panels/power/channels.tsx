// The power channels: what is fed, with what current; on, off, and off and on again.
import { Plug, Power as PowerIcon } from "lucide-preact";
import { useState } from "preact/hooks";
import { num } from "../../format";
import { stale, system } from "../../state";
import { Age, Badge, Button, Card, type Column, Dialog, Empty, Slide, Table } from "../../ui";
import { order } from "../../operate";
import { type Plain, rich, t } from "../../words";
import { lacks } from "../lacks";

type Channel = { name: string; on: boolean; current: number | null };

/** What hangs on a channel, where switching it off does more than its name says. */
const WARNINGS: Readonly<Record<string, Plain>> = {
  host: "The robot's own computer: its modules are ended and it is halted. Then it cannot be switched on again from here.",
  motors: "Without it the robot does not move.",
  sensors: "Without it sonars, odometry and beacons are silent.",
  switch: "The network switch: this connection may end with it.",
};

/** Number of the fault of a channel that switched itself off: ChannelTripped in docs/faults.md. */
const TRIPPED = 0x0505;

function State({ channel: { name, on } }: { channel: Channel }) {
  if (on) return <Badge tone="good">{t("on")}</Badge>;
  const tripped = system.value?.errors.some((fault) => fault.standing && fault.number === TRIPPED && fault.subject === name);
  return tripped ? <Badge tone="bad">{t("tripped")}</Badge> : <Badge tone="off">{t("off")}</Badge>;
}

export function Channels() {
  const [chosen, choose] = useState<string | null>(null);
  const shown = system.value?.power;
  const rows = shown?.value?.channels;
  const columns: Column<Channel>[] = [
    { head: t("Channel"), title: true, by: (row) => row.name, cell: (row) => row.name },
    { head: t("Status"), by: (row) => (row.on ? 0 : 1), cell: (row) => <State channel={row} /> },
    { head: t("Current"), figure: true, by: (row) => row.current ?? -Infinity, cell: (row) => num(row.current, 2, "A") },
    {
      head: t("Switch"),
      cell: (row) => <Button kind="quiet" icon={PowerIcon} label={t("Switch {name}", { name: row.name })} onClick={() => choose(row.name)} />,
    },
  ];
  const channel = rows?.find((row) => row.name === chosen);
  return (
    <Card title={t("Power channels")} icon={Plug} class="p-fits" flush aside={<Age shown={shown} />}>
      {rows ? (
        <Table caption={t("Power channels")} columns={columns} rows={rows} id={(row) => row.name} stale={() => stale(shown)} />
      ) : (
        <Empty>{t("No data yet.")}</Empty>
      )}
      {channel ? <Switch channel={channel} onClose={() => choose(null)} /> : null}
    </Card>
  );
}

function Switch({ channel, onClose }: { channel: Channel; onClose: () => void }) {
  const { name, on } = channel;
  const whyNot = lacks("engineer");
  const warning = WARNINGS[name];
  const command = async (action: "on" | "off" | "reboot", done: string) => {
    if (await order({ type: "power", channel: name, action }, done)) onClose();
  };
  return (
    <Dialog title={t("Channel {name}", { name })} open onClose={onClose}>
      <p>{rich("It is {state} and draws {current}.", { state: <State channel={channel} />, current: num(channel.current, 2, "A") })}</p>
      {warning ? <p class="p-note">{t(warning)}</p> : null}
      <ul class="p-commands">
        <li>
          <Button icon={PowerIcon} whyNot={whyNot ?? (on ? t("It is on.") : null)} onClick={() => command("on", t("{name} is commanded on.", { name }))}>
            {t("Switch on")}
          </Button>
        </li>
        <li>
          <Slide label={t("Switch {name} off", { name })} tone="danger" whyNot={whyNot} onConfirm={() => command("off", t("{name} is commanded off.", { name }))} />
        </li>
        <li>
          <Slide
            label={t("Reboot {name}", { name })}
            tone="danger"
            whyNot={whyNot}
            onConfirm={() => command("reboot", t("{name} is commanded off and on again.", { name }))}
          />
        </li>
      </ul>
      {whyNot ? <p class="p-note">{whyNot}</p> : null}
    </Dialog>
  );
}
