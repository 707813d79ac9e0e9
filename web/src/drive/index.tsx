// Driving by hand: who has control, what the robot does, and the pad.
import { Hand } from "lucide-preact";
import { deg, num } from "../format";
import { release, take } from "../operate";
import { authority, drive, holder, may, demo } from "../state";
import { Aged, Button, Card, Facts, Slide } from "../ui";

export function Drive() {
  return (
    <div class="cards">
      <Control />
      <Readings />
    </div>
  );
}

/** Takes control, or over from who has it, by a gesture that names them. */
export function Control() {
  if (demo.value) return null;
  const who = holder.value;
  const whyNot = may("operator") ? null : "Pair this device to take control";
  return (
    <Card title="Control" icon={Hand}>
      {authority.value.yours ? (
        <Button icon={Hand} onClick={() => void release()}>
          Give control back
        </Button>
      ) : who ? (
        <Slide label={`Take over from ${who.name}`} tone="danger" whyNot={whyNot} onConfirm={() => void take()} />
      ) : (
        <Button icon={Hand} kind="primary" whyNot={whyNot} onClick={() => void take()}>
          Take control
        </Button>
      )}
    </Card>
  );
}

/** Commanded and actual. */
export function Readings() {
  return (
    <Card title="Motion">
      <Aged shown={drive.value?.motion}>
        {(motion) => (
          <Facts
            facts={[
              { name: "Speed", value: num(motion.speed, 2, "m/s") },
              { name: "commanded", value: num(motion.speed_target, 2, "m/s") },
              { name: "Steering", value: deg(motion.steering) },
              { name: "commanded", value: deg(motion.steering_target) },
            ]}
          />
        )}
      </Aged>
    </Card>
  );
}
