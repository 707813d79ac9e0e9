// This device: who it is for the robot, pairing, the other devices, and how the page looks.
import { useEffect, useState } from "preact/hooks";
import { KeyRound, LogOut, MonitorSmartphone, Palette, ShieldCheck, Trash2 } from "lucide-preact";
import { type Theme, theme } from "../design/theme";
import { span } from "../format";
import { sentence, unpaired } from "../operate";
import type { Device, Role } from "../protocol";
import { may, me, role } from "../state";
import { Badge, Button, Card, Slide, Table, toast } from "../ui";
import { type Plain, rich, t } from "../words";
import { type Choice, choice } from "../words/language";
import { said } from "../words/said";
import { Invite } from "./invite";
import { code8, codeInAddress, devices, forget, pair, unpair } from "./pairing";
import "./access.css";

/** What each role may do, in words. */
const ROLES: Record<Role, Plain> = {
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
  const kinds: [RegExp, Plain][] = [[/iPhone/, "iPhone"], [/iPad/, "iPad"], [/Android.*Mobile/, "Android phone"], [/Android/, "Android tablet"], [/Windows/, "Windows computer"], [/Mac OS/, "Mac"], [/Linux/, "Linux computer"]];
  return t(kinds.find(([kind]) => kind.test(agent))?.[1] ?? "A browser");
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
      toast(t("This device is paired."), "good");
      location.hash = "#/drive";
    } else setWrong(why);
  };
  return (
    <Card title={t("Pair this device")} icon={KeyRound} aside={<Badge tone="off">{role.value === "nobody" ? t("not paired") : t(role.value)}</Badge>}>
      <p>{given ? t("The link brought the code. How shall others see this device?") : t(ROLES[role.value])}</p>
      <form class="stack" onSubmit={submit}>
        {given ? null : (
          <label class="field">
            {t("Code from the robot's console")}
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
          {t("Name of this device")}
          <input value={name} maxLength={40} autocomplete="off" onInput={(event) => setName(event.currentTarget.value)} />
        </label>
        {wrong === null ? null : (
          <p class="wrong" role="alert">
            {sentence(wrong)}
          </p>
        )}
        <Button kind="primary" type="submit" icon={KeyRound} onClick={() => {}} whyNot={busy ? t("The robot is asked") : null}>
          {t("Pair")}
        </Button>
      </form>
      <p class="why-not">
        {rich("{command} on the robot's computer, over SSH too, shows one code for operators and one for engineers.", { command: <code>advee web code</code> })}{" "}
        {t("Each pairs one device within ten minutes. Where the robot was started in a terminal, its first lines show them as well.")}
      </p>
    </Card>
  );
}

function Paired() {
  const end = async () => {
    const why = await unpair();
    toast(why === null ? t("This device is forgotten by the robot.") : said(why), why === null ? "good" : "bad");
  };
  return (
    <Card title={me.value?.name || t("This device")} icon={ShieldCheck} aside={<Badge tone="info">{t(role.value)}</Badge>}>
      <p>{t(ROLES[role.value])}</p>
      <div class="row">
        <Button icon={LogOut} onClick={() => void end()}>
          {t("End the pairing")}
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
    if (why !== null) toast(said(why), "bad");
    void ask();
  };
  return (
    <Card title={t("Paired devices")} icon={MonitorSmartphone} flush class="wide">
      {typeof list === "string" ? (
        <p class="empty">{t("The list is not to be had: {why}.", { why: said(list) })}</p>
      ) : (
        <Table
          caption={t("Paired devices")}
          rows={[...list].sort((a, b) => Number(b.you) - Number(a.you) || Number(b.connected) - Number(a.connected) || a.idle - b.idle)}
          id={(device) => device.id}
          empty={t("No device is paired.")}
          columns={[
            { head: t("Name"), title: true, by: (device) => device.name, cell: (device) => (device.you ? t("{name} (this one)", { name: device.name }) : device.name) },
            { head: t("Role"), by: (device) => device.role, cell: (device) => t(device.role) },
            {
              head: t("Seen"),
              by: (device) => device.idle,
              cell: (device) => (device.connected ? <Badge tone="good">{t("connected")}</Badge> : t("{time} ago", { time: span(device.idle) })),
            },
            {
              head: t("Forget"),
              cell: (device) =>
                device.connected ? (
                  <Slide label={t("Forget")} tone="danger" onConfirm={() => void gone(device)} />
                ) : (
                  <Button icon={Trash2} onClick={() => void gone(device)}>
                    {t("Forget")}
                  </Button>
                ),
            },
          ]}
        />
      )}
    </Card>
  );
}

/** Each in its own language: who does not read the one that is shown finds their own. */
const LANGUAGE = "Language, jazyk";
const LANGUAGES: [Choice, string][] = [["auto", ""], ["en", "English"], ["cs", "Čeština"]];

function Looks() {
  const themes: [Theme, Plain][] = [["auto", "System"], ["light", "Light"], ["dark", "Dark"]];
  return (
    <Card title={t("Appearance")} icon={Palette}>
      <div class="choice" role="group" aria-label={t("Colours")}>
        {themes.map(([each, label]) => (
          <Button key={each} pressed={theme.value === each} onClick={() => (theme.value = each)}>
            {t(label)}
          </Button>
        ))}
      </div>
      <div class="choice" role="group" aria-label={LANGUAGE}>
        {LANGUAGES.map(([each, label]) => (
          <Button key={each} pressed={choice.value === each} onClick={() => (choice.value = each)}>
            {each === "auto" ? t("As the browser") : <span lang={each}>{label}</span>}
          </Button>
        ))}
      </div>
      <p class="why-not">
        {me.value?.robot ?? "advee"} {me.value?.version}
      </p>
    </Card>
  );
}
