// A further device: an engineer shows its user a QR code, and the code as digits.
import { QrCode } from "lucide-preact";
import { useState } from "preact/hooks";
import { sentence } from "../operate";
import type { Invite as Invited } from "../protocol";
import { Button, Card, Dialog, toast } from "../ui";
import { rich, t } from "../words";
import { invite } from "./pairing";
import { outline } from "./qr";

export function Invite() {
  const [shown, setShown] = useState<Invited | null>(null);
  const ask = async () => {
    const answer = await invite();
    if (typeof answer === "string") toast(sentence(answer), "bad");
    else setShown(answer);
  };
  return (
    <Card title={t("Pair another device")} icon={QrCode}>
      <p>{t("A code that pairs one device as an operator's, for the camera of a phone.")}</p>
      <div class="row">
        <Button icon={QrCode} onClick={() => void ask()}>
          {t("Show a code")}
        </Button>
      </div>
      <p class="why-not">{rich("An engineer's device is paired by {command} on the robot's computer only.", { command: <code>advee web code</code> })}</p>
      {shown ? (
        <Dialog title={t("Pair another device")} open onClose={() => setShown(null)}>
          <Shown invited={shown} />
        </Dialog>
      ) : null}
    </Card>
  );
}

function Shown({ invited: { code, link, picture, valid_s } }: { invited: Invited }) {
  const { path, side } = outline(picture);
  return (
    <>
      {link && picture.length > 0 ? (
        <>
          {/* Black on white in either scheme: not every camera takes an inverted one. */}
          <svg class="qr" viewBox={`0 0 ${side} ${side}`} shape-rendering="crispEdges" role="img" aria-label={t("QR code of the link that pairs an operator's device")}>
            <rect width={side} height={side} fill="#fff" />
            <path d={path} fill="#000" />
          </svg>
          <p>{rich("Point the phone's camera at it. The link opens this page there and asks for a name: {link}", { link: <code class="qr-link">{link}</code> })}</p>
        </>
      ) : (
        <p>
          {t("A phone does not reach this address ({address}), so there is no QR code. Open the page at an address of the robot in its network, or type the code there.", {
            address: location.host,
          })}
        </p>
      )}
      <p>
        {t("Code:")} <strong class="code">{`${code.slice(0, 4)} ${code.slice(4)}`}</strong>
      </p>
      <p class="why-not">{t("It pairs one device as an operator's within {n} minutes.", { n: Math.ceil(valid_s / 60) })}</p>
    </>
  );
}
