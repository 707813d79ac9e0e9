// This device: who it is for the robot, pairing, the other devices, and how the page looks.
import { useEffect, useState } from "preact/hooks";
import { KeyRound, LogOut, MonitorSmartphone, Palette, ShieldCheck, Trash2 } from "lucide-preact";
import { type Theme, theme } from "../design/theme";
import { span } from "../format";
import { sentence, unpaired } from "../operate";
import type { Device, Role } from "../protocol";
import { may, me, role } from "../state";
import { Badge, Button, Card, Slide, Table, toast } from "../ui";
import { Invite } from "./invite";
import { code8, codeInAddress, devices, forget, pair, unpair } from "./pairing";
import "./access.css";

/** What each role may do, in words. */
const ROLES: Record<Role, string> = {
  nobody: "This device is not paired: it sees nothing of the robot.",
  viewer: "You are watching. To drive, enter the code from the robot's console.",
  operator: "You may stop the robot, take control, drive it and send it to places.",
  engineer: "You may do all that an operator may, and command modules, power, drives and the simulation.",
};

export function Access() {
  return (
    <div class="cards">
      {unpaired.value || codeInAddress.value ? <Pairing /> : <Paired />}
      <Looks />
      {may("engineer") ? <Invite /> : null}
      {may("engineer") ? <Devices /> : null}
    </div>
  );
}

/** A name that others will know this device by: its kind, until one is typed. */
function usual(): string {
  const agent = navigator.userAgent;
  const kinds: [RegExp, string][] = [[/iPhone/, "iPhone"], [/iPad/, "iPad"], [/Android.*Mobile/, "Android phone"], [/Android/, "Android tablet"], [/Windows/, "Windows computer"], [/Mac OS/, "Mac"], [/Linux/, "Linux computer"]];
  return kinds.find(([kind]) => kind.test(agent))?.[1] ?? "A browser";
}

function Pairing() {
  const given = codeInAddress.value;
  const [code, setCode] = useState("");
  const [name, setName] = useState(() => me.value?.name || usual());
  const [wrong, setWrong] = useState<string | null>(null);
  const [busy, setBusy] = useState(false);
  const submit = async (event: Event) => {
    event.preventDefault();
    const digits = given ?? code8(code);
    if (digits === null) return setWrong("The code has eight digits.");
    if (!name.trim()) return setWrong("Give this device a name, so that others see who it is.");
    setBusy(true);
    const why = await pair(digits, name.trim());
    setBusy(false);
    codeInAddress.value = null;
    if (why === null) {
      toast("This device is paired.", "good");
      location.hash = "#/drive";
    } else setWrong(sentence(why));
  };
  return (
    <Card title="Pair this device" icon={KeyRound} aside={<Badge tone="off">{role.value === "nobody" ? "not paired" : role.value}</Badge>}>
      <p>{given ? "The link brought the code. How shall others see this device?" : ROLES[role.value]}</p>
      <form class="stack" onSubmit={submit}>
        {given ? null : (
          <label class="field">
            Code from the robot's console
            <input
              class="code"
              value={code}
              onInput={(event) => setCode(event.currentTarget.value)}
              inputMode="numeric"
              autocomplete="one-time-code"
              placeholder="1234 5678"
              maxLength={12}
            />
          </label>
        )}
        <label class="field">
          Name of this device
          <input value={name} maxLength={40} autocomplete="off" onInput={(event) => setName(event.currentTarget.value)} />
        </label>
        {wrong === null ? null : (
          <p class="wrong" role="alert">
            {wrong}
          </p>
        )}
        <Button kind="primary" type="submit" icon={KeyRound} onClick={() => {}} whyNot={busy ? "The robot is asked" : null}>
          Pair
        </Button>
      </form>
      <p class="why-not">
        <code>advee web code</code> on the robot's computer, over SSH too, shows one code for operators and one for engineers. Each
        pairs one device within ten minutes. Where the robot was started in a terminal, its first lines show them as well.
      </p>
    </Card>
  );
}

function Paired() {
  const end = async () => {
    const why = await unpair();
    toast(why ?? "This device is forgotten by the robot.", why === null ? "good" : "bad");
  };
  return (
    <Card title={me.value?.name || "This device"} icon={ShieldCheck} aside={<Badge tone="info">{role.value}</Badge>}>
      <p>{ROLES[role.value]}</p>
      <div class="row">
        <Button icon={LogOut} onClick={() => void end()}>
          End the pairing
        </Button>
      </div>
    </Card>
  );
}

function Devices() {
  const [list, setList] = useState<Device[] | string>([]);
  const ask = async () => setList(await devices());
  useEffect(() => {
    void ask();
    const timer = setInterval(ask, 5000);
    return () => clearInterval(timer);
  }, []);
  const gone = async (device: Device) => {
    const why = await forget(device.id);
    if (why !== null) toast(why, "bad");
    void ask();
  };
  return (
    <Card title="Paired devices" icon={MonitorSmartphone} flush class="wide">
      {typeof list === "string" ? (
        <p class="empty">The list is not to be had: {list}.</p>
      ) : (
        <Table
          caption="Paired devices"
          rows={[...list].sort((a, b) => Number(b.you) - Number(a.you) || Number(b.connected) - Number(a.connected) || a.idle - b.idle)}
          id={(device) => device.id}
          empty="No device is paired."
          columns={[
            { head: "Name", title: true, by: (device) => device.name, cell: (device) => `${device.name}${device.you ? " (this one)" : ""}` },
            { head: "Role", by: (device) => device.role, cell: (device) => device.role },
            {
              head: "Seen",
              by: (device) => device.idle,
              cell: (device) => (device.connected ? <Badge tone="good">connected</Badge> : `${span(device.idle)} ago`),
            },
            {
              head: "Forget",
              cell: (device) =>
                device.connected ? (
                  <Slide label="Forget" tone="danger" onConfirm={() => void gone(device)} />
                ) : (
                  <Button icon={Trash2} onClick={() => void gone(device)}>
                    Forget
                  </Button>
                ),
            },
          ]}
        />
      )}
    </Card>
  );
}

function Looks() {
  const themes: [Theme, string][] = [["auto", "System"], ["light", "Light"], ["dark", "Dark"]];
  return (
    <Card title="Appearance" icon={Palette}>
      <div class="choice" role="group" aria-label="Colours">
        {themes.map(([each, label]) => (
          <Button key={each} pressed={theme.value === each} onClick={() => (theme.value = each)}>
            {label}
          </Button>
        ))}
      </div>
      <p class="why-not">
        {me.value?.robot ?? "advee"} {me.value?.version}
      </p>
    </Card>
  );
}
